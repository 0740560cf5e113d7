//! Faults of the network, as a client sees them on the wire.

use super::raw::{End, INPUT, Raw};
use super::*;
use crate::devices::rtde::{Answer, DataType, FieldAnswer, Request, Value};

/// Real time without a byte that counts as silence here.
const SILENCE: Duration = Duration::from_millis(60);

const BOOT_S: f64 = 100.0;

fn faulty(faults: &[&str]) -> SimController {
    let faults = faults.iter().map(|text| text.parse().unwrap()).collect();
    simulator(SimUrConfig { faults, ..SimUrConfig::default() }, 21)
}

fn fault(text: &str) -> Fault {
    text.parse().unwrap()
}

/// How late samples are when they arrive in full, ms of simulated time; time stands meanwhile.
fn latenesses_ms(faults: &[&str], frequency_hz: f64, outputs: &[&str], samples: usize) -> Vec<u32> {
    let sim = faulty(faults);
    let mut raw = Raw::driving(&sim, frequency_hz, outputs);
    let mut lateness_ms = || {
        let sampled_s = raw.number().unwrap() - BOOT_S;
        let late_s = sim.clock().seconds() - sampled_s;
        raw.answer();
        (late_s * 1e3).round() as u32
    };
    (0..samples).map(|_| lateness_ms()).collect()
}

#[test]
fn pieces_of_a_package_take_several_cycles_but_less_than_20_ms() {
    // 13 bytes with the header: 13 pieces of 1 byte over 9 cycles, 3 of 5 over 3, 1 of 13.
    for (bytes, late_ms) in [(1, 16), (5, 4), (13, 0), (100, 0)] {
        let fragment = format!("fragment:{bytes}@connect");
        let seen = latenesses_ms(&[&fragment], 125.0, &["timestamp"], 40);
        assert_eq!(seen, vec![late_ms; 40], "{fragment}");
        // Faster than a package takes: packages queue, and are not later for it.
        assert_eq!(latenesses_ms(&[&fragment], 500.0, &["timestamp"], 40), vec![late_ms; 40], "{fragment} at 500 Hz");
    }
}

#[test]
fn pieces_are_read_one_by_one() {
    let faults = vec!["fragment:20@connect".parse().unwrap()];
    // Cycles of 10 ms: a busy machine does not read several pieces together every time.
    let sim = simulator(SimUrConfig { time_scale: 0.2, faults, ..SimUrConfig::default() }, 22);
    let mut raw = Raw::driving(&sim, 50.0, &["timestamp", "actual_q", "actual_qd"]);
    raw.reads.clear();
    for _ in 0..3 {
        raw.number().unwrap();
        raw.answer();
    }
    // 108 bytes.
    assert!(raw.reads.contains(&20) && raw.reads.iter().any(|size| size % 20 == 8), "{:?}", raw.reads);
}

#[test]
fn the_driver_moves_over_a_network_that_cuts_and_delays() {
    for faults in [&["fragment:1@connect"][..], &["late:20@connect", "jitter:15@connect", "fragment:7@connect"]] {
        let sim = faulty(faults);
        let mut robot = connect(&sim);
        let home = turn(&mut robot).1.target_joints_rad;
        let sequence = robot.start_move(&joint_move(shifted(home, [0.1; 6]))).unwrap();
        let seen = turn_until(&mut robot, acknowledged(sequence));
        assert_eq!(seen[seen.len() - 1].1.executor_state, ExecutorState::Steady, "{faults:?}");
        assert_eq!(sim.motions_begun(), 1);
        robot.finish(None).unwrap();
    }
}

#[test]
fn coalesced_packages_come_at_once() {
    let seen = latenesses_ms(&["coalesce:5@connect"], 125.0, &["timestamp"], 20);
    assert_eq!(seen, [32, 24, 16, 8, 0].repeat(4));
}

#[test]
fn a_client_may_pass_over_late_packages() {
    let sim = faulty(&["coalesce:4@connect"]);
    let mut raw = Raw::driving(&sim, 125.0, &["timestamp"]);
    for _ in 0..5 {
        let stamps: Vec<_> = (0..4).map(|_| raw.number().unwrap()).collect();
        assert!((stamps[3] - stamps[0] - 0.024).abs() < 1e-9, "{stamps:?}");
        raw.answer();
    }
}

#[test]
fn delays_are_of_the_size_asked_for_and_the_same_for_a_seed() {
    assert_eq!(latenesses_ms(&["late:40@connect"], 125.0, &["timestamp"], 30), [40; 30]);
    let jitter = || latenesses_ms(&["jitter:30@connect"], 125.0, &["timestamp"], 200);
    let seen = jitter();
    assert!(seen.iter().all(|late| *late <= 30), "{seen:?}");
    assert!(seen.iter().any(|late| *late < 8) && seen.iter().any(|late| *late > 22), "{seen:?}");
    assert_eq!(seen, jitter());
}

#[test]
fn what_is_put_into_the_stream_arrives_as_it_says() {
    let after = |text: &str| {
        let sim = faulty(&[]);
        let mut raw = Raw::driving(&sim, 125.0, &["timestamp"]);
        raw.number().unwrap();
        sim.handle().inject_fault(fault(text));
        raw.answer();
        (sim, raw)
    };
    let (_sim, mut raw) = after("unknown");
    let package = raw.next_package().unwrap();
    assert_eq!((package.kind, &package.payload[..]), (b'Z', &b"cellcal"[..]));
    raw.number().unwrap();
    let (_sim, mut raw) = after("text");
    assert!(matches!(raw.next(), Ok(Answer::Text(text)) if text.message == "by order"));
    raw.number().unwrap();
    for (size, header) in [("size:0", [0, 0, b'U']), ("size:2", [0, 2, b'U']), ("size:65535", [0xff, 0xff, b'U'])] {
        let (_sim, mut raw) = after(size);
        let (bytes, end) = raw.read_all(SILENCE);
        assert_eq!((&bytes[..3], end), (&header[..], End::Silent), "{size}");
        assert_eq!(bytes.len(), 3 + 12, "the next sample comes behind it");
    }
    let (_sim, mut raw) = after("garbage");
    let (bytes, _) = raw.read_all(SILENCE);
    assert_eq!(bytes.len(), 100 + 12);
    assert!((30..80).contains(&bytes[..100].iter().filter(|b| **b > 127).count()), "{bytes:?}");
}

#[test]
fn handshakes_go_wrong_as_asked() {
    let sim = faulty(&["wrong_protocol@connect"]);
    assert_eq!(Raw::open(&sim).ask(&Request::ProtocolVersion(2)), Answer::ProtocolVersion(false));
    let sim =
        faulty(&["missing_field:payload@connect", "wrong_type:actual_q@start", "in_use:input_int_register_30@connect"]);
    let mut raw = Raw::agreed(&sim);
    let fields = raw.set_up_outputs(125.0, &["timestamp", "payload", "actual_q"]).unwrap_err();
    assert_eq!(
        fields,
        [FieldAnswer::Typed(DataType::Double), FieldAnswer::NotFound, FieldAnswer::Typed(DataType::Double)]
    );
    raw.outputs = raw.set_up_outputs(125.0, &["actual_q"]).unwrap();
    assert_eq!(raw.set_up_inputs(&[INPUT]).unwrap_err(), [FieldAnswer::InUse]);
    assert_eq!(raw.ask(&Request::Start), Answer::Start(true));
    assert_eq!(raw.values().unwrap(), [Value::Double(0.0)], "values have the type that was told");
    let sim = faulty(&["no_start@connect", "nan:actual_q@connect"]);
    let mut raw = Raw::agreed(&sim);
    raw.outputs = raw.set_up_outputs(125.0, &["timestamp", "actual_q", "robot_mode"]).unwrap();
    assert_eq!(raw.ask(&Request::Start), Answer::Start(false));
    sim.handle().inject_fault(Fault::Heal);
    sim.handle().inject_fault(fault("nan:actual_q"));
    assert_eq!(raw.ask(&Request::Start), Answer::Start(true));
    let values = raw.values().unwrap();
    assert!(
        matches!(values[..], [Value::Double(t), Value::Vector6d(q), Value::Int32(7)] if t.is_finite() && q.iter().all(|x| x.is_nan()))
    );
}

#[test]
fn connections_end_as_asked_and_new_ones_are_accepted() {
    for (text, wanted) in [("drop", End::Closed), ("reset", End::Reset)] {
        let sim = faulty(&[]);
        let mut raw = Raw::driving(&sim, 125.0, &["timestamp"]);
        let dashboard = raw_stream(&sim, sim.ports().dashboard);
        raw.number().unwrap();
        sim.handle().inject_fault(fault(text));
        assert_eq!(raw.read_all(SILENCE), (Vec::new(), wanted), "{text}");
        let mut dashboard = dashboard;
        let read = std::io::Read::read_to_end(&mut dashboard, &mut Vec::new());
        assert_eq!(read.is_ok(), wanted == End::Closed, "{text}: {read:?}");
        assert!(Raw::driving(&sim, 125.0, &["timestamp"]).number().unwrap() > BOOT_S);
        let sim = faulty(&[&format!("{text}@connect")]);
        assert_eq!(Raw::open(&sim).read_all(SILENCE), (Vec::new(), wanted), "{text} while connecting");
        Raw::driving(&sim, 125.0, &["timestamp"]).number().unwrap();
    }
}

#[test]
fn refused_connections_end_at_once_until_healing() {
    let sim = faulty(&["refuse@connect", "heal@t:1"]);
    assert_eq!(Raw::open(&sim).read_all(SILENCE).1, End::Closed);
    let error = UrRobot::connect(&driver_config(&sim), Arc::new(sim.clock()));
    assert!(error.is_err(), "{error:?}");
    sim.handle().inject_fault(Fault::Heal);
    let mut raw = Raw::driving(&sim, 125.0, &["timestamp"]);
    raw.number().unwrap();
    sim.handle().inject_fault(Fault::Refuse);
    raw.answer();
    raw.number().unwrap();
    assert_eq!(Raw::open(&sim).read_all(SILENCE).1, End::Closed, "and open ones stay open");
}

#[test]
fn a_stalled_network_delivers_late_when_it_comes_back() {
    let sim = faulty(&[]);
    let mut raw = Raw::driving(&sim, 125.0, &["timestamp"]);
    let first_s = raw.number().unwrap();
    let stalled_s = sim.clock().seconds();
    sim.handle().inject_fault(Fault::Stall);
    raw.answer();
    assert_eq!(raw.read_all(SILENCE), (Vec::new(), End::Silent));
    assert_eq!(Raw::open(&sim).read_all(SILENCE), (Vec::new(), End::Silent), "a new one is open and silent");
    wait_for("time to run", || sim.clock().seconds() > stalled_s + 0.15);
    sim.handle().inject_fault(Fault::Heal);
    raw.stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let old_s = raw.number().unwrap();
    assert!((old_s - first_s - 0.008).abs() < 1e-9, "what waited comes first");
    assert!(sim.clock().seconds() - (old_s - BOOT_S) > 0.1);
    raw.turn_until(|values| matches!(values[..], [Value::Double(at_s)] if at_s > first_s + 1.0));
}

#[test]
fn a_mute_controller_sends_nothing_and_time_runs_at_real_pace() {
    let sim = faulty(&["mute@t:0.5", "heal@t:0.7"]);
    let mut raw = Raw::driving(&sim, 125.0, &["timestamp"]);
    let mut last_s = raw.number().unwrap();
    #[expect(clippy::disallowed_methods, reason = "measures the simulator")]
    let began = std::time::Instant::now();
    let step_s = loop {
        raw.answer();
        let now_s = raw.number().unwrap();
        if now_s - last_s > 0.01 {
            break now_s - last_s;
        }
        last_s = now_s;
    };
    assert!((step_s - 0.2).abs() < 0.009, "{step_s}");
    assert!(began.elapsed().as_secs_f64() > 0.18);
}

#[test]
fn a_restart_forgets_everything_but_the_arm() {
    let fields =
        ["timestamp", "robot_mode", "runtime_state", "target_q", "output_int_register_24", "input_int_register_30"];
    for (text, modes) in [("restart", vec![7]), ("boot", vec![2, 3])] {
        let sim = faulty(&[]);
        let mut robot = connect(&sim);
        let home = turn(&mut robot).1.target_joints_rad;
        robot.start_move(&joint_move(shifted(home, [0.5; 6]))).unwrap();
        turn_until(&mut robot, |s| s.target_joint_speeds_rad_s[0] > 0.5);
        let boot_s = sim.clock().seconds();
        sim.handle().inject_fault(fault(text));
        let error = (0..5).find_map(|_| robot.next_sample().and_then(|_| robot.heartbeat()).err());
        assert!(error.is_some());
        let mut raw = Raw::driving(&sim, 125.0, &fields);
        let first = raw.values().unwrap();
        let [
            Value::Double(stamp_s),
            Value::Int32(mode),
            Value::Uint32(1),
            Value::Vector6d(joints),
            Value::Int32(0),
            Value::Int32(0),
        ] = first[..]
        else {
            panic!("{text}: {first:?}")
        };
        // Time ran on after the last heartbeat, by up to one sample.
        assert!((stamp_s - (sim.clock().seconds() - boot_s)).abs() < 0.009, "{text}: {stamp_s}");
        assert!(joints[0] > home[0] + 0.05 && joints[0] < home[0] + 0.2, "{text}: it stays where it is");
        assert_eq!(mode, modes[0], "{text}");
        let last = raw.turn_until(|values| matches!(values[..], [Value::Double(at_s), ..] if at_s > 5.01));
        assert_eq!(last[1], Value::Int32(modes[modes.len() - 1]), "{text}");
    }
}

#[test]
fn the_clock_jumps_back_on_an_open_connection() {
    let sim = faulty(&["clock_back:3@t:0.1"]);
    let mut raw = Raw::driving(&sim, 125.0, &["timestamp"]);
    let stamps: Vec<_> = (0..30).map(|_| raw.number().inspect(|_| raw.answer()).unwrap()).collect();
    let steps: Vec<_> = stamps.windows(2).map(|w| ((w[1] - w[0]) * 1e3).round()).collect();
    assert_eq!(steps.iter().filter(|step| **step == 8.0).count(), 28, "{steps:?}");
    assert_eq!(steps.iter().filter(|step| **step == -2992.0).count(), 1, "{steps:?}");
}
