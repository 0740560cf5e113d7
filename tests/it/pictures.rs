//! Frame cameras that are files: a folder of images and a video, through whole sessions and by themselves.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use cellcal::config::parse_cell;
use cellcal::devices::pictures::Pictures;
use cellcal::devices::{Clock, FrameCamera as _};
use cellcal::recording::{Entry, Recording};
use cellcal::session::Stamp;
use serde_json::Value;

use crate::bench;
use crate::support::{cellcal, expect, json, stderr, text};

/// The simulated cell with the twelve distance poses for intrinsics, and these words for its frame camera.
fn cell(folder: &Path, driver: &str) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let shipped = std::fs::read_to_string(root.join("cells/sim.yaml")).unwrap();
    let before = shipped.split("trajectories:").next().unwrap();
    let mut cell = before.replacen("  driver: sim\n  serial: SIM-RGB", &format!("  {driver}"), 1);
    assert!(cell.contains(driver), "cells/sim.yaml has changed");
    let file = root.join("trajectories/distance-6.yaml");
    // The paper solves each camera by itself: the same images give the same camera, whatever the events.
    cell.push_str("settings: {method: paper}\n");
    write!(cell, "trajectories:\n  - {{file: {}, purpose: intrinsics}}\nsim: {{seed: 5}}\n", text(&file)).unwrap();
    let path = folder.join("cell.yaml");
    std::fs::write(&path, cell).unwrap();
    path
}

fn session(folder: &Path, driver: &str) -> (Value, PathBuf) {
    let (cell, sessions) = (cell(folder, driver), folder.join("sessions"));
    let output = cellcal(&["run", text(&cell), "--time-scale", "max", "--json", "-o", text(&sessions)]);
    assert!(!output.stdout.is_empty(), "{driver}: {}", stderr(&output));
    let files = std::fs::read_dir(sessions.join("sim")).unwrap().map(|e| e.unwrap().path());
    let recording = files.filter(|p| p.extension().is_some_and(|e| e == "mcap")).max().unwrap();
    (json(&output), recording)
}

fn images(recording: &Path) -> Vec<Vec<u8>> {
    let entries = Recording::open(recording).unwrap().entries.into_iter();
    let png = entries.filter_map(|entry| if let Entry::Image(_, png) = entry { Some(png) } else { None });
    png.collect()
}

#[test]
fn the_images_of_a_folder_take_the_place_of_the_camera() {
    let first = tempfile::tempdir().unwrap();
    let (simulated, recording) = session(first.path(), "driver: sim");
    let taken = images(&recording);
    assert_eq!(taken.len(), 12);
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("images")).unwrap();
    for (i, png) in taken.iter().enumerate() {
        // Without leading zeros: 10 comes after 9.
        std::fs::write(folder.path().join(format!("images/pose {}.png", i + 1)), png).unwrap();
    }
    std::fs::write(folder.path().join("images/notes.txt"), "no image").unwrap();
    let (shown, again) = session(folder.path(), "driver: folder\n  source: images");
    assert_eq!(images(&again), taken, "the images are those of the folder, in order");
    assert_eq!(shown["timing"]["windows"], serde_json::json!([12, 12]), "{:#}", shown["timing"]);
    for key in ["fx", "rms_px"] {
        assert_eq!(
            shown["cameras"]["rgb"][key], simulated["cameras"]["rgb"][key],
            "{key}: the same images of the same poses"
        );
    }
    assert!(shown["cameras"]["event"]["corner_rate"].as_f64().unwrap() > 0.8, "{:#}", shown["cameras"]["event"]);
}

#[test]
fn what_is_wrong_with_a_source_is_said_before_anything_moves() {
    let folder = tempfile::tempdir().unwrap();
    let sessions = folder.path().join("sessions");
    let refused = |driver: &str| {
        let cell = cell(folder.path(), driver);
        stderr(&expect(6, &["run", text(&cell), "--time-scale", "max", "-o", text(&sessions)]))
    };
    let said = refused("driver: folder\n  source: nowhere");
    assert!(
        said.contains("nowhere: No such file or directory") && said.contains("relative to the cell file"),
        "{said}"
    );
    std::fs::create_dir(folder.path().join("images")).unwrap();
    assert!(refused("driver: folder\n  source: images").contains("no images; PNG, JPEG, BMP and TIFF are read"));
    std::fs::write(folder.path().join("images/1.png"), "no image").unwrap();
    assert!(refused("driver: folder\n  source: images").contains("not a readable image"));
    let small = cellcal::image::GrayImage::filled(640, 480, 9);
    std::fs::write(folder.path().join("images/1.png"), cellcal::cv::codec::encode_png(&small).unwrap()).unwrap();
    let said = refused("driver: folder\n  source: images");
    assert!(said.contains("is 640x480; the cell says rgb.width 1380 and rgb.height 780"), "{said}");
    assert!(refused("driver: video\n  source: images/1.txt").contains("No such file or directory"));
    std::fs::write(folder.path().join("clip.mp4"), "no video").unwrap();
    assert!(refused("driver: video\n  source: clip.mp4").contains("not a video file that can be read"));
    assert!(!sessions.exists(), "a session that never began is recorded");

    let cell = cell(folder.path(), "driver: v4l2\n  source: /dev/video987");
    let said = stderr(&expect(6, &["run", text(&cell), "-o", text(&sessions)]));
    assert!(said.contains("/dev/video987: no camera that Video4Linux can open"), "{said}");
}

#[test]
fn a_session_is_resumed_with_the_images_beside_its_cell_file() {
    let folder = tempfile::tempdir().unwrap();
    let shipped = bench::texts(bench::THREE_POSES).cell.1;
    let cell = shipped.replacen("  driver: sim\n  serial: SIM-RGB", "  driver: folder\n  source: images", 1);
    assert!(cell.contains("source: images"), "cells/sim.yaml has changed");
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("cell.yaml"), cell).unwrap();
    std::fs::write(at("three.yaml"), bench::THREE_POSES).unwrap();
    std::fs::create_dir(at("images")).unwrap();
    let plain = cellcal::cv::codec::encode_png(&cellcal::image::GrayImage::filled(1380, 780, 90)).unwrap();
    (1..=3).for_each(|i| std::fs::write(at(&format!("images/{i}.png")), &plain).unwrap());
    let (cell, sessions) = (at("cell.yaml"), at("elsewhere"));
    let run = ["run", text(&cell), "--time-scale", "max", "-o", text(&sessions)];
    let stopped = stderr(&expect(8, &[&run[..], &["--sim-fault", "protective_stop@move:3"]].concat()));
    assert!(stopped.contains(&format!(" --cell {}", cell.display())), "{stopped}");
    let newest = || {
        let files = std::fs::read_dir(sessions.join("sim")).unwrap().map(|e| e.unwrap().path());
        files.filter(|p| p.extension().is_some_and(|e| e == "mcap")).max_by_key(|p| p.as_os_str().len()).unwrap()
    };
    let (session, resume) = (newest(), "resume");
    let refused = stderr(&expect(2, &[resume, text(&session), "--time-scale", "max"]));
    assert!(
        refused.contains("rgb.source is `images`, relative to the cell file; name that file with --cell"),
        "{refused}"
    );
    // Plain gray has no corners: nothing can be judged.
    expect(3, &[resume, text(&session), "--cell", text(&cell), "--time-scale", "max"]);
    assert!(text(&newest()).contains("-resumed"));
    assert_eq!(images(&newest()).len(), 3);
}

/// Time that the test tells.
#[derive(Default)]
struct Told(AtomicU64);

impl Clock for Told {
    fn now(&self) -> Stamp {
        Stamp(self.0.load(Ordering::SeqCst))
    }
}

/// A video of plain images of these values, without loss.
fn video(path: &Path, values: &[u8]) {
    use opencv::core::{CV_8UC3, Mat, Scalar, Size};
    use opencv::prelude::*;
    use opencv::videoio::VideoWriter;
    let codec = VideoWriter::fourcc('F', 'F', 'V', '1').unwrap();
    let mut writer = VideoWriter::new(text(path), codec, 10.0, Size::new(128, 96), true).unwrap();
    assert!(writer.is_opened().unwrap());
    for value in values {
        let image = Mat::new_rows_cols_with_default(96, 128, CV_8UC3, Scalar::all(f64::from(*value))).unwrap();
        writer.write(&image).unwrap();
    }
    writer.release().unwrap();
}

#[test]
fn a_video_shows_its_images_in_order_and_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clip.avi");
    video(&path, &[20, 90, 200]);
    let shipped = include_str!("../../cells/sim.yaml");
    let mut cell = parse_cell(shipped, "cell").unwrap().rgb.unwrap();
    (cell.width, cell.height) = (128, 96);
    let clock = Arc::new(Told::default());
    let mut camera = Pictures::of_video(&cell, &path, Arc::clone(&clock) as Arc<dyn Clock>).unwrap();
    let mut seen = Vec::new();
    for images in [2, 3] {
        camera.begin(images).unwrap();
        assert!(camera.poll().unwrap().is_none(), "no time has passed");
        clock.0.fetch_add(u64::from(images) * 100_000_000, Ordering::SeqCst);
        assert!(camera.poll().unwrap().is_none(), "the last window is not closed");
        clock.0.fetch_add(20_000_000, Ordering::SeqCst);
        let taken = camera.poll().unwrap().unwrap();
        assert!(taken.windows(2).all(|p| (p[1].exposure.start_s - p[0].exposure.start_s - 0.1).abs() < 1e-9));
        seen.extend(taken.iter().map(|i| i.image.as_ref().unwrap().at(64, 48)));
        assert!(camera.poll().unwrap().is_none(), "nothing is going on");
    }
    // Colour is stored as luminance and two differences, each rounded.
    let as_expected = seen.iter().zip([20_u8, 90, 200, 20, 90]).all(|(found, wanted)| found.abs_diff(wanted) <= 2);
    assert!(seen.len() == 5 && as_expected, "{seen:?}");
    cell.width = 64;
    let wrong = Pictures::of_video(&cell, &path, clock).err().unwrap().to_string();
    assert!(wrong.contains("is 128x96; the cell says rgb.width 64 and rgb.height 96"), "{wrong}");
}

#[cfg(not(feature = "genicam"))]
#[test]
fn without_the_driver_the_program_says_how_to_get_it() {
    let folder = tempfile::tempdir().unwrap();
    let cell = cell(folder.path(), "driver: genicam");
    for command in [&["run", text(&cell)][..], &["camera", "list"]] {
        let said = stderr(&expect(2, command));
        assert!(said.contains("cargo build --features genicam") && said.contains("libaravis-dev"), "{said}");
    }
}
