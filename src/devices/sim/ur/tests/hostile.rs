//! Clients that mean no good, and a client that wants every cycle.

use super::raw::{End, INPUT, Raw};
use super::*;
use crate::devices::rtde::{Answer, FieldAnswer, Package, Request};

#[test]
fn slow_and_deaf_clients_disturb_nobody() {
    let sim = simulator(SimUrConfig::default(), 41);
    let ports = sim.ports();
    let all = [ports.rtde, ports.primary, ports.secondary, ports.realtime, ports.dashboard];
    let mut slow: Vec<_> = all.iter().map(|port| raw_stream(&sim, *port)).collect();
    // Never reads, and asks for everything that it can get.
    let mut deaf = Raw::agreed(&sim);
    deaf.set_up_outputs(500.0, &["timestamp", "actual_q", "actual_qd", "target_q", "actual_TCP_pose"]).unwrap();
    deaf.send(&Request::Start);
    let mut robot = connect(&sim);
    let home = turn(&mut robot).1.target_joints_rad;
    let sequence = robot.start_move(&joint_move(shifted(home, [0.3; 6]))).unwrap();
    for (i, byte) in b"\0\x1dOdef x(".iter().enumerate() {
        slow.iter_mut().for_each(|stream| stream.write_all(&[*byte]).unwrap());
        for _ in 0..i {
            turn(&mut robot);
        }
    }
    let seen = turn_until(&mut robot, acknowledged(sequence));
    assert!(seen.windows(2).all(|w| w[1].0.0 - w[0].0.0 == 8_000_000));
    let asked = b"robotmode\n".repeat(30_000);
    let mut flood = raw_stream(&sim, ports.dashboard);
    flood.set_write_timeout(Some(Duration::from_millis(200))).unwrap();
    let _ = flood.write_all(&asked);
    turn_until(&mut robot, |s| s.controller_time_s > 105.0);
    robot.finish(None).unwrap();
}

#[test]
fn so_many_connections_are_refused_and_forgotten() {
    let sim = simulator(SimUrConfig::default(), 42);
    let many: Vec<_> = (0..64).map(|_| Raw::open(&sim)).collect();
    let mut served = 0;
    for mut raw in many {
        let silence = Duration::from_millis(2);
        served += usize::from(raw.read_all(silence).1 == End::Silent);
    }
    assert_eq!(served, 32, "the others are closed at once");
    let mut robot = connect(&sim);
    turn(&mut robot);
}

#[test]
fn set_ups_that_cannot_be_are_refused() {
    let sim = simulator(SimUrConfig::default(), 43);
    let mut raw = Raw::agreed(&sim);
    // Our own encoder would refuse 2049 bytes.
    let most = "timestamp,".repeat(202);
    for (last, good) in [("safety_status_bits,target_qd", true), ("safety_status_bits,robot_mode", false)] {
        let names = format!("{most}{last}");
        assert_eq!(names.len(), if good { 2048 } else { 2049 });
        let payload = [&125.0_f64.to_be_bytes()[..], names.as_bytes()].concat();
        let package = Package { kind: b'O', payload: payload.into() };
        raw.stream.write_all(&package.to_bytes().unwrap()).unwrap();
        let answer = raw.next().unwrap();
        match answer {
            Answer::SetupOutputs { recipe, .. } => assert_eq!(recipe == 1, good, "{} bytes", names.len()),
            Answer::Text(text) => assert!(text.message.contains("2048") && !good, "{text:?}"),
            other => panic!("{other:?}"),
        }
    }
    raw.outputs = raw.set_up_outputs(125.0, &["timestamp"]).unwrap();
    assert_eq!(raw.ask(&Request::Start), Answer::Start(true));
    raw.send(&Request::SetupOutputs { frequency_hz: 1.0, names: vec!["robot_mode".into()] });
    let text = loop {
        match raw.next().unwrap() {
            Answer::Data { .. } => {}
            other => break other,
        }
    };
    assert!(matches!(&text, Answer::Text(text) if text.message.contains("paused")), "{text:?}");
    raw.number().unwrap();
    assert_eq!(raw.ask(&Request::Pause), Answer::Pause(true));
    raw.set_up_outputs(125.0, &["timestamp", "robot_mode"]).unwrap();
}

#[test]
fn inputs_have_one_owner_until_it_dies() {
    let sim = simulator(SimUrConfig::default(), 44);
    let owner = Raw::driving(&sim, 125.0, &["timestamp"]);
    let mut other = Raw::agreed(&sim);
    assert_eq!(other.set_up_inputs(&[INPUT]).unwrap_err(), [FieldAnswer::InUse]);
    other.set_up_inputs(&["input_int_register_31"]).unwrap();
    drop(owner);
    let freed = std::iter::repeat_with(|| other.set_up_inputs(&[INPUT])).take(1000).any(|answer| answer.is_ok());
    assert!(freed);
    let mut third = Raw::agreed(&sim);
    assert_eq!(third.set_up_inputs(&[INPUT]).unwrap_err(), [FieldAnswer::InUse]);
}

#[test]
fn every_cycle_of_500_hz_is_sent_in_real_time() {
    let config = SimUrConfig { lock_step_patience: Duration::ZERO, time_scale: 1.0, ..SimUrConfig::default() };
    let sim = simulator(config, 45);
    let mut raw = Raw::driving(&sim, 500.0, &["timestamp", "actual_q", "actual_qd", "actual_TCP_pose"]);
    let first = raw.number().unwrap();
    #[expect(clippy::disallowed_methods, reason = "measures the simulator")]
    let began = std::time::Instant::now();
    let mut last = first;
    while last - first < 3.0 {
        let stamp = raw.number().unwrap();
        raw.answer();
        assert!((stamp - last - 0.002).abs() < 1e-6, "{stamp} after {last}");
        last = stamp;
    }
    let took_s = began.elapsed().as_secs_f64();
    // Never faster than real time; a machine that halts for more than 50 ms may be slower.
    assert!(took_s > 2.9 && took_s < 6.0, "{took_s}");
}
