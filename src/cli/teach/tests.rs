//! A sitting at a simulated controller, over sockets and in real time; the lines come from a channel.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::sync::Arc;
use std::sync::mpsc::Sender;
use std::thread::JoinHandle;
use std::time::Duration;

use super::*;
use crate::config::{self, Pattern};
use crate::devices::RobotError;
use crate::devices::sim::ur::{SimController, SimUrConfig};
use crate::devices::ur::UrConfig;

const CELL: &str = include_str!("../../../cells/sim.yaml");

fn cell() -> Cell {
    config::parse_cell(CELL, "cells/sim.yaml").unwrap()
}

fn simulator(seed: u64) -> SimController {
    let cell = cell();
    let config = SimUrConfig {
        time_scale: 1.0,
        lock_step_patience: Duration::ZERO,
        start_joints_rad: cell.robot.home_joints_rad,
        tcp_offset: cell.robot.tcp_offset.pose_vector(),
        payload_kg: cell.robot.payload_kg,
        payload_cog_m: cell.robot.payload_cog_m,
        ..SimUrConfig::default()
    };
    SimController::start(config, seed).unwrap()
}

fn config_of(sim: &SimController) -> UrConfig {
    let ports = sim.ports();
    UrConfig {
        rtde_port: ports.rtde,
        primary_port: ports.primary,
        dashboard_port: Some(ports.dashboard),
        ..UrConfig::at(sim.address().to_string())
    }
}

/// A sitting in a thread of its own.
struct Sitting {
    lines: Sender<String>,
    thread: JoinHandle<anyhow::Result<Exit>>,
    path: PathBuf,
}

impl Sitting {
    fn begin(sim: &SimController, path: &Path, mode: Mode, cell: Cell) -> Self {
        Self::with(sim, path, mode, cell, true)
    }

    fn with(sim: &SimController, path: &Path, mode: Mode, cell: Cell, scripted: bool) -> Self {
        let (lines, received) = channel();
        let monitor = UrMonitor::connect(&config_of(sim), Arc::new(sim.clock())).unwrap();
        let file = TaughtFile::open(path, None, mode).unwrap();
        let thread = std::thread::spawn(move || {
            let arm = Arm::ur5e();
            let mut session = Session::new(monitor, file, &cell, &arm, "2024-01-01".into(), scripted);
            session.patience_s = 2.0;
            session.run(&received, &AtomicBool::new(false))
        });
        Self { lines, thread, path: path.into() }
    }

    fn line(&self, line: &str) {
        self.lines.send(format!("{line}\n")).unwrap();
    }

    /// Waits until the file has these poses.
    fn has(&self, ids: &[&str]) {
        wait_for(&format!("{ids:?}"), || ids_in(&self.path) == ids);
    }

    fn end(self) -> anyhow::Result<Exit> {
        drop(self.lines);
        self.thread.join().unwrap()
    }
}

fn ids_in(path: &Path) -> Vec<String> {
    let Ok(text) = std::fs::read_to_string(path) else { return Vec::new() };
    let trajectory = config::parse_trajectory(&text, "t.yaml").unwrap_or_else(|e| panic!("torn: {e}\n{text}"));
    let stops = trajectory.segments.into_iter().flat_map(|s| match s.pattern {
        Pattern::Joints(stops) => stops,
        other => panic!("{other:?}"),
    });
    stops.filter_map(|s| s.id).collect()
}

/// Waits in real time for something that runs in real time.
fn wait_for(what: &str, done: impl Fn() -> bool) {
    for _ in 0..5000 {
        if done() {
            return;
        }
        pause(Duration::from_millis(2));
    }
    panic!("{what}: never came");
}

#[expect(clippy::disallowed_methods, reason = "waits for a simulator that runs in real time")]
fn pause(time: Duration) {
    std::thread::sleep(time);
}

/// Another program moves the arm, as a hand would.
fn move_by(sim: &SimController, by: Joints, speed_rad_s: f64) {
    let home = cell().robot.home_joints_rad;
    let to: Vec<_> = home.iter().zip(by).map(|(q, d)| (q + d).to_string()).collect();
    let script = format!("def hand():\n  movej([{}], 4.0, {speed_rad_s})\nend\n", to.join(","));
    let moved = sim.handle().motions_begun();
    let mut port = TcpStream::connect((sim.address(), sim.ports().secondary)).unwrap();
    port.read_exact(&mut [0]).unwrap();
    port.write_all(script.as_bytes()).unwrap();
    wait_for("the motion", || sim.handle().motions_begun() > moved);
}

#[test]
fn poses_are_taught_in_words_and_every_one_is_on_the_disk_at_once() {
    let (sim, folder) = (simulator(1), tempfile::tempdir().unwrap());
    let path = folder.path().join("mine.yaml");
    let sitting = Sitting::begin(&sim, &path, Mode::New, cell());
    sitting.line("t first");
    sitting.has(&["first"]);
    move_by(&sim, [0.2, 0.1, -0.1, 0.2, 0.0, 0.0], 1.0);
    sitting.line("");
    sitting.has(&["first", "p02"]);
    sitting.line("u");
    sitting.has(&["first"]);
    move_by(&sim, [0.0, 0.0, 0.0, 0.0, 0.3, 0.3], 1.0);
    ["?", "t last", "l", "w", "q"].iter().for_each(|line| sitting.line(line));
    sitting.has(&["first", "last"]);
    assert_eq!(sitting.end().unwrap(), Exit::Ok);

    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.contains("serial 20235500001; TCP at (0.000, 0.000, 40.000) mm"), "{text}");
    let trajectory = config::parse_trajectory(&text, "t").unwrap();
    assert_eq!(trajectory.name, "mine");
    let Pattern::Joints(stops) = &trajectory.segments[0].pattern else { panic!("{trajectory:?}") };
    let wanted = cell().robot.home_joints_rad;
    for (i, by) in [[0.0; 6], [0.0, 0.0, 0.0, 0.0, 0.3, 0.3]].iter().enumerate() {
        let missed = (0..6).map(|k| (stops[i].at[k] - wanted[k] - by[k]).abs()).fold(0.0, f64::max);
        assert!(missed < 2e-5, "pose {i} is {missed:e} rad from where the arm was");
    }
    let left = std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(left, 1, "something was left beside the file");
}

#[test]
fn a_moving_arm_is_not_taken() {
    let (sim, folder) = (simulator(2), tempfile::tempdir().unwrap());
    let path = folder.path().join("mine.yaml");
    let sitting = Sitting::begin(&sim, &path, Mode::New, cell());
    sitting.line("t a");
    sitting.has(&["a"]);
    move_by(&sim, [0.6, 0.0, 0.0, 0.0, 0.0, 0.0], 0.1);
    sitting.line("t b");
    assert_eq!(sitting.end().unwrap(), Exit::OperatorNeeded);
    assert_eq!(ids_in(&path), ["a"]);
}

#[test]
fn with_an_operator_mistakes_are_told_and_go_on() {
    let (sim, folder) = (simulator(3), tempfile::tempdir().unwrap());
    let path = folder.path().join("mine.yaml");
    let sitting = Sitting::with(&sim, &path, Mode::New, cell(), false);
    // Too early: nothing has been still for long enough.
    ["t a", "dance", "t a b", "u"].iter().for_each(|line| sitting.line(line));
    while ids_in(&path).is_empty() {
        sitting.line("t a");
        pause(Duration::from_millis(100));
    }
    sitting.line("t a");
    sitting.line("q");
    assert_eq!(sitting.end().unwrap(), Exit::Ok);
    assert_eq!(ids_in(&path), ["a"]);
}

#[test]
fn scripts_end_at_the_first_mistake() {
    let (sim, folder) = (simulator(4), tempfile::tempdir().unwrap());
    let path = folder.path().join("mine.yaml");
    for (lines, code) in
        [(["t a", "t a"], Exit::Usage), (["t b", "dance"], Exit::Usage), (["t c", "t c d"], Exit::Usage)]
    {
        let sitting = Sitting::begin(&sim, &path, Mode::Replace, cell());
        lines.iter().for_each(|line| sitting.line(line));
        let error = sitting.end().unwrap_err();
        assert_eq!(crate::cli::exit::of_error(&error), code, "{error}");
        assert_eq!(ids_in(&path).len(), 1, "what was taken stays");
    }
}

#[test]
fn a_robot_that_falls_silent_is_an_error_and_the_file_stays() {
    let (sim, folder) = (simulator(5), tempfile::tempdir().unwrap());
    let path = folder.path().join("mine.yaml");
    let sitting = Sitting::begin(&sim, &path, Mode::New, cell());
    sitting.line("t a");
    sitting.has(&["a"]);
    sim.handle().mute(true);
    wait_for("the end", || sitting.thread.is_finished());
    let error = sitting.end().unwrap_err();
    assert!(matches!(error.downcast_ref(), Some(RobotError::Silent { .. })), "{error}");
    assert_eq!(ids_in(&path), ["a"]);
}

#[test]
fn what_is_doubtful_is_exit_3() {
    let (sim, folder) = (simulator(6), tempfile::tempdir().unwrap());
    let path = folder.path().join("mine.yaml");
    let mut narrow = cell();
    let home = narrow.robot.home_joints_rad;
    narrow.robot.limits.joints_rad = Some(home.map(|q| [q + 0.1, q + 0.2]));
    let sitting = Sitting::begin(&sim, &path, Mode::New, narrow);
    sitting.line("t");
    assert_eq!(sitting.end().unwrap(), Exit::Warnings);
}

#[test]
fn a_pose_inside_a_box_or_near_one_is_told() {
    let (mut walled, arm) = (cell(), Arm::ur5e());
    let home = walled.robot.home_joints_rad;
    assert_eq!(is_clear(&Clearance::of(&walled, &arm), &home), Ok(()));
    let at_m = (arm.forward(&home) * walled.robot.tcp_offset).translation_m();
    let keep_out = &mut walled.robot.keep_out[0];
    (keep_out.min_m, keep_out.max_m) = (at_m.map(|v| v - 0.01), at_m.map(|v| v + 0.01));
    let why = is_clear(&Clearance::of(&walled, &arm), &home).unwrap_err();
    assert!(why.contains(&format!("inside the keep-out box `{}`", walled.robot.keep_out[0].name)), "{why}");
    let nearest = |gap: &Clearance| gap.gaps(&home).into_iter().map(|g| g.gap_m).fold(f64::INFINITY, f64::min);
    let mut wary = cell();
    wary.robot.keep_out_margin_m = nearest(&Clearance::of(&wary, &arm)) + 0.01;
    let why = is_clear(&Clearance::of(&wary, &arm), &home).unwrap_err();
    assert!(why.contains(" mm from the keep-out box"), "{why}");
    let mut narrow = cell();
    narrow.robot.limits.joints_rad = Some(home.map(|q| [q + 0.1, q + 0.2]));
    assert_eq!(is_clear(&Clearance::of(&narrow, &arm), &home), Ok(()), "told by the limits");
}

#[test]
fn files_are_appended_to_replaced_or_left_alone() {
    let (sim, folder) = (simulator(7), tempfile::tempdir().unwrap());
    let path = folder.path().join("mine.yaml");
    let first =
        "name: old\nsegments:\n- pattern: joints\n  poses:\n  - {id: p01, joints_deg: [0, 0, 0, 0, 0, 0]} # mine\n";
    std::fs::write(&path, first).unwrap();
    let refused = |name: Option<&str>, mode| TaughtFile::open(&path, name, mode).unwrap_err().to_string();
    assert!(refused(None, Mode::New).contains("exists already"));
    assert!(refused(Some("other"), Mode::Append).contains("its name is `old`"));
    assert!(refused(Some("a b"), Mode::Replace).contains("cannot be the name"));
    let nowhere = TaughtFile::open(&folder.path().join("no/mine.yaml"), None, Mode::New).unwrap_err();
    assert!(nowhere.to_string().contains("there is no folder"), "{nowhere}");

    let sitting = Sitting::begin(&sim, &path, Mode::Append, cell());
    sitting.line("t");
    sitting.line("q");
    assert_eq!(sitting.end().unwrap(), Exit::Ok);
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.starts_with(first) && text.contains("# Taught by hand in the cell sim on 2024-01-01."), "{text}");
    assert_eq!(ids_in(&path), ["p01", "p02"]);

    let sitting = Sitting::begin(&sim, &path, Mode::Replace, cell());
    sitting.line("t new");
    sitting.has(&["new"]);
    sitting.line("u");
    sitting.has(&["p01", "p02"]);
    assert_eq!(sitting.end().unwrap(), Exit::Ok);
    assert_eq!(std::fs::read_to_string(&path).unwrap(), text, "all undone: as before");

    let other = folder.path().join("other.yaml");
    let sitting = Sitting::begin(&sim, &other, Mode::Append, cell());
    ["t", "u"].iter().for_each(|line| sitting.line(line));
    assert_eq!(sitting.end().unwrap(), Exit::Ok);
    assert!(!other.exists(), "all undone: no file");
}

#[test]
fn lines_are_orders() {
    let order = |line| Order::from_line(line).unwrap();
    assert_eq!((order("\r\n"), order(" t ")), (Order::Take(None), Order::Take(None)));
    assert_eq!(order("t p-1\n"), Order::Take(Some("p-1".into())));
    assert_eq!(
        [order("u"), order("l"), order("w"), order("q"), order("?")].map(|o| format!("{o:?}")),
        ["Undo", "List", "Write", "Quit", "Help"]
    );
    for bad in ["T", "t a b", "quit", "\u{1b}[A", "tp01"] {
        assert!(Order::from_line(bad).is_err(), "{bad:?}");
    }
}

#[test]
fn the_hint_says_which_turns_are_missing() {
    let turned = |v: [f64; 3]| Transform::from_pose_vector([0.4, 0.0, 0.3, v[0], v[1], v[2]]);
    let flat: Vec<_> = [0.0, 0.3, 0.6, 0.9].map(|a| turned([0.0, 0.0, a])).into();
    assert!(hint(Carried::Target, &flat[..2]).contains("at least 3 poses"));
    assert!(hint(Carried::Target, &flat).contains("add at least two poses"), "{}", hint(Carried::Target, &flat));
    let round = [turned([0.0; 3]), turned([0.5, 0.0, 0.0]), turned([0.0, 0.5, 0.0]), turned([0.0, 0.0, 0.5])];
    assert!(hint(Carried::Cameras, &round).starts_with("enough"), "{}", hint(Carried::Cameras, &round));
}

#[test]
fn the_status_line_begins_with_the_light() {
    let (sim, clock) = (simulator(8), 0.3);
    let mut monitor = UrMonitor::connect(&config_of(&sim), Arc::new(sim.clock())).unwrap();
    let sample = monitor.next_sample().unwrap().1;
    let light = Light::Settling { still_s: 0.12, of_s: clock, why: Some("a long story".into()) };
    let line = status_line(&light, &sample, 3);
    assert!(line.starts_with("settling 0.12 of 0.30 s 3 poses | joints 92.0 -62.0 128.0 -66.0 92.0 0.0 deg"), "{line}");
}
