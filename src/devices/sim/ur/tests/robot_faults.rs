//! Faults of the robot, when they happen, and the truth about its motion.

use super::raw::Raw;
use super::*;
use crate::devices::rtde::Value;

const FIELDS: [&str; 9] = [
    "timestamp",
    "robot_mode",
    "safety_mode",
    "safety_status_bits",
    "robot_status_bits",
    "runtime_state",
    "target_qd",
    "actual_digital_input_bits",
    "speed_scaling",
];

/// Modes and bits: robot mode, safety mode, safety bits, status bits, runtime state.
type State = (i32, i32, u32, u32, u32);

const WELL: State = (7, 1, 1, 3, 2);

fn state(values: &[Value]) -> State {
    match values[1..6] {
        [
            Value::Int32(robot),
            Value::Int32(safety),
            Value::Uint32(bits),
            Value::Uint32(status),
            Value::Uint32(runtime),
        ] => (robot, safety, bits, status, runtime),
        _ => panic!("{values:?}"),
    }
}

fn speed(values: &[Value]) -> f64 {
    match values[6] {
        Value::Vector6d(speeds) => speeds.iter().fold(0.0, |m: f64, s| m.max(s.abs())),
        _ => panic!("{values:?}"),
    }
}

/// A client that watches a program which moves to and fro.
fn moving(sim: &SimController) -> Raw {
    let mut raw = Raw::driving(sim, 125.0, &FIELDS);
    let mut script = raw_stream(sim, sim.ports().secondary);
    let there = "movej([0.5, -1.6, -1.9, -1.2, 1.57, 0], a=1.4, v=1.0)";
    let program = format!(
        "def to_and_fro():\n while True:\n {there}\n movej([0, -1.6, -1.9, -1.2, 1.57, 0], 1.4, 1)\n end\nend\n"
    );
    script.write_all(program.as_bytes()).unwrap();
    raw.turn_until(|values| speed(values) > 0.5);
    raw
}

#[test]
fn every_fault_of_the_robot_shows_in_its_state() {
    let stopped = 1 << 10;
    for (text, wanted, moves) in [
        ("protective_stop", (7, 3, 1 << 2 | stopped, 1, 4), false),
        ("safeguard_stop", (7, 5, 1 << 4 | stopped, 1, 4), false),
        ("emergency_stop", (3, 7, 1 << 6 | 1 << 7 | stopped, 0, 1), false),
        ("violation", (3, 8, 1 << 8 | stopped, 0, 1), false),
        ("fault", (3, 9, 1 << 9 | stopped, 0, 1), false),
        ("power_off", (3, 1, 1, 0, 1), false),
        ("reduced", (7, 2, 1 << 1, 3, 2), true),
        ("pause", (7, 1, 1, 1, 4), false),
        ("stop_program", (7, 1, 1, 1, 1), false),
        ("teach_button", (7, 1, 1, 7, 2), true),
        ("foreign_program", WELL, false),
    ] {
        let sim = simulator(SimUrConfig::default(), 31);
        let mut raw = moving(&sim);
        let handle = sim.handle();
        handle.inject_fault(text.parse().unwrap());
        raw.answer();
        let first = raw.values().unwrap();
        assert_eq!(state(&first), wanted, "{text}");
        if !moves {
            assert!(speed(&first) > 0.1, "{text}: it cannot stand at once");
            let began_s = sim.clock().seconds();
            raw.turn_until(|values| speed(values) == 0.0);
            // 1 rad/s at 20 or 8 rad/s2.
            let limit_s = if wanted.1 > 1 { 0.06 } else { 0.15 };
            assert!(sim.clock().seconds() - began_s < limit_s, "{text}");
        }
        let began = sim.motions_begun();
        for _ in 0..200 {
            raw.answer();
            assert_eq!(state(&raw.values().unwrap()), wanted, "{text}");
        }
        assert_eq!(sim.motions_begun() > began, moves, "{text}");
        handle.inject_fault(Fault::Heal);
        raw.answer();
        let healed = match wanted.4 {
            2 if text != "foreign_program" => WELL,
            4 => (7, 1, 1, 1, 4),
            _ => (7, 1, 1, 1, 1),
        };
        assert_eq!(state(&raw.values().unwrap()), healed, "{text}, healed");
        handle.resume();
        raw.answer();
        let resumed = state(&raw.values().unwrap());
        assert_eq!(resumed, if healed.4 == 1 { healed } else { WELL }, "{text}, resumed");
    }
}

#[test]
fn a_stopped_robot_does_not_resume_before_it_is_healed() {
    let sim = simulator(SimUrConfig::default(), 32);
    let mut raw = moving(&sim);
    sim.handle().inject_fault(Fault::SafeguardStop);
    sim.handle().resume();
    raw.answer();
    assert_eq!(state(&raw.values().unwrap()).4, 4);
    sim.handle().inject_fault(Fault::Reduced);
    raw.answer();
    assert_eq!(state(&raw.values().unwrap()).1, 5, "the worse state stays");
}

#[test]
fn settings_change_and_come_back() {
    let fields = ["payload", "tcp_offset", "actual_digital_input_bits", "speed_scaling", "actual_TCP_pose"];
    let flawless = SimUrConfig { flaws: Flaws::none(), ..SimUrConfig::default() };
    let sim = simulator(flawless, 33);
    let mut raw = Raw::driving(&sim, 125.0, &fields);
    let well = raw.values().unwrap();
    for text in ["payload:2.5", "tcp_offset:10", "digital_input:3=1", "slider:0.25"] {
        sim.handle().inject_fault(text.parse().unwrap());
    }
    raw.answer();
    let changed = raw.values().unwrap();
    assert_eq!(changed[0], Value::Double(2.5));
    assert_eq!(changed[1], Value::Vector6d([0.0, 0.0, 0.01, 0.0, 0.0, 0.0]));
    assert_eq!(changed[2..4], [Value::Uint64(8), Value::Double(0.25)]);
    let (Value::Vector6d(before), Value::Vector6d(after)) = (well[4], changed[4]) else { panic!() };
    let [before, after] = [before, after].map(Transform::<Base, Flange>::from_pose_vector);
    assert!((before.distance_to_m(&after) - 0.01).abs() < 1e-9 && before.angle_to_rad(&after) < 1e-9);
    sim.handle().inject_fault(Fault::Heal);
    raw.answer();
    assert_eq!(raw.values().unwrap(), well);
}

#[test]
fn the_dashboard_refuses_and_tells_of_local_control() {
    let sim = simulator(SimUrConfig::default(), 34);
    let ask = |question: &str| {
        let mut stream = raw_stream(&sim, sim.ports().dashboard);
        stream.write_all(format!("{question}\nquit\n").as_bytes()).unwrap();
        let mut all = String::new();
        stream.read_to_string(&mut all).unwrap();
        all.lines().nth(1).unwrap_or_default().to_owned()
    };
    assert_eq!(ask("is in remote control"), "true");
    sim.handle().inject_fault(Fault::LocalControl);
    assert_eq!(ask("is in remote control"), "false");
    sim.handle().inject_fault(Fault::SafeguardStop);
    assert_eq!(ask("safetystatus"), "Safetystatus: SAFEGUARD_STOP");
    sim.handle().inject_fault(Fault::DashboardRefuse);
    let mut stream = raw_stream(&sim, sim.ports().dashboard);
    stream.write_all(b"robotmode\n").unwrap();
    let mut answer = [0; 200];
    let mut said = String::new();
    while !said.contains("robotmode") {
        let count = stream.read(&mut answer).unwrap();
        said.push_str(&String::from_utf8_lossy(&answer[..count]));
    }
    assert!(said.contains("Failed to execute: robotmode"), "{said}");
    sim.handle().inject_fault(Fault::Heal);
    assert_eq!(ask("is in remote control"), "true");
    assert_eq!(ask("safetystatus"), "Safetystatus: NORMAL");
}

/// What a session sees: three moves, a stop of the robot at the planned time; when it came, s.
fn stop_at(when: &str) -> (f64, u64, RobotSample) {
    let fault = format!("protective_stop@{when}");
    let sim = simulator(SimUrConfig { faults: vec![fault.parse().unwrap()], ..SimUrConfig::default() }, 35);
    let mut robot = connect(&sim);
    let home = turn(&mut robot).1.target_joints_rad;
    for by in [0.2, -0.2, 0.0] {
        let sequence = robot.start_move(&joint_move(shifted(home, [by; 6]))).unwrap();
        let seen = turn_until(&mut robot, |s| s.executor_sequence == sequence || s.safety_mode != 1);
        let (at, last) = &seen[seen.len() - 1];
        if last.safety_mode != 1 {
            return (at.seconds(), sim.motions_begun(), last.clone());
        }
    }
    panic!("it never came");
}

#[test]
fn faults_come_in_the_phase_that_was_planned() {
    let moving = |sample: &RobotSample| sample.target_joint_speeds_rad_s[0].abs();
    let (early_s, motions, sample) = stop_at("move:2+0.1");
    assert_eq!(motions, 2);
    // 0.1 s at 1.4 rad/s2, less up to 8 ms of braking.
    assert!((0.0..0.15).contains(&moving(&sample)) && moving(&sample) > 0.0, "{sample:?}");
    let (late_s, motions, _) = stop_at("move:2+0.3");
    assert_eq!((motions, ((late_s - early_s) * 1e3).round()), (2, 200.0));
    assert_eq!(stop_at("move:2+0.3").0, late_s, "to the cycle");
    let (still_s, motions, sample) = stop_at("still:2");
    assert_eq!((motions, moving(&sample)), (2, 0.0));
    assert_eq!(sample.executor_state, ExecutorState::Moving, "it settles");
    assert!(still_s > late_s);
    assert!((stop_at(&format!("t:{still_s}")).0 - still_s - 0.008).abs() < 0.009);
    assert_eq!(stop_at("connect+0.5").1, 1);
}

#[test]
fn the_true_motion_is_known_afterwards() {
    let sim = simulator(SimUrConfig { truth_kept_s: 30.0, ..SimUrConfig::default() }, 36);
    let mut robot = connect(&sim);
    let home = turn(&mut robot).1.target_joints_rad;
    let began_s = sim.clock().seconds();
    let sequence = robot.start_move(&joint_move(shifted(home, [0.4, 0.0, 0.0, 0.0, 0.0, 0.0]))).unwrap();
    let seen = turn_until(&mut robot, acknowledged(sequence));
    let target_rest_s = seen.iter().rfind(|(_, s)| s.target_joint_speeds_rad_s[0] > 0.0).unwrap().0.seconds();
    let steady_s = seen[seen.len() - 1].0.seconds();
    for _ in 0..100 {
        turn(&mut robot);
    }
    let truth = sim.truth();
    let end_s = sim.clock().seconds();
    let above = |joint_rad_s, tcp_m_s| truth.last_above(joint_rad_s, tcp_m_s, began_s, end_s);
    // Joint 0 moves at up to 0.75 rad/s, the TCP on a lever of 0.3 to 0.6 m.
    assert_eq!(above(1.0, 1.0), None);
    let fast_s = above(0.7, 1.0).unwrap();
    assert!(fast_s < target_rest_s && fast_s > began_s);
    assert_eq!(above(1.0, 0.01).map(|at_s| at_s < steady_s), Some(true));
    // Ringing goes on after the targets have come to rest.
    let ringing_s = above(1.0, 1e-3).unwrap();
    assert!(ringing_s > target_rest_s + 0.02 && ringing_s < steady_s, "{target_rest_s} {ringing_s} {steady_s}");
    assert_eq!(truth.last_above(2e-3, 2e-3, steady_s, end_s), None);
    // What is not known does not count as still.
    assert_eq!(truth.last_above(1.0, 1.0, began_s, end_s + 1.0), Some(end_s + 1.0));
    assert_eq!(truth.last_above(1.0, 1.0, -1.0, end_s), Some(end_s));
    assert_eq!(truth.last_above(f64::NAN, 1.0, began_s, end_s), Some(end_s));
    assert!(truth.base_from_flange_at(began_s).is_some());
}
