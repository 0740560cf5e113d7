//! The driver against the simulated controller, over sockets.

mod hostile;
mod network_faults;
mod raw;
mod robot_faults;
mod services;

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::time::Duration;

use super::*;
use crate::devices::ur::{UrConfig, UrRobot, read_kinematics};
use crate::devices::{Robot as _, RobotError};
use crate::geometry::kinematics::{Dh, Joints};
use crate::geometry::{Base, Flange, Transform};
use crate::session::{ExecutorState, MoveTarget, RobotSample, Stamp};

/// Real time after which a test gives up.
const PATIENCE: Duration = Duration::from_secs(10);

fn simulator(config: SimUrConfig, seed: u64) -> SimController {
    SimController::start(config, seed).unwrap()
}

fn driver_config(sim: &SimController) -> UrConfig {
    let ports = sim.ports();
    UrConfig {
        rtde_port: ports.rtde,
        script_port: ports.secondary,
        primary_port: ports.primary,
        dashboard_port: Some(ports.dashboard),
        ..UrConfig::at(sim.address().to_string())
    }
}

fn connect_only(sim: &SimController, config: &UrConfig) -> Result<UrRobot, RobotError> {
    UrRobot::connect(config, Arc::new(sim.clock()))
}

/// Connects and starts the motion script.
fn connect(sim: &SimController) -> UrRobot {
    let mut robot = connect_only(sim, &driver_config(sim)).unwrap();
    robot.start_program().unwrap();
    turn_until(&mut robot, |s| s.executor_state == ExecutorState::Idle);
    robot
}

/// One turn of the loop that a session runs.
fn turn(robot: &mut UrRobot) -> (Stamp, RobotSample) {
    let sample = robot.next_sample().unwrap();
    robot.heartbeat().unwrap();
    sample
}

/// Turns until `done`, at most 60 simulated seconds.
fn turn_until(robot: &mut UrRobot, done: impl Fn(&RobotSample) -> bool) -> Vec<(Stamp, RobotSample)> {
    let mut seen = Vec::new();
    for _ in 0..60 * 125 {
        seen.push(turn(robot));
        if done(&seen[seen.len() - 1].1) {
            return seen;
        }
    }
    panic!("never came; last: {:?}", seen.last());
}

fn joint_move(joints_rad: Joints) -> MoveTarget {
    MoveTarget::Joint { joints_rad, speed_rad_s: 1.0, acceleration_rad_s2: 1.4 }
}

fn acknowledged(sequence: i32) -> impl Fn(&RobotSample) -> bool {
    move |s| s.executor_sequence == sequence
}

fn shifted(joints: Joints, by: Joints) -> Joints {
    std::array::from_fn(|i| joints[i] + by[i])
}

/// Waits in real time for something that no client drives.
fn wait_for(what: &str, done: impl Fn() -> bool) {
    for _ in 0..PATIENCE.as_millis() {
        if done() {
            return;
        }
        pause(Duration::from_millis(1));
    }
    panic!("{what}: not within {PATIENCE:?}");
}

#[expect(clippy::disallowed_methods, reason = "waits for the simulator's own thread")]
fn pause(time: Duration) {
    std::thread::sleep(time);
}

#[test]
fn a_joint_move_arrives_and_is_steady() {
    let sim = simulator(SimUrConfig::default(), 1);
    let mut robot = connect(&sim);
    assert_eq!(robot.controller_version().to_string(), "5.12.4.1101");
    assert_eq!(robot.robot_info().remote_control, Some(true));
    assert_eq!(robot.robot_info().serial.as_deref(), Some("20235500001"));
    let (_, first) = turn(&mut robot);
    assert_eq!((first.robot_mode, first.safety_mode, first.runtime_state), (7, 1, 2));
    let to = shifted(first.target_joints_rad, [0.5, 0.1, -0.2, 0.1, 0.3, 0.4]);
    let sequence = robot.start_move(&joint_move(to)).unwrap();
    let seen = turn_until(&mut robot, acknowledged(sequence));
    let (_, last) = &seen[seen.len() - 1];
    assert_eq!(last.executor_state, ExecutorState::Steady);
    assert!(seen.iter().any(|(_, s)| s.executor_state == ExecutorState::Moving));
    let missed = last.joints_rad.iter().zip(to).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(missed < 1e-4, "{missed}");
    assert!(seen.windows(2).all(|w| w[1].0.0 - w[0].0.0 == 8_000_000), "no sample is lost");
    robot.finish(None).unwrap();
    assert_eq!(robot.next_sample().unwrap().1.runtime_state, 1);
}

#[test]
fn a_line_is_straight_in_the_model_of_the_controller() {
    let offset = [0.02, -0.03, 0.15, 0.1, 0.2, 0.0];
    let config = SimUrConfig { flaws: Flaws::none(), tcp_offset: offset, ..SimUrConfig::default() };
    let sim = simulator(config, 2);
    let mut robot = connect(&sim);
    let start = turn(&mut robot).1.base_from_tcp();
    let mut tcp_pose = start.pose_vector();
    tcp_pose[1] += 0.12;
    tcp_pose[2] -= 0.09;
    let target = MoveTarget::Linear { tcp_pose, speed_m_s: 0.2, acceleration_m_s2: 0.4 };
    let sequence = robot.start_move(&target).unwrap();
    let seen = turn_until(&mut robot, acknowledged(sequence));
    let end = Transform::from_pose_vector(tcp_pose);
    assert!(seen[seen.len() - 1].1.base_from_tcp().distance_to_m(&end) < 1e-6);
    for (_, sample) in &seen {
        let tcp = sample.base_from_tcp();
        let fraction = tcp.distance_to_m(&start) / 0.15;
        assert!(tcp.distance_to_m(&start.interpolate(&end, fraction)) < 1e-6, "{tcp:?}");
        assert!(tcp.angle_to_rad(&start) < 1e-6);
    }
    let fastest = seen.iter().map(|(_, s)| s.tcp_speed[1].hypot(s.tcp_speed[2])).fold(0.0, f64::max);
    assert!((fastest - 0.2).abs() < 2e-3, "{fastest}");
}

#[test]
fn the_same_seed_gives_the_same_samples() {
    let run = |seed| {
        let sim = simulator(SimUrConfig::default(), seed);
        let mut robot = connect(&sim);
        let home = turn(&mut robot).1.target_joints_rad;
        let mut seen = Vec::new();
        for by in [0.2, -0.1] {
            let sequence = robot.start_move(&joint_move(shifted(home, [by; 6]))).unwrap();
            seen.extend(turn_until(&mut robot, acknowledged(sequence)));
        }
        robot.start_move(&joint_move(home)).unwrap();
        (0..50).for_each(|_| seen.push(turn(&mut robot)));
        // Between a sample and its heartbeat, where a session decides: time stands.
        seen.push(robot.next_sample().unwrap());
        robot.stop().unwrap();
        robot.heartbeat().unwrap();
        seen.extend(turn_until(&mut robot, |s| s.runtime_state == 1));
        (0..50).for_each(|_| seen.push(turn(&mut robot)));
        let truth: Vec<_> = seen.iter().filter_map(|(at, _)| sim.truth().base_from_flange_at(at.seconds())).collect();
        (seen, truth)
    };
    let (one, other, third) = (run(7), run(7), run(8));
    assert!(one.0.len() > 200 && one.1.len() > 200);
    let differs = one.0.iter().zip(&other.0).position(|(a, b)| a != b);
    assert_eq!(differs, None, "{:?}", differs.map(|i| (&one.0[i], &other.0[i])));
    assert!(one.0.len() == other.0.len() && one.1 == other.1);
    assert_ne!(one.0[5].1, third.0[5].1);
}

#[test]
fn the_truth_differs_from_what_is_reported_by_the_flaws() {
    let sim = simulator(SimUrConfig::default(), 3);
    let mut robot = connect(&sim);
    for _ in 0..20 {
        turn(&mut robot);
    }
    let (at, sample) = robot.next_sample().unwrap();
    let reported = Transform::<Base, Flange>::from_pose_vector(sample.tcp_pose);
    let truth = sim.truth().base_from_flange_at(at.seconds()).unwrap();
    let error_m = truth.distance_to_m(&reported);
    assert!((0.1e-3..3e-3).contains(&error_m), "{error_m}");
    assert!(sim.truth().base_from_flange_at(at.seconds() + 0.1).is_none(), "time stands until the heartbeat");
    let dh = read_kinematics(&driver_config(&sim)).unwrap().dh;
    assert_eq!(dh, sim.truth().individual().believed);
    assert!(dh.forward(&sample.joints_rad).distance_to_m(&reported) < 1e-9, "{dh:?}");
    assert_ne!(dh, Dh::UR5E);
}

#[test]
fn without_heartbeats_the_controller_stops_the_arm() {
    let patience = Duration::from_millis(100);
    let sim = simulator(SimUrConfig { lock_step_patience: patience, ..SimUrConfig::default() }, 4);
    let mut robot = connect(&sim);
    let home = turn(&mut robot).1.target_joints_rad;
    robot.start_move(&joint_move(shifted(home, [2.0, 0.0, 0.0, 0.0, 0.0, 0.0]))).unwrap();
    turn_until(&mut robot, |s| s.target_joint_speeds_rad_s[0] > 0.99);
    let silent_since_s = sim.clock().seconds();
    // Neither heartbeats nor a closed connection: a hung process.
    wait_for("1 s of simulated time", || sim.clock().seconds() > silent_since_s + 1.0);
    let truth = sim.truth();
    let pose = |after_s: f64| truth.base_from_flange_at(silent_since_s + after_s).unwrap();
    let end = pose(0.99);
    assert!(pose(0.1).distance_to_m(&pose(0.0)) > 0.02, "it was moving");
    assert!(pose(0.3).distance_to_m(&end) < 0.6e-3, "at rest but for the ringing");
    assert!(end.distance_to_m(&pose(0.0)) < 0.3);
}

#[test]
fn a_dead_client_stops_the_arm_and_another_may_connect() {
    let sim = simulator(SimUrConfig::default(), 5);
    let mut robot = connect(&sim);
    let home = turn(&mut robot).1.target_joints_rad;
    let sequence = robot.start_move(&joint_move(shifted(home, [2.0, 0.0, 0.0, 0.0, 0.0, 0.0]))).unwrap();
    turn_until(&mut robot, |s| s.target_joint_speeds_rad_s[0] > 0.99);
    drop(robot);
    let mut robot = connect(&sim);
    let (_, sample) = turn(&mut robot);
    assert_eq!(sample.target_joint_speeds_rad_s, [0.0; 6]);
    assert!(sample.target_joints_rad[0] < home[0] + 1.9, "the old move is not resumed");
    assert!(sample.executor_sequence >= sequence && sample.executor_state == ExecutorState::Idle);
}

#[test]
fn stop_works_in_the_middle_of_a_move() {
    let sim = simulator(SimUrConfig::default(), 6);
    let mut robot = connect(&sim);
    let home = turn(&mut robot).1.target_joints_rad;
    let sequence = robot.start_move(&joint_move(shifted(home, [2.0, 0.0, 0.0, 0.0, 0.0, 0.0]))).unwrap();
    turn_until(&mut robot, |s| s.target_joint_speeds_rad_s[0] > 0.99);
    robot.stop().unwrap();
    let seen = turn_until(&mut robot, |s| s.runtime_state == 1);
    let (began, ended) = (&seen[0], &seen[seen.len() - 1]);
    assert!(ended.0.seconds() - began.0.seconds() < 0.3);
    assert_eq!(ended.1.target_joint_speeds_rad_s, [0.0; 6]);
    assert!(ended.1.executor_sequence < sequence, "the move was not acknowledged");
    robot.finish(None).unwrap();
}

#[test]
fn targets_outside_the_limits_are_refused_and_nothing_moves() {
    let config = SimUrConfig { safety_box_m: Some([[-1.0, 1.0], [-1.0, 1.0], [0.05, 1.0]]), ..SimUrConfig::default() };
    let sim = simulator(config, 7);
    let mut robot = connect(&sim);
    let home = turn(&mut robot).1;
    let mut below = home.tcp_pose;
    below[2] = -0.1;
    let line = MoveTarget::Linear { tcp_pose: below, speed_m_s: 0.1, acceleration_m_s2: 0.1 };
    let mut far = home.tcp_pose;
    far[0] = 4.0;
    let out_of_reach = MoveTarget::Linear { tcp_pose: far, speed_m_s: 0.1, acceleration_m_s2: 0.1 };
    let turned = joint_move([0.0, -1.6, 4.0, 0.0, 0.0, 0.0]);
    for target in [line, out_of_reach, turned] {
        let sequence = robot.start_move(&target).unwrap();
        let seen = turn_until(&mut robot, acknowledged(sequence));
        assert_eq!(seen[seen.len() - 1].1.executor_state, ExecutorState::Refused, "{target:?}");
        assert!(seen.iter().all(|(_, s)| s.target_joints_rad == home.target_joints_rad));
    }
    let again = robot.start_move(&joint_move(shifted(home.target_joints_rad, [0.1; 6]))).unwrap();
    turn_until(&mut robot, acknowledged(again));
    let fast = MoveTarget::Joint { joints_rad: [0.0; 6], speed_rad_s: 2.0, acceleration_rad_s2: 1.0 };
    assert!(matches!(robot.start_move(&fast), Err(RobotError::Refused { .. })));
}

#[test]
fn faults_are_seen_in_the_samples() {
    let sim = simulator(SimUrConfig::default(), 8);
    let mut robot = connect(&sim);
    let handle = sim.handle();
    robot.next_sample().unwrap();
    handle.set_digital_input(3, true);
    robot.heartbeat().unwrap();
    assert_eq!(turn(&mut robot).1.digital_inputs, 8);
    let home = turn(&mut robot).1.target_joints_rad;
    robot.start_move(&joint_move(shifted(home, [1.0; 6]))).unwrap();
    turn_until(&mut robot, |s| s.target_joint_speeds_rad_s[0] > 0.5);
    handle.protective_stop();
    let seen = turn_until(&mut robot, |s| s.target_joint_speeds_rad_s == [0.0; 6]);
    let (_, last) = &seen[seen.len() - 1];
    assert_eq!((last.safety_mode, last.runtime_state), (3, 4));
    assert_eq!(last.safety_status_bits, 1 << 2 | 1 << 10);
    robot.finish(None).unwrap();
    handle.power_off();
    let off = turn_until(&mut robot, |s| s.robot_mode == 3);
    assert_eq!(off[off.len() - 1].1.robot_status_bits & 1, 0);
    drop(robot);
    handle.emergency_stop();
    handle.recover();
    connect(&sim);
}

#[test]
fn silence_garbage_and_a_closed_connection_are_errors() {
    let after = |disturb: fn(&SimHandle)| {
        let sim = simulator(SimUrConfig::default(), 9);
        let mut robot = connect(&sim);
        turn(&mut robot);
        disturb(&sim.handle());
        let before_s = sim.clock().seconds();
        // Samples that were on their way may still come.
        let error = (0..5).find_map(|_| robot.next_sample().and_then(|_| robot.heartbeat()).err());
        let error = error.expect("the driver must notice");
        assert!(robot.next_sample().is_err(), "and stay broken");
        (error, sim.clock().seconds() - before_s)
    };
    let (error, _) = after(|h| h.mute(true));
    assert!(matches!(error, RobotError::Silent { silent_s } if silent_s >= 0.1), "{error}");
    for garbage in
        [vec![0, 0, 0], vec![0, 2, 85], vec![0xff; 70_000], vec![0, 3, 1], vec![0, 5, 85, 1, 1], vec![0, 4, 83, 1]]
    {
        let sim = simulator(SimUrConfig::default(), 9);
        let mut robot = connect(&sim);
        sim.handle().inject(garbage.clone());
        let error = (0..5).find_map(|_| robot.next_sample().and_then(|_| robot.heartbeat()).err());
        assert!(matches!(error, Some(RobotError::Protocol { .. })), "{garbage:?}: {error:?}");
    }
    let (error, _) = after(SimHandle::drop_connections);
    assert!(matches!(error, RobotError::Broken { .. }), "{error}");
}

#[test]
fn local_control_and_missing_ports_are_told() {
    let sim = simulator(SimUrConfig { remote_control: false, ..SimUrConfig::default() }, 10);
    let mut robot = connect_only(&sim, &driver_config(&sim)).unwrap();
    assert_eq!(robot.facts().remote_control, Some(false));
    robot.start_program().unwrap();
    let seen: Vec<_> = (0..100).map(|_| turn(&mut robot)).collect();
    assert!(seen.iter().all(|(_, s)| s.runtime_state == 1 && s.executor_state == ExecutorState::Absent));
    assert!(robot.take_texts().iter().any(|t| t.message.contains("not in remote control")));
    robot.finish(None).unwrap();
    drop(robot);
    let without = UrConfig { dashboard_port: None, ..driver_config(&sim) };
    let robot = connect_only(&sim, &without).unwrap();
    assert_eq!((robot.facts().remote_control, robot.facts().serial), (None, None));
    assert!(robot.facts().kinematics.is_some());
    drop(robot);
    let config = driver_config(&sim);
    drop(sim);
    let error = UrRobot::connect(&config, Arc::new(SimClock::default())).unwrap_err();
    assert!(matches!(error, RobotError::Unreachable { .. }), "{error}");
}

fn raw_stream(sim: &SimController, port: u16) -> TcpStream {
    let stream = TcpStream::connect(SocketAddr::new(sim.address(), port)).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    stream
}

#[test]
fn garbage_does_not_kill_the_controller() {
    let sim = simulator(SimUrConfig::default(), 11);
    let ports = sim.ports();
    for port in [ports.rtde, ports.primary, ports.secondary, ports.realtime, ports.dashboard] {
        for garbage in [vec![0; 100], vec![0xff; 100_000], b"\0\x0b\x49\xff\xff\xff\xff\n(((((\n\"\n".to_vec()] {
            let mut stream = raw_stream(&sim, port);
            let _ = stream.write_all(&garbage);
        }
    }
    let mut robot = connect(&sim);
    turn(&mut robot);
}

#[test]
fn not_a_number_is_not_taken_as_an_input() {
    use crate::devices::rtde::{Answer, DataType, Framer, Recipe, Request, Value};
    let sim = simulator(SimUrConfig::default(), 12);
    let mut stream = raw_stream(&sim, sim.ports().rtde);
    let name = || vec!["input_double_register_24".to_owned()];
    for request in [Request::ProtocolVersion(2), Request::SetupInputs { names: name() }] {
        stream.write_all(&request.to_bytes().unwrap()).unwrap();
    }
    let recipe = Recipe { id: 1, types: vec![DataType::Double] };
    for value in [4.5, f64::NAN] {
        stream.write_all(&recipe.encode(&[Value::Double(value)]).unwrap()).unwrap();
    }
    for request in [Request::SetupOutputs { frequency_hz: 500.0, names: name() }, Request::Start] {
        stream.write_all(&request.to_bytes().unwrap()).unwrap();
    }
    let (mut framer, mut texts) = (Framer::default(), 0);
    loop {
        let mut bytes = [0; 4096];
        let count = stream.read(&mut bytes).unwrap();
        framer.push(&bytes[..count]).unwrap();
        while let Some(package) = framer.next_package().unwrap() {
            match Answer::from_package(package).unwrap() {
                Answer::Text(text) => texts += usize::from(text.message.contains("not finite")),
                Answer::Data { body, .. } => {
                    assert_eq!(recipe.decode(&body).unwrap(), [Value::Double(4.5)]);
                    assert_eq!(texts, 1);
                    return;
                }
                _ => {}
            }
        }
    }
}

#[test]
fn an_unknown_function_aborts_the_program_with_a_text() {
    let sim = simulator(SimUrConfig::default(), 13);
    let mut robot = connect(&sim);
    let mut script = raw_stream(&sim, sim.ports().realtime);
    for piece in ["def broken():\n  sleep(0", ".02)\n  servo_to_the_moon()\n", "end", "\n"] {
        script.write_all(piece.as_bytes()).unwrap();
    }
    turn_until(&mut robot, |s| s.runtime_state == 1);
    let texts = robot.take_texts();
    assert!(texts.iter().any(|t| t.message.contains("function `servo_to_the_moon` is not known")), "{texts:?}");
}

#[test]
fn time_keeps_its_scale_with_a_driving_client() {
    let sim = simulator(SimUrConfig { time_scale: 4.0, ..SimUrConfig::default() }, 15);
    let mut robot = connect(&sim);
    #[expect(clippy::disallowed_methods, reason = "measures the simulator")]
    let began = std::time::Instant::now();
    let began_s = sim.clock().seconds();
    while sim.clock().seconds() < began_s + 1.0 {
        turn(&mut robot);
    }
    // A busy machine may only be slower; a little is caught up.
    assert!(began.elapsed().as_secs_f64() > 0.2, "{:?}", began.elapsed());
}

#[test]
fn lock_step_is_fast() {
    let sim = simulator(SimUrConfig::default(), 14);
    let mut robot = connect(&sim);
    let home = turn(&mut robot).1.target_joints_rad;
    #[expect(clippy::disallowed_methods, reason = "measures the simulator")]
    let now = std::time::Instant::now;
    let (began, began_s) = (now(), sim.clock().seconds());
    for by in [0.3, 0.0] {
        let sequence = robot.start_move(&joint_move(shifted(home, [by; 6]))).unwrap();
        turn_until(&mut robot, acknowledged(sequence));
    }
    let (real_s, sim_s) = (began.elapsed().as_secs_f64(), sim.clock().seconds() - began_s);
    let factor = sim_s / real_s;
    // On an idle machine several times more; a busy one must not fail the build.
    assert!(factor > 5.0, "{sim_s:.2} s simulated in {real_s:.3} s: factor {factor:.0}");
    if std::env::var_os("CELLCAL_TIMES").is_some() {
        std::io::stderr().write_all(format!("lock-step: {factor:.0} times real time\n").as_bytes()).unwrap();
    }
}
