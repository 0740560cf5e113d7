//! The layers of `src/lib.rs`, enforced: a module uses only modules above it.

use std::fs;
use std::path::{Path, PathBuf};

/// Top to bottom. A module that is missing here fails the test.
const LAYERS: [&str; 17] = [
    "image",
    "geometry",
    "board",
    "events",
    "cv",
    "vision",
    "calibration",
    "config",
    "plan",
    "session",
    "devices",
    "recording",
    "runner",
    "report",
    "daemon",
    "study",
    "cli",
];

/// What modules above `devices` may not name.
const IMPURE: [&str; 3] = ["std::fs", "std::net", "tokio::"];

fn level(module: &str) -> usize {
    let found = LAYERS.iter().position(|layer| *layer == module);
    found.unwrap_or_else(|| panic!("add `{module}` to LAYERS here, and to the map in src/lib.rs"))
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

fn sources(path: &Path) -> Vec<(PathBuf, String)> {
    if path.is_dir() {
        let entries = fs::read_dir(path).unwrap().map(|e| e.unwrap().path());
        return entries.flat_map(|p| sources(&p)).collect();
    }
    let of_tests = path.components().any(|c| ["tests", "tests.rs", "fixture.rs"].iter().any(|t| c.as_os_str() == *t));
    if of_tests {
        return Vec::new();
    }
    let is_rust = path.extension().is_some_and(|e| e == "rs");
    if is_rust { vec![(path.into(), fs::read_to_string(path).unwrap())] } else { Vec::new() }
}

fn modules() -> Vec<(String, PathBuf)> {
    let paths = fs::read_dir(root()).unwrap().map(|e| e.unwrap().path());
    let named = paths.map(|p| (p.file_stem().unwrap().to_str().unwrap().to_owned(), p));
    named.filter(|(name, _)| !["lib", "main"].contains(&name.as_str())).collect()
}

/// The text before the tests of a file: tests may look down.
fn without_tests(text: &str) -> &str {
    text.split("#[cfg(test)]\nmod tests").next().unwrap_or(text)
}

#[test]
fn modules_use_only_modules_above_them() {
    for (module, path) in modules() {
        for (file, text) in sources(&path) {
            for used in without_tests(&text).split("crate::").skip(1) {
                let used: String = used.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                let fine = used == module || level(&used) < level(&module);
                assert!(fine, "{}: `{module}` may not use `{used}`, which is below it", file.display());
            }
        }
    }
}

#[test]
fn everything_above_devices_is_pure() {
    for (module, path) in modules().iter().filter(|(m, _)| level(m) < level("devices")) {
        for (file, text) in sources(path) {
            for word in IMPURE {
                assert!(!without_tests(&text).contains(word), "{}: `{module}` may not name {word}", file.display());
            }
        }
    }
}

#[test]
fn only_cv_names_opencv() {
    for (module, path) in modules().iter().filter(|(m, _)| m != "cv") {
        for (file, text) in sources(path) {
            assert!(!text.contains("opencv::"), "{}: only cv may name opencv, not `{module}`", file.display());
        }
    }
}

#[test]
fn the_map_names_every_module() {
    let map = fs::read_to_string(root().join("lib.rs")).unwrap();
    for (module, _) in modules() {
        assert!(map.contains(&format!("`{module}")), "src/lib.rs does not explain `{module}`");
    }
}

#[test]
fn the_driver_never_unlocks_releases_or_starts_anything() {
    for (file, text) in sources(&root().join("devices/ur")) {
        for word in ["unlock", "brake release", "power on", "restart safety", "\"play", "set_tcp", "set_payload("] {
            let said = without_tests(&text).contains(word);
            assert!(!said, "{}: `{word}` is for the operator only", file.display());
        }
    }
    let script = fs::read_to_string(root().join("devices/ur/motion.script")).unwrap();
    assert!(!["set_tcp(", "set_payload(", "unlock"].iter().any(|word| script.contains(word)));
}
