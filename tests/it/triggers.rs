//! Every way to trigger a capture: images and event windows belong together, and the log shows how.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use cellcal::devices::sim::cell::SimCell;
use cellcal::events::sync::ClockMap;
use cellcal::recording::{Entry, Recording};
use cellcal::session::Input;
use serde_json::Value;

use crate::support::{cellcal, json, stderr, text};

/// The simulated cell with twelve poses, each with `images` images, and this trigger.
fn session(trigger: &str, images: u32) -> Value {
    let folder = tempfile::tempdir().unwrap();
    run(&cell(folder.path(), trigger, images)).0
}

fn cell(folder: &Path, trigger: &str, images: u32) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let cell = std::fs::read_to_string(root.join("cells/sim.yaml")).unwrap();
    let before = cell.split("trajectories:").next().unwrap();
    let mut cell = before.replace("  images_per_s: 10\n", &format!("  images_per_s: 10\n  trigger: {trigger}\n"));
    assert!(cell.contains(trigger), "cells/sim.yaml has changed");
    let file = root.join("trajectories/distance-6.yaml");
    write!(cell, "trajectories:\n  - {{file: {}, purpose: intrinsics}}\n", text(&file)).unwrap();
    write!(cell, "images_per_pose: {images}\nsim: {{seed: 5}}\n").unwrap();
    let path = folder.join("cell.yaml");
    std::fs::write(&path, cell).unwrap();
    path
}

/// The result of a session, and its recording, which is written beside the cell.
fn run(cell: &Path) -> (Value, PathBuf) {
    let folder = cell.parent().unwrap();
    let output = cellcal(&["run", text(cell), "--time-scale", "max", "--json", "-o", text(folder)]);
    assert!(!output.stdout.is_empty(), "{}: {}", cell.display(), stderr(&output));
    let files = std::fs::read_dir(folder.join("sim")).unwrap().map(|e| e.unwrap().path());
    (json(&output), files.filter(|p| p.extension().is_some_and(|e| e == "mcap")).max().unwrap())
}

/// Of the simulated event camera, s.
const SMALLEST_LATENCY_S: f64 = 0.0015;

fn check_corners(trigger: &str, result: &Value) {
    for camera in ["rgb", "event"] {
        let rate = result["cameras"][camera]["corner_rate"].as_f64().unwrap();
        assert!(rate > 0.8, "{trigger}: the {camera} camera found {rate} of the corners");
    }
}

fn check(trigger: &str, images: u32, exposures: u64) {
    let result = session(trigger, images);
    let timing = &result["timing"];
    assert_eq!(timing["windows"], serde_json::json!([exposures, exposures]), "{trigger}: {timing:#}");
    assert_eq!(timing["notes"], Value::Null, "{trigger}: {timing:#}");
    // The sensor counts microseconds.
    assert!(timing["residual_rms_s"].as_f64().unwrap() < 2e-6, "{trigger}: {timing:#}");
    assert_eq!(timing["paired_by"], "trigger");
    // Some 200 packets are late by 1.5 ms and up to 4.5 more: of each half the fastest is 45 us above the bound, and
    // the line through two of those is off by a few times that.
    let latency_s = timing["arrival_latency_s"].as_f64().unwrap();
    assert!((latency_s - SMALLEST_LATENCY_S).abs() < 0.0003, "{trigger}: {timing:#}");
    check_corners(trigger, &result);
}

#[test]
fn without_the_wire_events_are_found_by_their_arrival_and_the_report_says_so() {
    let wired = session("free_run", 2);
    let result = session("free_run\n  wired: false", 2);
    let timing = &result["timing"];
    assert_eq!(timing["paired_by"], "arrival");
    assert!(timing["notes"][0].as_str().unwrap().starts_with("no trigger wire"), "{timing:#}");
    // The same clocks in both sessions; the arrival is late by the smallest latency.
    let late_s = timing["offset_s"].as_f64().unwrap() - wired["timing"]["offset_s"].as_f64().unwrap();
    let drift_ppm = timing["drift_ppm"].as_f64().unwrap() - wired["timing"]["drift_ppm"].as_f64().unwrap();
    assert!(drift_ppm.abs() < 20.0, "{timing:#}");
    let offset_of_drift_s = drift_ppm * 1e-6 * 1e3;
    assert!((late_s - SMALLEST_LATENCY_S).abs() < 0.0005 + offset_of_drift_s.abs(), "{late_s} {timing:#}");
    check_corners("unwired", &result);
}

#[test]
fn a_free_running_camera_gives_the_time() {
    check("free_run", 2, 24);
}

#[test]
fn a_command_begins_each_exposure_and_one_more_ends_the_last_window() {
    check("software", 2, 36);
}

#[test]
fn a_pulse_of_the_robot_begins_each_exposure() {
    check("{robot_output: 3}", 1, 24);
}

/// The map that a result has, the true one, and what the map was made of.
struct Clocks {
    found: ClockMap,
    truth: ClockMap,
    /// Starts of exposures, and arrivals of packets, s since the session began.
    starts_s: Vec<f64>,
    arrivals_s: Vec<f64>,
}

fn session_clocks(trigger: &str) -> Clocks {
    let folder = tempfile::tempdir().unwrap();
    let path = cell(folder.path(), trigger, 2);
    let (result, recording) = run(&path);
    let number = |key: &str| result["timing"][key].as_f64().unwrap();
    let found = ClockMap { offset_s: number("offset_s"), ppm: number("drift_ppm") };
    let parsed = cellcal::config::parse_cell(&std::fs::read_to_string(&path).unwrap(), "cell.yaml").unwrap();
    let truth = SimCell::start(&parsed, None, f64::INFINITY).unwrap().truth.host_from_event_clock;
    let (mut starts_s, mut arrivals_s) = (Vec::new(), Vec::new());
    for entry in Recording::open(&recording).unwrap().entries {
        match entry {
            Entry::Input(_, Input::Captured(captured)) => {
                starts_s.extend(captured.exposures.iter().filter(|e| !e.closing).map(|e| e.start_s));
            }
            Entry::Events(packet) => arrivals_s.push(packet.stamp_ns as f64 * 1e-9),
            Entry::Input(..) | Entry::Command(_) | Entry::Image(..) => {}
        }
    }
    Clocks { found, truth, starts_s, arrivals_s }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// By how much the found map is later than the true one where the session's time is `at_s`, s.
fn late_s(clocks: &Clocks, at_s: f64) -> f64 {
    clocks.found.host_s_from_sensor_us(clocks.truth.sensor_us_from_host_s(at_s)) - at_s
}

#[test]
fn the_wire_gives_the_clock_of_the_sensor_as_well_as_its_microseconds_allow() {
    for trigger in ["free_run", "software"] {
        let clocks = session_clocks(trigger);
        let (count, middle_s) = (clocks.starts_s.len() as f64, mean(&clocks.starts_s));
        let square_s2: f64 = clocks.starts_s.iter().map(|s| (s - middle_s).powi(2)).sum();
        // An edge is rounded to whole microseconds of the host (in step with the frames, so alike for all where the
        // camera runs freely) and then of the sensor: up to 0.5 us for all, and evenly spread over 1 us twice.
        let (common_s, each_s) = (0.5e-6, (2.0_f64 / 12.0).sqrt() * 1e-6);
        let sigma_ppm = each_s / square_s2.sqrt() * 1e6;
        let sigma_s = each_s / count.sqrt();
        // The true time of the sensor at the middle is rounded by `sensor_us_from_host_s`, 0.5 us.
        let (late_s, drift_ppm) = (late_s(&clocks, middle_s), clocks.found.ppm - clocks.truth.ppm);
        let offset_s = clocks.found.offset_s - clocks.truth.offset_s;
        eprintln!(
            "{trigger}: {count} edges over {:.1} s; true offset {:.6} s and drift {:.3} ppm; found offset {:+.2} us, \
             drift {drift_ppm:+.4} ppm (sigma {sigma_ppm:.4}), middle {:+.2} us (sigma {:.2})",
            clocks.starts_s.last().unwrap() - clocks.starts_s[0],
            clocks.truth.offset_s,
            clocks.truth.ppm,
            offset_s * 1e6,
            late_s * 1e6,
            sigma_s * 1e6
        );
        assert!(drift_ppm.abs() < 5.0 * sigma_ppm, "{trigger}");
        assert!(late_s.abs() < common_s + 0.5e-6 + 5.0 * sigma_s, "{trigger}");
        // At sensor time 0, seconds before the session, the drift counts too.
        let before_s = middle_s - clocks.truth.offset_s;
        assert!(offset_s.abs() < common_s + 5.0 * sigma_s.hypot(sigma_ppm * 1e-6 * before_s), "{trigger}");
    }
}

#[test]
fn without_the_wire_the_clock_is_late_by_the_fastest_packet() {
    let clocks = session_clocks("free_run\n  wired: false");
    // Simulated time runs ahead for minutes before the program holds it. Packets on both sides of such a gap are no two
    // halves of a session: only the time without it tells the drift, and the middle may lie outside the two packets.
    let steps_s = clocks.arrivals_s.windows(2).map(|pair| pair[1] - pair[0]);
    let span_s: f64 = steps_s.filter(|step_s| *step_s < 10.0).sum();
    let (count, middle_s) = (clocks.arrivals_s.len() as f64, mean(&clocks.arrivals_s));
    // The line rests on one packet before the middle and one after it, each the fastest of its half but for the slope:
    // of n/2 latencies over 4.5 ms the smallest is 9 ms / n above the smallest possible, more than eight times that
    // once in 3000. The last event of a packet is before its end by what passes between two events.
    let excess_s = 8.0 * 9e-3 / count + 0.1e-3;
    let (late_s, drift_ppm) = (late_s(&clocks, middle_s), clocks.found.ppm - clocks.truth.ppm);
    eprintln!(
        "unwired: {count} packets over {span_s:.1} s; found offset {:+.3} ms, drift {drift_ppm:+.2} ppm, middle {:+.3} ms",
        (clocks.found.offset_s - clocks.truth.offset_s) * 1e3,
        late_s * 1e3
    );
    assert!((late_s - SMALLEST_LATENCY_S).abs() < excess_s, "{late_s} {excess_s}");
    // The two packets are a half of the session apart, give or take.
    assert!(drift_ppm.abs() < excess_s / (0.25 * span_s) * 1e6, "{drift_ppm}");
}
