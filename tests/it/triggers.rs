//! Every way to trigger a capture: images and event windows belong together, and the log shows how.

use std::fmt::Write as _;
use std::path::Path;

use serde_json::Value;

use crate::support::{cellcal, json, stderr, text};

/// The simulated cell with twelve poses, each with `images` images, and this trigger.
fn session(trigger: &str, images: u32) -> Value {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let cell = std::fs::read_to_string(root.join("cells/sim.yaml")).unwrap();
    let before = cell.split("trajectories:").next().unwrap();
    let mut cell = before.replace("  images_per_s: 10\n", &format!("  images_per_s: 10\n  trigger: {trigger}\n"));
    assert!(cell.contains(trigger), "cells/sim.yaml has changed");
    let file = root.join("trajectories/distance-6.yaml");
    write!(cell, "trajectories:\n  - {{file: {}, purpose: intrinsics}}\n", text(&file)).unwrap();
    write!(cell, "images_per_pose: {images}\nsim: {{seed: 5}}\n").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cell.yaml");
    std::fs::write(&path, cell).unwrap();
    let output = cellcal(&["run", text(&path), "--time-scale", "max", "--json", "-o", text(folder.path())]);
    assert!(!output.stdout.is_empty(), "{trigger}: {}", stderr(&output));
    json(&output)
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
