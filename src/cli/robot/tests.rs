//! Status, kinematics and URDF of a simulated controller.

use super::*;
use crate::cli::exit::of_error;
use crate::devices::sim::ur::{SimController, SimUrConfig};
use crate::geometry::kinematics::Arm;

const CELL: &str = include_str!("../../../cells/sim.yaml");

fn cell() -> Cell {
    config::parse_cell(CELL, "cells/sim.yaml").unwrap()
}

fn simulator(of: impl FnOnce(&mut SimUrConfig)) -> SimController {
    let cell = cell();
    let mut config = SimUrConfig {
        time_scale: 1.0,
        lock_step_patience: std::time::Duration::ZERO,
        start_joints_rad: cell.robot.home_joints_rad,
        tcp_offset: cell.robot.tcp_offset.pose_vector(),
        payload_kg: cell.robot.payload_kg,
        payload_cog_m: cell.robot.payload_cog_m,
        ..SimUrConfig::default()
    };
    of(&mut config);
    SimController::start(config, 7).unwrap()
}

fn address(sim: &SimController) -> Address {
    let ports = sim.ports();
    Address {
        address: Some(sim.address().to_string()),
        rtde_port: Some(ports.rtde),
        primary_port: Some(ports.primary),
        dashboard_port: Some(ports.dashboard),
    }
}

fn seen(sim: &SimController, cell: Option<&Cell>) -> Seen {
    let config = address(sim).config(cell).unwrap();
    let mut monitor = UrMonitor::connect(&config, Arc::new(sim.clock())).unwrap();
    Seen::now(&mut monitor, None, cell).unwrap().1
}

#[test]
fn the_state_is_told_in_words_and_in_numbers() {
    let sim = simulator(|config| config.speed_fraction = 0.5);
    sim.handle().set_digital_input(3, true);
    sim.handle().set_digital_input(17, true);
    let state = seen(&sim, None);
    let text = state.text();
    for part in [
        "controller  5.12.4.1101 (Oct 26 2022), on for 10",
        "robot       model UR5, serial 20235500001\n",
        "remote      yes\n",
        "mode        7 (RUNNING)\n",
        "safety      1 (NORMAL): normal\n",
        "program     1 (STOPPED)\n",
        "speed       slider 50 %, in effect 50 %\n",
        "payload     0.450 kg at (0.0, 0.0, 50.0) mm in the flange\n",
        "TCP offset  (0.000, 0.000, 40.000) mm, rotation vector (0.000, 0.000, 0.000) deg\n",
        "inputs on   3, 17\n",
        "outputs on  none\n",
    ] {
        assert!(text.contains(part), "{part:?} is not in\n{text}");
    }
    assert!(!text.contains("pre-flight") && state.exit() == Exit::Ok);
    let json = state.json();
    assert_eq!((&json["schema_version"], &json["digital_inputs_on"]), (&json!(1), &json!([3, 17])));
    assert_eq!((&json["remote_control"], &json["serial"]), (&json!(true), &json!("20235500001")));
    assert!(json.get("preflight").is_none(), "{json}");
    let home = cell().robot.home_joints_rad;
    let far = (0..6).any(|i| (json["joints_rad"][i].as_f64().unwrap() - home[i]).abs() > 1e-4);
    assert!(!far, "{json}");
}

#[test]
fn with_a_cell_it_says_what_preflight_would_refuse() {
    let sim = simulator(|_| ());
    assert_eq!(seen(&sim, Some(&cell())).findings, Some(Vec::new()));
    let wrong = simulator(|config| (config.tcp_offset[2], config.remote_control) = (0.05, false));
    let mut cell = cell();
    cell.robot.serial = Some("4711".into());
    let state = seen(&wrong, Some(&cell));
    let ids: Vec<_> = state.findings.iter().flatten().map(|f| f.id.as_str()).collect();
    assert_eq!(ids, ["remote_control", "serial", "tcp_offset"]);
    assert_eq!(state.exit(), Exit::PreflightFailed);
    let text = state.text();
    assert!(text.contains("remote      no, local control\n") && text.contains("  serial: the serial of"), "{text}");
}

#[test]
fn a_stopped_robot_is_told_as_such() {
    let sim = simulator(|_| ());
    sim.handle().protective_stop();
    let text = seen(&sim, None).text();
    assert!(text.contains("safety      3 (PROTECTIVE_STOP): protective stop, stopped due to safety\n"), "{text}");
}

#[test]
fn an_arm_is_compared_with_the_nominal_one() {
    let joints = [0.3, -1.2, 1.4, -1.7, -1.5, 0.2];
    let same = Difference::of(&Dh::UR5E, &Dh::UR5E, &joints);
    assert!(same.flange_m == 0.0 && same.flange_rad < 1e-12, "{same:?}");
    // 1 mm more at the last link goes straight into the flange, 1 mrad at its joint too.
    let mut longer = Dh::UR5E;
    longer.d_m[5] += 1e-3;
    longer.theta_rad[5] += 1e-3;
    let found = Difference::of(&longer, &Dh::UR5E, &joints);
    assert!((found.flange_m - 1e-3).abs() < 1e-12 && (found.flange_rad - 1e-3).abs() < 1e-9, "{found:?}");
    assert!((found.dh.d_m[5] - 1e-3).abs() < 1e-12 && found.dh.d_m[0] == 0.0, "{found:?}");
    let kinematics = Kinematics { dh: Dh::individual(), checksum: "ab".repeat(24), calibrated: true };
    let found = Difference::of(&kinematics.dh, &Dh::UR5E, &joints);
    assert!(found.flange_m > 1e-4 && found.flange_m < 0.02, "{found:?}");
    let text = kinematics_text(&kinematics, Some(&found));
    assert!(text.ends_with(&format!("  kinematics_checksum: \"{}\"\n", "ab".repeat(24))), "{text}");
    assert!(text.contains("only their sum means anything"), "{text}");
    let with = CELL.replace("  model: ur5e\n", &format!("  model: ur5e\n{}\n", text.lines().last().unwrap()));
    assert_eq!(config::parse_cell(&with, "c").unwrap().robot.kinematics_checksum, Some("ab".repeat(24)));
}

#[test]
fn only_an_e_series_ur5_has_a_nominal_arm_here() {
    let facts = |version: u32, model: Option<&str>| RobotFacts {
        controller_version: [version, 0, 0, 0],
        model: model.map(str::to_owned),
        ..RobotFacts::default()
    };
    assert!(nominal_of(&facts(5, Some("UR5"))).is_some() && nominal_of(&facts(10, None)).is_some());
    assert!(nominal_of(&facts(3, Some("UR5"))).is_none() && nominal_of(&facts(5, Some("UR10"))).is_none());
}

#[test]
fn the_urdf_is_that_of_the_controller_and_replaces_nothing_unasked() {
    let (sim, folder) = (simulator(|_| ()), tempfile::tempdir().unwrap());
    let output = folder.path().join("arm.urdf");
    let write = |force| Urdf { cell: None, at: address(&sim), output: output.clone(), force }.execute();
    assert_eq!(write(false).unwrap(), Exit::Ok);
    let arm = Arm::from_urdf(&std::fs::read_to_string(&output).unwrap()).unwrap();
    let (believed, joints) = (sim.truth().individual().believed, [0.3, -1.2, 1.4, -1.7, -1.5, 0.2]);
    let (found, truth) = (arm.forward(&joints), believed.forward(&joints));
    assert!(found.distance_to_m(&truth) < 1e-9 && found.angle_to_rad(&truth) < 1e-9, "{found:?} {truth:?}");
    assert_eq!(of_error(&write(false).unwrap_err()), Exit::Usage);
    assert_eq!(write(true).unwrap(), Exit::Ok);
}

#[test]
fn a_robot_that_is_not_there_is_an_error_that_says_so() {
    // Bound and closed again: nobody listens there.
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let nobody = Address {
        address: Some("127.0.0.1".into()),
        rtde_port: Some(port),
        primary_port: Some(port),
        dashboard_port: Some(port),
    };
    let (json, watch) = (false, false);
    let error = Status { cell: None, at: nobody.clone(), json, watch }.execute().unwrap_err();
    assert!(error.to_string().starts_with(&format!("cannot reach the robot at 127.0.0.1:{port}")), "{error}");
    assert_eq!(of_error(&error), Exit::Error);
    assert_eq!(of_error(&ShowKinematics { cell: None, at: nobody, json }.execute().unwrap_err()), Exit::Error);
    let nowhere = Address::default();
    assert!(nowhere.config(None).unwrap_err().to_string().contains("a cell with `driver: ur`, or --address HOST"));
    assert!(nowhere.config(Some(&cell())).unwrap_err().to_string().contains("`driver: sim`"));
}
