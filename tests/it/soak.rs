//! 500 samples a second, for a minute here and for an hour by hand (`CELLCAL_SOAK_S=3600`): nothing is lost,
//! nothing grows.

use std::net::SocketAddr;
use std::time::Duration;

use cellcal::devices::Robot as _;
use cellcal::devices::rtde::Value;
use cellcal::devices::sim::ur::{SimController, SimUrConfig};

use crate::bench::Bench;
use crate::bench::rtde_client::Watcher;

/// Memory that may come and go in a process that runs other tests beside this one is not looked at: the
/// driver is measured in a process of its own where the time is set by hand.
fn seconds() -> f64 {
    std::env::var("CELLCAL_SOAK_S").ok().and_then(|s| s.parse().ok()).unwrap_or(60.0)
}

fn resident_bytes() -> u64 {
    let text = std::fs::read_to_string("/proc/self/statm").unwrap();
    text.split_whitespace().nth(1).and_then(|pages| pages.parse::<u64>().ok()).unwrap() * 4096
}

#[test]
fn no_package_is_lost_in_real_time() {
    let config = SimUrConfig { time_scale: 1.0, lock_step_patience: Duration::ZERO, ..SimUrConfig::default() };
    let sim = SimController::start(config, 1).unwrap();
    let address = SocketAddr::new(sim.address(), sim.ports().rtde);
    let mut watcher = Watcher::connect(address, &["timestamp", "actual_q", "actual_TCP_pose"]);
    let time = |values: &[Value]| match values.first() {
        Some(Value::Double(at_s)) => *at_s,
        other => panic!("{other:?}"),
    };
    let first_s = time(&watcher.next());
    let mut last_s = first_s;
    while last_s - first_s < seconds() {
        let now_s = time(&watcher.next());
        assert!((now_s - last_s - 0.002).abs() < 1e-6, "from {last_s} s to {now_s} s");
        last_s = now_s;
    }
}

#[test]
fn the_driver_loses_nothing_and_does_not_grow() {
    let bench = Bench::new(Vec::new());
    let mut config = bench.robot_config();
    config.frequency_hz = 500.0;
    let clock = std::sync::Arc::new(bench.sim.clock());
    let mut robot = cellcal::devices::ur::UrRobot::connect(&config, clock).unwrap();
    let (mut last_s, mut warm) = (None::<f64>, 0);
    let cycles = (seconds() * 500.0) as usize;
    for cycle in 0..cycles {
        let (_, sample) = robot.next_sample().unwrap();
        robot.heartbeat().unwrap();
        let now_s = sample.controller_time_s;
        assert!(last_s.is_none_or(|last| (now_s - last - 0.002).abs() < 1e-6), "from {last_s:?} s to {now_s} s");
        last_s = Some(now_s);
        if cycle == cycles / 10 {
            warm = resident_bytes();
        }
    }
    // Other tests run in this process: only a soak by hand, alone, can judge memory.
    if std::env::var_os("CELLCAL_SOAK_S").is_some() {
        let grown = resident_bytes().saturating_sub(warm);
        assert!(grown < 2 << 20, "{grown} bytes more than after a tenth of the time");
    }
}
