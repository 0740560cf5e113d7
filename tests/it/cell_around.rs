//! The cell around the arm: a program of the plant that moves, signals to others, the program that is loaded.

use std::io::Write as _;
use std::net::{SocketAddr, TcpStream};

use cellcal::recording::{Entry, Recording};
use cellcal::session::{Command, End, Input, RobotSample};

use crate::bench::{Bench, THREE_POSES, texts};
use crate::support::{expect, stderr};

/// The small cell with more keys under `robot`.
fn bench_with(keys: &str) -> Bench {
    let mut texts = texts(THREE_POSES);
    texts.cell.1 = texts.cell.1.replace("  limits:\n", &format!("{keys}  limits:\n"));
    Bench::of(texts, |_| ())
}

fn samples(path: &std::path::Path) -> Vec<RobotSample> {
    let entries = Recording::open(path).unwrap().entries;
    let sample = |entry| if let Entry::Input(_, Input::Robot(sample)) = entry { Some(*sample) } else { None };
    entries.into_iter().filter_map(sample).collect()
}

#[test]
fn others_are_told_and_production_is_loaded_but_not_started() {
    let bench = bench_with("  signals: {calibrating: {digital_output: 4}}\n  load_program: production.urp\n");
    let ran = bench.run(|_| ()).unwrap();
    assert_eq!((&ran.outcome.end, ran.notes.as_slice()), (&End::Complete, &[][..]));
    let samples = samples(&ran.recording);
    let on = |s: &RobotSample| s.digital_outputs >> 4 & 1 == 1;
    let moving = |s: &&RobotSample| s.target_joint_speeds_rad_s.iter().any(|v| *v != 0.0);
    // The first cycle of the first move carries the signal with it.
    assert!(samples.iter().filter(moving).skip(1).all(on), "off while the arm moves");
    assert!(!on(&samples[0]), "on before pre-flight");
    assert_eq!(bench.outputs() >> 4 & 1, 0, "on after the end");
    assert!(bench.ask("get loaded program").contains("production.urp"));
    assert!(bench.ask("running").contains("false"));
}

#[test]
fn others_are_told_of_the_end_after_a_stop_too() {
    let bench = bench_with("  signals: {calibrating: {digital_output: 4}}\n");
    let handle = bench.handle();
    let ran = bench.run(|command| {
        if matches!(command, Command::Capture { pose: 1, .. }) {
            handle.protective_stop();
        }
    });
    assert!(matches!(ran.unwrap().outcome.end, End::OperatorNeeded(_)));
    assert_eq!(bench.outputs() >> 4 & 1, 0);
}

#[test]
fn a_program_that_cannot_be_loaded_is_told_and_costs_nothing() {
    let bench = bench_with("  load_program: missing.urp\n");
    let ran = bench.run(|_| ()).unwrap();
    assert_eq!(ran.outcome.end, End::Complete);
    assert!(ran.notes.len() == 1 && ran.notes[0].contains("missing.urp"), "{:?}", ran.notes);
}

/// A plant's own program: moves to the poses and waits at each for `captured`.
fn plant(bench: &Bench) -> String {
    let mut script = String::from("def plant():\n  set_standard_digital_out(5, False)\n");
    for pose in &bench.planned.plan.poses {
        script.push_str(&format!(
            "  movej({:?}, 0.8, 0.4)\n  set_standard_digital_out(5, True)\n  \
             while (not get_standard_digital_out(2)): sync() end\n  set_standard_digital_out(5, False)\n  \
             while (get_standard_digital_out(2)): sync() end\n",
            pose.joints_rad
        ));
    }
    script.push_str("end\n");
    script
}

#[test]
fn a_program_of_the_plant_moves_and_we_answer() {
    let keys = "  motion: {external: {at_pose: {digital_output: 5}, captured: {digital_output: 2}}}\n";
    let bench = bench_with(keys);
    // Without it running pre-flight refuses.
    let ran = bench.run(|_| ()).unwrap();
    let End::PreflightFailed(findings) = &ran.outcome.end else { panic!("{:?}", ran.outcome.end) };
    assert_eq!(findings[0].id, "program");
    assert!(findings[0].message.contains("start the program that moves the arm"));

    let bench = bench_with(keys);
    let address = SocketAddr::new(bench.sim.address(), bench.sim.ports().secondary);
    let mut uploaded = TcpStream::connect(address).unwrap();
    uploaded.write_all(plant(&bench).as_bytes()).unwrap();
    let mut captures = 0;
    let ran = bench.run(|command| captures += usize::from(matches!(command, Command::Capture { .. }))).unwrap();
    assert_eq!((&ran.outcome.end, captures, ran.notes.as_slice()), (&End::Complete, 3, &[][..]));
    // The last handshake has been completed: the plant's program has come to its end.
    assert_eq!(bench.outputs() >> 2 & 1, 0, "`captured` stayed on");
    bench.arm_stays_at_rest().unwrap();
    assert!(bench.ask("running").contains("false"), "the program of the plant still waits");
    for (record, planned) in ran.outcome.poses.iter().zip(&bench.planned.plan.poses) {
        let reached = record.joints_rad.unwrap();
        assert!(reached.iter().zip(planned.joints_rad).all(|(a, b)| (a - b).abs() < 1e-3));
        assert!(record.evidence.as_ref().unwrap().max_joint_speed_rad_s.unwrap() < 0.005);
    }
}

/// The small cell as a file.
fn cell_file(folder: &std::path::Path, change: impl Fn(String) -> String) -> String {
    let texts = texts(THREE_POSES);
    std::fs::write(folder.join("three.yaml"), THREE_POSES).unwrap();
    let path = folder.join("cell.yaml");
    std::fs::write(&path, change(texts.cell.1)).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn nobody_watching_needs_an_interlock_and_a_failed_preflight_is_exit_6() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("sessions").to_str().unwrap().to_owned();
    let with = cell_file(folder.path(), |text| text);
    let run = ["run", &with, "--rehearse", "--unattended", "--time-scale", "max", "--output", &output];
    expect(0, &run);
    let refused = expect(6, &[&run[..], &["--sim-fault", "digital_input:3=1@connect"]].concat());
    assert!(stderr(&refused).contains("interlock: cell released: digital input 3 is on"), "{}", stderr(&refused));
    let without = cell_file(folder.path(), |text| {
        let keep = |line: &&str| !line.contains("interlocks:");
        text.lines().filter(keep).collect::<Vec<_>>().join("\n")
    });
    let refused = expect(2, &["run", &without, "--rehearse", "--unattended", "--output", &output]);
    assert!(stderr(&refused).contains("robot.interlocks is missing"), "{}", stderr(&refused));
}
