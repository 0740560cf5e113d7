//! `event.record: always`: every event of a session is there, and the result is that of its captures alone.

use std::path::{Path, PathBuf};

use cellcal::recording::{Attachment, Entry, EventPacket, Recording, Writer};
use cellcal::session::{Command, Input, Stamp};
use serde_json::Value;

use crate::bench;
use crate::support::{cellcal, json, stderr, text};

/// What is kept from before a capture, ns.
const PRE_ROLL_NS: u64 = 200_000_000;

/// The small cell, recorded always.
fn session(folder: &Path, wired: bool) -> (Value, PathBuf) {
    let texts = bench::texts(bench::THREE_POSES);
    let cell = texts.cell.1.replacen("\nevent:\n", "\nevent:\n  record: always\n", 1);
    let cell = cell.replacen("\nrgb:\n", &format!("\nrgb:\n  wired: {wired}\n"), 1);
    assert!(cell.contains("record: always") && cell.contains("wired"), "cells/sim.yaml has changed");
    std::fs::write(folder.join("cell.yaml"), cell).unwrap();
    std::fs::write(folder.join("three.yaml"), bench::THREE_POSES).unwrap();
    let (cell, sessions) = (folder.join("cell.yaml"), folder.join("sessions"));
    let output = cellcal(&["run", text(&cell), "--time-scale", "max", "--json", "-o", text(&sessions)]);
    assert!(!output.stdout.is_empty(), "{}", stderr(&output));
    let files = std::fs::read_dir(sessions.join("sim")).unwrap().map(|e| e.unwrap().path());
    let recording = files.filter(|p| p.extension().is_some_and(|e| e == "mcap")).max().unwrap();
    (json(&output), recording)
}

fn packets(recording: &Recording) -> Vec<&EventPacket> {
    let entries = recording.entries.iter();
    entries.filter_map(|entry| if let Entry::Events(packet) = entry { Some(packet) } else { None }).collect()
}

/// The same session as it would have been recorded around its captures.
fn captures_only(recording: &Recording, path: &Path) -> PathBuf {
    let data = |name: &str| recording.text(name).unwrap().as_bytes().to_vec();
    let names = recording.attachment_names().map(str::to_owned);
    let attachments: Vec<_> = names.map(|name| Attachment { data: data(&name), name }).collect();
    let mut writer = Writer::create(path, &recording.about, &attachments).unwrap();
    let (mut held, mut last): (Vec<&EventPacket>, _) = (Vec::new(), Stamp::default());
    for entry in &recording.entries {
        match entry {
            Entry::Events(packet) => held.push(packet),
            Entry::Image(at, png) => writer.image(*at, png, "png").unwrap(),
            Entry::Command(command) => {
                if matches!(command, Command::Capture { .. } | Command::Watch) {
                    held.retain(|packet| packet.stamp_ns + PRE_ROLL_NS >= last.0);
                }
                writer.command(last, command).unwrap();
            }
            Entry::Input(at, input) => {
                if matches!(input, Input::Captured(_) | Input::Watched(_)) {
                    for packet in held.drain(..) {
                        writer.events(Stamp(packet.stamp_ns), packet).unwrap();
                    }
                }
                last = *at;
                writer.input(*at, input).unwrap();
            }
        }
    }
    writer.finish().unwrap()
}

fn replayed(path: &Path) -> Value {
    let output = cellcal(&["replay", text(path), "--json"]);
    assert!(!output.stdout.is_empty(), "{}", stderr(&output));
    json(&output)
}

#[test]
fn the_result_is_that_of_the_captures_alone() {
    for wired in [true, false] {
        let folder = tempfile::tempdir().unwrap();
        let (mut result, path) = session(folder.path(), wired);
        assert_eq!(replayed(&path), result, "wired: {wired}");
        assert_eq!(result["timing"]["windows"], serde_json::json!([3, 3]), "{:#}", result["timing"]);
        let recording = Recording::open(&path).unwrap();
        let short = captures_only(&recording, &folder.path().join("captures.mcap"));
        assert!(packets(&Recording::open(&short).unwrap()).len() < packets(&recording).len() / 2);
        let mut captures = replayed(&short);
        if wired {
            // Edges say which events belong to an exposure; only their second witness heard more.
            assert!(result["timing"]["arrival_latency_s"].is_number(), "{result:#}");
            for of in [&mut result, &mut captures] {
                // Three captures alone may have too few packets for it.
                let latency_s = of["timing"].as_object_mut().unwrap().remove("arrival_latency_s");
                let within = |s: &Value| s.as_f64().is_some_and(|s| (0.0015..0.006).contains(&s));
                assert!(latency_s.as_ref().is_none_or(within), "{latency_s:?}");
                // The files differ.
                assert!(of["provenance"]["sha256"]["recording"].take().is_string());
            }
            assert_eq!(captures, result);
            continue;
        }
        // Without the wire the arrivals are all there is, and more of them say more.
        let late_s = |result: &Value| result["timing"]["offset_s"].as_f64().unwrap();
        assert!((late_s(&result) - late_s(&captures)).abs() < 0.002, "{result:#} {captures:#}");
        for camera in ["rgb", "event"] {
            // Three poses solve no camera; what it saw at each is told all the same.
            let corners = |of: &Value| -> f64 {
                let of_pose = |pose: &Value| pose["cameras"][camera]["corners"].as_f64().unwrap();
                of["poses"].as_array().unwrap().iter().map(of_pose).sum()
            };
            assert!(corners(&result) > 0.0, "{camera}: {result:#}");
            assert!((corners(&result) - corners(&captures)).abs() < 0.05 * 72.0, "{camera}: {result:#} {captures:#}");
        }
    }
}

#[test]
fn nothing_is_missing_and_nothing_twice_from_the_first_sample_to_the_last() {
    let folder = tempfile::tempdir().unwrap();
    let (_, path) = session(folder.path(), true);
    let recording = Recording::open(&path).unwrap();
    let packets = packets(&recording);
    let times_ns: Vec<_> = packets.iter().map(|packet| packet.time_base_ns).collect();
    // Transfers of 20 ms; the last one before a capture and the first one after it share theirs.
    for pair in times_ns.windows(2) {
        assert!(pair[1] > pair[0], "twice, or in another order: {pair:?}");
        assert!(pair[1] - pair[0] < 45_000_000, "a hole: {pair:?}");
    }
    let stamps: Vec<_> = recording
        .entries
        .iter()
        .filter_map(|entry| if let Entry::Input(at, Input::Robot(_)) = entry { Some(at.0) } else { None })
        .collect();
    let (first, last) = (packets.first().unwrap().stamp_ns, packets.last().unwrap().stamp_ns);
    // It is begun with the first sample and asked every 0.1 s; the last transfers are on their way at the end.
    assert!(first < stamps[0] + 250_000_000, "{first} {}", stamps[0]);
    assert!(last + 60_000_000 > *stamps.last().unwrap(), "{last} {:?}", stamps.last());
    let bytes: usize = packets.iter().map(|packet| packet.events.len()).sum();
    eprintln!("{} bytes in {:.1} s", bytes, (last - first) as f64 * 1e-9);
}
