//! Throughput of the event decoders on one core, beside a decoder that we did not write and a plain copy of the input.
//!
//! Two streams: a blinking board as the simulator sees it, and, where `CELLCAL_DATA` names the recordings, a real one
//! repeated with its clock running on. All candidates take turns, so that a busy machine disturbs them alike; the
//! median of the turns counts.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::disallowed_methods,
    reason = "a benchmark times and prints"
)]

use std::hint::black_box;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use cellcal::events::{Decoder, Encoder, Event, Format, Header, Trigger};
use rand::{Rng as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;

const EVENTS: usize = 10_000_000;
const TURNS: usize = 15;
/// A USB packet or so: what a camera hands over at once.
const PACKET_BYTES: usize = 1 << 16;

fn main() {
    let blink = blinking_board(EVENTS);
    println!("blinking board, {} events:", blink.len());
    let evt3 = encoded(&blink, Format::Evt3);
    compare(&evt3, blink.len());
    for (name, format) in [
        ("evt2", Format::Evt2),
        ("evt21", Format::Evt21 { legacy_halves: false }),
        ("evt21 legacy", Format::Evt21 { legacy_halves: true }),
    ] {
        let bytes = encoded(&blink, format);
        let mut turns = [ours(format, &bytes), copy(&bytes)];
        report(&mut turns, &["cellcal", "copy"], name, bytes.len(), blink.len());
    }
    if let Some((bytes, events)) = recording(EVENTS) {
        println!("recording, repeated to {events} events:");
        compare(&bytes, events);
    } else {
        println!("recording: skipped, CELLCAL_DATA does not name the folder of recordings");
    }
}

type Candidate<'a> = Box<dyn FnMut() + 'a>;

fn compare(bytes: &[u8], events: usize) {
    same_events(bytes);
    let mut turns = [ours(Format::Evt3, bytes), theirs(bytes), copy(bytes)];
    report(&mut turns, &["cellcal", "crate evt3", "copy"], "evt3", bytes.len(), events);
}

/// A comparison of speeds is one only if both find the same.
fn same_events(bytes: &[u8]) {
    let (mut events, mut triggers) = (Vec::new(), Vec::new());
    Decoder::new(Format::Evt3).decode(bytes, &mut events, &mut triggers);
    let (mut foreign, mut edges) = (Vec::new(), Vec::new());
    evt3::Evt3Decoder::new().decode_bytes(bytes, &mut foreign, &mut edges).unwrap();
    let foreign = foreign.iter().map(|e| Event { t_us: e.timestamp as i64, x: e.x, y: e.y, on: e.polarity == 1 });
    assert!(events.into_iter().eq(foreign), "the decoders differ");
}

fn ours(format: Format, bytes: &[u8]) -> Candidate<'_> {
    let (mut events, mut triggers): (Vec<Event>, Vec<Trigger>) = (Vec::new(), Vec::new());
    Box::new(move || {
        let mut decoder = Decoder::new(format);
        for packet in bytes.chunks(PACKET_BYTES) {
            events.clear();
            decoder.decode(packet, &mut events, &mut triggers);
            black_box(&events);
        }
    })
}

fn theirs(bytes: &[u8]) -> Candidate<'_> {
    let (mut events, mut triggers) = (Vec::new(), Vec::new());
    Box::new(move || {
        let mut decoder = evt3::Evt3Decoder::new();
        for packet in bytes.chunks(PACKET_BYTES) {
            events.clear();
            decoder.decode_bytes(packet, &mut events, &mut triggers).unwrap();
            black_box(&events);
        }
    })
}

fn copy(bytes: &[u8]) -> Candidate<'_> {
    let mut to = vec![0; bytes.len()];
    Box::new(move || {
        to.copy_from_slice(black_box(bytes));
        black_box(&to);
    })
}

/// Prints the median speed of each candidate; the last one is the copy.
fn report(candidates: &mut [Candidate<'_>], names: &[&str], format: &str, bytes: usize, events: usize) {
    let mut times = vec![Vec::new(); candidates.len()];
    for turn in 0..=TURNS {
        for (candidate, times) in candidates.iter_mut().zip(&mut times) {
            let start = Instant::now();
            candidate();
            // The first turn only makes room for the events.
            if turn > 0 {
                times.push(start.elapsed());
            }
        }
    }
    let medians: Vec<f64> = times.iter_mut().map(|times| median(times).as_secs_f64()).collect();
    let copy_s = medians.last().copied().unwrap();
    for (name, seconds) in names.iter().zip(&medians) {
        let rate = if *name == "copy" {
            "            ".into()
        } else {
            format!("{:7.1} Mev/s", events as f64 / seconds * 1e-6)
        };
        let (mb_s, ratio) = (bytes as f64 / seconds * 1e-6, seconds / copy_s);
        println!("  {format:<13} {name:<10} {rate} {mb_s:8.1} MB/s  {ratio:5.1} x the time of a copy");
    }
}

fn median(times: &mut [Duration]) -> Duration {
    times.sort_unstable();
    times[times.len() / 2]
}

fn encoded(events: &[Event], format: Format) -> Vec<u8> {
    let mut bytes = Vec::new();
    Encoder::new(format).encode(events, &[], &mut bytes).unwrap();
    bytes
}

/// Rows of a board that blinks at 15 Hz: per row a few squares whose pixels fire in part, and noise between.
fn blinking_board(count: usize) -> Vec<Event> {
    let mut random = Pcg64Mcg::seed_from_u64(7);
    let (mut events, mut t_us, mut on) = (Vec::with_capacity(count + 400), 0, false);
    while events.len() < count {
        (t_us, on) = (t_us + 60_000, !on);
        for _ in 0..1_500 {
            t_us += random.random_range(1..8);
            let (y, x0) = (random.random_range(100_u16..600), random.random_range(300_u16..320));
            let odd = y / 60 % 2;
            for square in (odd..8).step_by(2) {
                let x0 = x0 + square * 60;
                events.extend((x0..x0 + 60).filter(|_| random.random_bool(0.35)).map(|x| Event { t_us, x, y, on }));
            }
            let noise = random.random_range(0..6);
            for _ in 0..noise {
                t_us += random.random_range(0..3);
                let (x, y) = (random.random_range(0..1280), random.random_range(0..720));
                events.push(Event { t_us, x, y, on: random.random() });
            }
        }
    }
    events
}

/// The words of the real recording again and again, each time with its TIME_HIGH words moved on.
fn recording(count: usize) -> Option<(Vec<u8>, usize)> {
    let path = PathBuf::from(std::env::var_os("CELLCAL_DATA")?).join("rosec_codecs_evt3_trigger/stream_as_evt3.raw");
    let file = std::fs::read(path).unwrap();
    let once = &file[Header::parse(&file).unwrap().len_bytes..];
    let highs = || once.as_chunks().0.iter().map(|word| u16::from_le_bytes(*word)).filter(|word| word >> 12 == 8);
    let (first, last) = (highs().next().unwrap() & 0xfff, highs().next_back().unwrap() & 0xfff);
    let (mut events, mut triggers) = (Vec::new(), Vec::new());
    Decoder::new(Format::Evt3).decode(once, &mut events, &mut triggers);
    let times = count.div_ceil(events.len());
    let mut bytes = Vec::with_capacity(times * once.len());
    for time in 0..times as u16 {
        let moved = time.wrapping_mul(last.wrapping_sub(first) + 1);
        for word in once.as_chunks().0 {
            let word = u16::from_le_bytes(*word);
            let is_high = word >> 12 == 8;
            let word = if is_high { 0x8000 | word.wrapping_add(moved) & 0xfff } else { word };
            bytes.extend(word.to_le_bytes());
        }
    }
    (events, triggers) = (Vec::new(), Vec::new());
    Decoder::new(Format::Evt3).decode(&bytes, &mut events, &mut triggers);
    Some((bytes, events.len()))
}
