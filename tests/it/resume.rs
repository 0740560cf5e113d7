//! A session that ended early goes on: pre-flight again, back along the way, the missing poses only.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use cellcal::recording::{Entry, Recording};
use cellcal::session::{Command as Asked, Input};

use crate::bench;
use crate::bench::rtde_client::pause;
use crate::support::{cellcal, expect, json, stderr, text};

/// The small cell as files.
fn cell(folder: &Path) -> PathBuf {
    let texts = bench::texts(bench::THREE_POSES);
    std::fs::write(folder.join("cell.yaml"), &texts.cell.1).unwrap();
    std::fs::write(folder.join("three.yaml"), bench::THREE_POSES).unwrap();
    folder.join("cell.yaml")
}

/// The newest session file below a folder whose name has this part.
fn session(folder: &Path, part: &str) -> PathBuf {
    let files = std::fs::read_dir(folder.join("sim")).unwrap().map(|e| e.unwrap().path());
    let mut found: Vec<_> = files.filter(|p| p.is_file() && text(p).contains(part)).collect();
    found.sort();
    found.pop().unwrap_or_else(|| panic!("no session with `{part}` in its name"))
}

fn visited(path: &Path) -> Vec<usize> {
    let pose = |entry: &Entry| match entry {
        Entry::Command(Asked::Capture { pose, .. }) => Some(*pose),
        _ => None,
    };
    Recording::open(path).unwrap().entries.iter().filter_map(pose).collect()
}

/// Whether the resumed file holds every pose once, and the machine still agrees with it.
fn is_whole(path: &Path, output: &std::process::Output) {
    let report = json(output);
    assert_eq!((&report["reached"], &report["total"]), (&3.into(), &3.into()), "{report:#}");
    let mut poses = visited(path);
    poses.dedup();
    assert_eq!(poses, [0, 1, 2]);
    let replayed = cellcal(&["replay", text(path), "--json"]);
    // A rehearsal has no images: nothing can be judged, but the replay must not diverge.
    assert_eq!(replayed.status.code(), Some(3), "{}", stderr(&replayed));
}

#[test]
fn a_lost_robot_anywhere_on_the_way_is_resumed() {
    for at_s in [0.8, 1.3, 1.9, 2.6, 3.4, 4.1] {
        let folder = tempfile::tempdir().unwrap();
        let (cell, output) = (cell(folder.path()), folder.path().join("sessions"));
        let fault = format!("drop@t:{at_s}");
        let run = ["run", text(&cell), "--rehearse", "--time-scale", "max", "--output", text(&output)];
        let stopped = expect(8, &[&run[..], &["--sim-fault", &fault]].concat());
        assert!(stderr(&stopped).contains("cellcal resume"), "{}", stderr(&stopped));
        let resumed = expect(0, &["resume", text(&session(&output, "rehearsal")), "--time-scale", "max", "--json"]);
        is_whole(&session(&output, "-resumed"), &resumed);
    }
}

#[test]
fn what_kill_9_left_is_resumed() {
    for after_ms in [900, 1500, 2300] {
        let folder = tempfile::tempdir().unwrap();
        let (cell, output) = (cell(folder.path()), folder.path().join("sessions"));
        let run = ["run", text(&cell), "--rehearse", "--time-scale", "1", "--output", text(&output)];
        let mut command = Command::new(env!("CARGO_BIN_EXE_cellcal"));
        let mut child = command.args(run).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        // From the first file on: starting the program takes its own time.
        while !output.join("sim").is_dir() {
            pause(Duration::from_millis(10));
        }
        pause(Duration::from_millis(after_ms));
        child.kill().unwrap();
        child.wait().unwrap();
        let partial = session(&output, ".partial");
        let resumed = expect(0, &["resume", text(&partial), "--time-scale", "max", "--json"]);
        is_whole(&session(&output, "-resumed"), &resumed);
        assert!(partial.exists(), "the old file is kept");
    }
}

#[test]
fn what_cannot_be_resumed_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (cell, output) = (cell(folder.path()), folder.path().join("sessions"));
    let run = ["run", text(&cell), "--rehearse", "--time-scale", "max", "--output", text(&output)];
    expect(0, &run);
    let whole = session(&output, "rehearsal");
    let refused = expect(2, &["resume", text(&whole), "--time-scale", "max"]);
    assert!(stderr(&refused).contains("no pose is missing"), "{}", stderr(&refused));
    expect(8, &[&run[..], &["--sim-fault", "protective_stop@move:2"]].concat());
    let cut = session(&output, "rehearsal");
    std::fs::write(&cell, std::fs::read_to_string(&cell).unwrap().replace("payload_kg: 0.45", "payload_kg: 0.46"))
        .unwrap();
    let refused = expect(2, &["resume", text(&cut), "--cell", text(&cell), "--time-scale", "max"]);
    assert!(stderr(&refused).contains("has changed since the session began"), "{}", stderr(&refused));
    let files = std::fs::read_dir(output.join("sim")).unwrap().count();
    assert_eq!(files, 2, "a refusal leaves no file behind");
}

#[test]
fn the_way_back_is_slow_and_only_missing_poses_are_visited() {
    let folder = tempfile::tempdir().unwrap();
    let (cell, output) = (cell(folder.path()), folder.path().join("sessions"));
    let run = ["run", text(&cell), "--rehearse", "--time-scale", "max", "--output", text(&output)];
    expect(8, &[&run[..], &["--sim-fault", "protective_stop@move:3+0.2"]].concat());
    expect(0, &["resume", text(&session(&output, "rehearsal")), "--time-scale", "max"]);
    let entries = Recording::open(&session(&output, "-resumed")).unwrap().entries;
    let resumed = entries.iter().position(|e| matches!(e, Entry::Input(_, Input::Resumed))).unwrap();
    let asked: Vec<_> = entries[resumed..]
        .iter()
        .filter_map(|e| if let Entry::Command(command) = e { Some(command) } else { None })
        .collect();
    let [Asked::Start, Asked::Travel { target, .. }, Asked::Move { pose: 2, .. }, ..] = asked.as_slice() else {
        panic!("{asked:?}")
    };
    let cellcal::session::MoveTarget::Joint { speed_rad_s, .. } = target else { panic!("{target:?}") };
    assert!(*speed_rad_s <= 0.25 * 1.05 + 1e-9, "{speed_rad_s}");
}
