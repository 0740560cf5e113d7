//! A session without a robot: captures only while the display is held still, stereo against the truth.

use std::path::Path;

use cellcal::config::parse_cell;
use cellcal::devices::sim::hand::SimHand;
use cellcal::recording::{Entry, Recording};
use cellcal::session::Input;

use crate::support::{cellcal, expect, json, rotation, stderr, text, vector};

/// Times of the simulated operator, s: a move, and the pause after it.
const MOVE_S: f64 = 1.2;
const LEG_S: f64 = 3.2;
const POSES: usize = 9;

fn cell_text() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("cells/handheld.yaml");
    std::fs::read_to_string(path).unwrap().replace("poses: 30", &format!("poses: {POSES}"))
}

#[test]
fn captures_are_taken_in_pauses_only_and_stereo_is_true() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("handheld.yaml");
    std::fs::write(&file, cell_text()).unwrap();
    let output = expect(0, &["run", text(&file), "--time-scale", "max", "--json", "-o", text(folder.path())]);
    let result = json(&output);
    assert_eq!(result["verdict"]["status"], "pass", "{:#}", result["verdict"]);
    assert!(result.get("hand_eye").is_none(), "there is no arm");

    let mut sessions = std::fs::read_dir(folder.path().join("handheld")).unwrap().map(|e| e.unwrap().path());
    let session = sessions.find(|p| p.extension().is_some_and(|e| e == "mcap")).unwrap();
    let recording = Recording::from_bytes(&session, &std::fs::read(&session).unwrap()).unwrap();
    let captures = recording.entries.iter().filter_map(|entry| match entry {
        Entry::Input(_, Input::Captured(captured)) => Some(captured),
        _ => None,
    });
    let exposures: Vec<_> = captures.flat_map(|captured| captured.exposures.iter()).collect();
    assert!(exposures.len() >= POSES);
    for exposure in exposures {
        // The move ends like a parabola: in its last 5 % the board goes 0.7 % of the way, less than a pixel a look.
        let into_s = exposure.start_s.rem_euclid(LEG_S);
        assert!(into_s > 0.9 * MOVE_S, "an exposure began {into_s:.2} s into a move");
    }

    let cell = parse_cell(&cell_text(), "handheld.yaml").unwrap();
    let truth = SimHand::start(&cell, None, f64::INFINITY).unwrap().truth;
    // With the paper's corners and 39 poses an independent model is 2.6 mm off (median), and published handheld
    // rotations scatter by 0.285 deg; three times that, and the square root of 39 / 9 poses.
    let off_m = (vector(&result, "/stereo/event_from_rgb/translation_m")
        - truth.event_from_rgb.iso().translation.vector)
        .norm();
    eprintln!("stereo: {:.2} mm from the truth", off_m * 1e3);
    let wide = 3.0 * (39.0 / POSES as f64).sqrt();
    assert!(off_m < wide * 2.6e-3, "{off_m}");
    let turned = rotation(&result, "/stereo/event_from_rgb/quaternion_xyzw").angle_to(&truth.event_from_rgb.rotation());
    assert!(turned.to_degrees() < wide * 0.285, "{}", turned.to_degrees());

    let again = expect(0, &["replay", text(&session), "--json"]);
    assert!(again.stdout == output.stdout, "the replay differs from the live session");
    let resumed = cellcal(&["resume", text(&session)]);
    assert!(stderr(&resumed).contains("without a robot"), "{}", stderr(&resumed));
}

#[test]
fn what_needs_an_arm_is_refused_without_one() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |change: [&str; 2], line: &str| {
        let file = folder.path().join("cell.yaml");
        let changed = cell_text().replacen(change[0], change[1], 1);
        assert_ne!(changed, cell_text(), "{change:?}");
        std::fs::write(&file, changed).unwrap();
        let output = cellcal(&["run", text(&file), "--time-scale", "max", "-o", text(folder.path())]);
        assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
        assert!(stderr(&output).contains(line), "{}", stderr(&output));
    };
    refused(["robot: none", "robot: nobody"], "a map with the keys of an arm, or `none`");
    refused(["robot: none", "robot: none\ntrajectories: [{file: a.yaml, purpose: intrinsics}]"], "needs an arm");
    refused(["  images_per_s: 10", "  images_per_s: 10\n  trigger: {robot_output: 1}"], "`robot: none`");
    refused(
        ["  event_from_rgb:", "  base_from_camera: {xyz_mm: [0, 0, 1], rotvec_deg: [0, 0, 0]}\n  event_from_rgb:"],
        "does not go with",
    );
    let rehearsal = cellcal(&["run", "cells/handheld.yaml", "--rehearse"]);
    assert_eq!(rehearsal.status.code(), Some(2));
}
