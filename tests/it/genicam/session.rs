//! Whole sessions with a GigE Vision camera that sees the simulated scene, beside the simulated robot and event camera.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

use cellcal::calibration::gates::Status;
use cellcal::cv::codec;
use cellcal::devices::Clock;
use cellcal::devices::genicam;
use cellcal::devices::sim::cell::SimCell;
use cellcal::image::GrayImage;
use cellcal::recording::{About, Entry, FORMAT_VERSION, Kind, Recording, Writer};
use cellcal::runner::setup::{CellTexts, Planned};
use cellcal::runner::solve::{Solved, solve_recording};
use cellcal::runner::{Devices, Live, Nobody, RunOptions, Told};
use cellcal::session::{Command, End, Input, Outcome};
use nalgebra::UnitQuaternion;

use super::fake::{FakeCamera, alone};

/// An arm that moved farther than this during an exposure blurs it, m.
const BLUR_M: f64 = 20e-6;

/// The shipped cell with a GenICam camera, the hand-eye poses alone, and a brisk arm: real time passes.
pub(super) fn cell_text() -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let shipped = include_str!("../../../cells/sim.yaml");
    let without = ["paper-39", "distance-6", "base_distance", "base_vector"];
    let kept = shipped.lines().filter(|line| !without.iter().any(|w| line.contains(w)));
    let trajectories = root.join("trajectories");
    let changes = [
        ("  driver: sim\n  serial: SIM-RGB", "  driver: genicam\n  serial: GVTEST"),
        ("joint_speed_rad_s: 1.05", "joint_speed_rad_s: 2"),
        ("joint_acceleration_rad_s2: 1.4", "joint_acceleration_rad_s2: 3"),
        ("tcp_speed_m_s: 0.25", "tcp_speed_m_s: 0.5"),
        ("tcp_acceleration_m_s2: 0.5", "tcp_acceleration_m_s2: 1.5"),
        ("../trajectories", trajectories.to_str().unwrap()),
    ];
    changes.iter().fold(kept.collect::<Vec<_>>().join("\n"), |text, (from, to)| {
        assert!(text.contains(from), "cells/sim.yaml has changed: {from}");
        text.replacen(from, to, 1)
    })
}

/// What the camera sees: the simulated scene of the last exposure time; gray while the arm moves.
fn scene_painter(sim: &SimCell, exposure_s: f64) -> impl FnMut(&mut [u8]) + Send + 'static {
    let (eye, clock, truth) = (sim.eye(), sim.clock.clone(), sim.controller.truth());
    let mut shown: Option<([f64; 3], UnitQuaternion<f64>, GrayImage)> = None;
    move |pixels: &mut [u8]| {
        // The controller knows where the arm is up to its last cycle.
        let end_s = truth.newest_s().unwrap_or(0.0).min(clock.seconds());
        let at = |s: f64| truth.base_from_flange_at(s).map(|pose| (pose.translation_m(), pose.rotation()));
        let (Some((before, _)), Some((place, turn))) = (at(end_s - exposure_s), at(end_s)) else {
            return pixels.fill(128);
        };
        let apart_m = |a: [f64; 3], b: [f64; 3]| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
        if apart_m(before, place) > BLUR_M {
            return pixels.fill(128);
        }
        let same =
            |(p, t, _): &&([f64; 3], UnitQuaternion<f64>, _)| apart_m(*p, place) < 1e-6 && t.angle_to(&turn) < 1e-5;
        if shown.as_ref().filter(same).is_none() {
            let image = eye(end_s - exposure_s, end_s).unwrap();
            shown = Some((place, turn, image));
        }
        if let Some((_, _, image)) = &shown {
            pixels[..image.pixels.len()].copy_from_slice(&image.pixels);
        }
    }
}

struct Ran {
    outcome: Outcome,
    solved: Solved,
    recording: Recording,
    notes: Vec<String>,
    sim: SimCell,
    _folder: tempfile::TempDir,
}

/// Runs a session as the program does, then solves it; `hear` is told each command with the camera.
fn run(mut hear: impl FnMut(&Command, &Mutex<Option<FakeCamera>>)) -> Ran {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (file, hand_eye) = ("trajectories/hand-eye-22.yaml", root.join("trajectories/hand-eye-22.yaml"));
    let name = format!("{}/{file}", root.display());
    let texts = CellTexts {
        cell: ("cell.yaml".into(), cell_text()),
        folder: PathBuf::new(),
        trajectories: vec![(name, std::fs::read_to_string(hand_eye).unwrap())],
        intrinsics: None,
        urdf: None,
    };
    let Planned { cell, plan: _, setup } = texts.plan_with(&RunOptions::default()).unwrap();
    let sim = SimCell::start(&cell, None, 1.0).unwrap();
    let rgb = cell.rgb.as_ref().unwrap();
    let fake = Mutex::new(Some(FakeCamera::new("GVTEST", scene_painter(&sim, rgb.exposure_s))));
    let clock: Arc<dyn Clock> = Arc::new(sim.clock.clone());
    let frame = sim.wire(genicam::open(rgb, Arc::clone(&clock)).unwrap());
    let devices = Devices { robot: sim.robot().unwrap(), frame: Some(frame), event: sim.event(), clock };

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.mcap");
    let about = About {
        format_version: FORMAT_VERSION,
        kind: Kind::Live,
        session_id: "genicam".into(),
        program_version: env!("CARGO_PKG_VERSION").into(),
        facts: BTreeMap::new(),
    };
    let writer = Writer::create(&path, &about, &texts.attachments()).unwrap();
    let (interrupted, mut operator, mut notes) = (AtomicBool::new(false), Nobody, Vec::new());
    let mut told = |told: Told<'_>| match told {
        Told::Command(command) => hear(command, &fake),
        Told::Note(note) => notes.push(note),
    };
    let timing = (cell.images_per_pose, setup.image_period_s);
    let live = Live::new(devices, writer, timing, &interrupted, &mut operator, &mut told).unwrap();
    let mut live = live.expecting(&cell.display);
    let outcome = setup.machine.clone().run(&mut live).unwrap();
    let path = live.into_recording().unwrap();
    let solved = solve_recording(&path, &mut |_| Ok(Vec::new()), None, &|_, _| {}).unwrap();
    Ran { outcome, solved, recording: Recording::open(&path).unwrap(), notes, sim, _folder: folder }
}

#[test]
fn the_main_job_passes_with_a_gige_vision_camera() {
    alone("session::the_main_job_passes_with_a_gige_vision_camera", || {
        let Ran { outcome, solved, recording, notes, sim, _folder } = run(|_, _| {});
        assert_eq!(outcome.end, End::Complete);
        assert!(notes.is_empty(), "{notes:?}");
        let result = solved.result;
        assert_eq!(result.verdict.status, Status::Pass, "{:#?}", result.verdict);
        // The images are those of the camera, one a pose, in its size.
        let images = recording.entries.iter().filter_map(|entry| match entry {
            Entry::Image(_, png) => Some(codec::decode_gray(png).unwrap()),
            Entry::Input(..) | Entry::Command(_) | Entry::Events(_) => None,
        });
        let sizes: Vec<_> = images.map(|image| [image.width, image.height]).collect();
        assert!(sizes.len() >= 22 && sizes.iter().all(|size| *size == [1380, 780]), "{sizes:?}");
        // Each image has the events of its own exposure.
        let json = serde_json::to_value(&result).unwrap();
        assert!(json["timing"]["windows"][0].as_u64().unwrap() >= 22, "{:#}", json["timing"]);
        assert_eq!(json["timing"]["windows"][0], json["timing"]["windows"][1], "{:#}", json["timing"]);
        // As in the session whose frame camera is simulated too.
        let found = result.hand_eye.unwrap().base_from_camera.unwrap();
        let truth = sim.truth.mount_of_camera;
        let off_m = (found.iso().translation.vector - truth.iso().translation.vector).norm();
        eprintln!("hand-eye: {:.2} mm from the truth", off_m * 1e3);
        assert!(off_m < 0.015, "the camera is {off_m} m from where it is");
        let rgb = sim.truth.rgb.unwrap();
        let fx = crate::support::number(&json, "/cameras/rgb/fx");
        assert!((fx / rgb.fx - 1.0).abs() < 0.01, "{fx} for {}", rgb.fx);
    });
}

#[test]
fn a_session_whose_camera_disappears_keeps_what_was_captured() {
    alone("session::a_session_whose_camera_disappears_keeps_what_was_captured", || {
        let Ran { outcome, recording, .. } = run(|command, fake| {
            if matches!(command, Command::Capture { pose: 3, attempt: 0 }) {
                *fake.lock().unwrap() = None;
            }
        });
        // Three poses in a row are tried, then somebody has to look.
        let End::OperatorNeeded(why) = &outcome.end else { panic!("{:?}", outcome.end) };
        assert!(why.contains("the rgb camera failed at 3 poses in a row"), "{why}");
        assert!(why.contains("does not answer any more"), "{why}");
        let captured = recording.entries.iter().filter(|e| matches!(e, Entry::Input(_, Input::Captured(_)))).count();
        assert!((3..=4).contains(&captured), "{captured} captures are kept");
        let skipped: Vec<_> = outcome.poses.iter().filter_map(|pose| pose.skipped.as_deref()).collect();
        assert!(skipped.iter().filter(|why| why.contains("rgb camera")).count() >= 2, "{skipped:?}");
    });
}
