//! 500 samples a second, for a minute here and for an hour by hand (`CELLCAL_SOAK_S=3600`): nothing that was sent
//! is lost, nothing grows.

use std::net::{IpAddr, SocketAddr};
use std::process::{Child, Command, Stdio};

use cellcal::devices::Robot as _;
use cellcal::devices::rtde::Value;

use crate::bench::Bench;
use crate::bench::rtde_client::Watcher;

fn seconds() -> f64 {
    std::env::var("CELLCAL_SOAK_S").ok().and_then(|s| s.parse().ok()).unwrap_or(60.0)
}

/// A process that ends with the test.
struct Ended(Child);

impl Ended {
    fn spawn(arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_cellcal"));
        let command = command.args(arguments).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        Self(command.spawn().unwrap())
    }

    fn resident_bytes(&self) -> u64 {
        let text = std::fs::read_to_string(format!("/proc/{}/statm", self.0.id())).unwrap();
        text.split_whitespace().nth(1).and_then(|pages| pages.parse::<u64>().ok()).unwrap() * 4096
    }
}

impl Drop for Ended {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn in_real_time_no_package_is_lost_and_nothing_grows() {
    let host: IpAddr = "127.0.0.33".parse().unwrap();
    let controller = Ended::spawn(&["sim", "ur", "--host", &host.to_string()]);
    let address = SocketAddr::new(host, 30004);
    let mut watcher = Watcher::connect(address, &["timestamp", "actual_q", "actual_TCP_pose"]);
    let mut client = Ended::spawn(&["robot", "status", "--address", &host.to_string(), "--watch", "--json"]);
    let time = |values: &[Value]| match values.first() {
        Some(Value::Double(at_s)) => *at_s,
        other => panic!("{other:?}"),
    };
    let first_s = time(&watcher.next());
    let (mut last_s, mut warm) = (first_s, None);
    while last_s - first_s < seconds() {
        let now_s = time(&watcher.next());
        assert!((now_s - last_s - 0.002).abs() < 1e-6, "from {last_s} s to {now_s} s");
        last_s = now_s;
        if warm.is_none() && now_s - first_s > 0.3 * seconds() {
            warm = Some([controller.resident_bytes(), client.resident_bytes()]);
        }
    }
    // A busy machine may starve the client of fresh samples, which it must not pass over in silence.
    let silent = client.0.try_wait().unwrap();
    assert!(silent.is_none_or(|ended| ended.code() == Some(1)), "{silent:?}");
    let now = [controller.resident_bytes(), if silent.is_none() { client.resident_bytes() } else { 0 }];
    for (before, now) in warm.unwrap().into_iter().zip(now) {
        assert!(now.saturating_sub(before) < 4 << 20, "{before} bytes have become {now}");
    }
}

#[test]
fn the_driver_at_500_hz_misses_no_cycle() {
    let bench = Bench::new(Vec::new());
    let mut config = bench.robot_config();
    config.frequency_hz = 500.0;
    let clock = std::sync::Arc::new(bench.sim.clock());
    let mut robot = cellcal::devices::ur::UrRobot::connect(&config, clock).unwrap();
    let mut last_s = None::<f64>;
    for _ in 0..(seconds() * 500.0) as usize {
        let (_, sample) = robot.next_sample().unwrap();
        robot.heartbeat().unwrap();
        let now_s = sample.controller_time_s;
        assert!(last_s.is_none_or(|last| (now_s - last - 0.002).abs() < 1e-6), "from {last_s:?} s to {now_s} s");
        last_s = Some(now_s);
    }
}
