//! The fuzz targets over their corpora, as they are and mutated: runs where the fuzzer itself cannot.

use std::path::Path;

use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};

#[path = "../../fuzz/decode_anything.rs"]
mod decode_anything;
#[path = "../../fuzz/read_anything.rs"]
mod read_anything;

use decode_anything::decode_anything;
use read_anything::read_anything;

fn corpus(name: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(name);
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let seeds: Vec<_> = files.map(|path| std::fs::read(path).unwrap()).collect();
    assert!(seeds.len() >= 5, "the corpus is gone");
    seeds
}

/// Runs a target over a corpus, then over changed and repeated seeds.
fn run(name: &str, target: fn(&[u8])) {
    let seeds = corpus(name);
    seeds.iter().for_each(|seed| target(seed));
    let mutated =
        (0..seeds.len(), prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..20), 0..9_usize);
    let mut runner = TestRunner::new(Config { cases: 3000, failure_persistence: None, ..Config::default() });
    let mutate = |(seed, changes, times): (usize, Vec<(prop::sample::Index, u8)>, usize)| {
        let mut bytes = seeds[seed].repeat(times + 1);
        for (at, byte) in changes {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        target(&bytes);
        Ok(())
    };
    runner.run(&mutated, mutate).unwrap();
}

#[test]
fn no_bytes_make_the_codec_panic() {
    run("rtde", read_anything);
}

#[test]
fn no_bytes_make_the_decoders_panic_or_depend_on_cuts() {
    run("events", decode_anything);
}
