//! Robot time of the 39 poses: waiting for measured stillness against the published fixed waits.
//!
//! Both walk the same poses on the same simulated arm with the same speeds, in controller time. The fixed scheme is
//! that of the paper's procedure: 1.5 s before and 1.5 s after each capture, and it never looks at the arm.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "a benchmark prints")]

#[path = "../tests/it/bench.rs"]
#[allow(dead_code, reason = "shared with the tests")]
mod bench;

use cellcal::devices::Robot as _;
use cellcal::devices::sim::ur::SimHandle;
use cellcal::session::{Command, ExecutorState};

use bench::{Bench, shipped};

/// Published waits before and after a capture, s.
const DWELL_S: [f64; 2] = [1.5, 1.5];
/// The images of one capture, s: the exposure of the cell and what the cameras need to hand it over.
const CAPTURE_S: f64 = 0.1;

fn main() {
    let ours = measured();
    let fixed = fixed_waits();
    println!("39 poses, controller time from the first move to the end of the last capture:");
    println!("  fixed waits (1.5 s + 1.5 s a pose): {fixed:6.1} s");
    println!("  measured stillness:                 {ours:6.1} s   ratio {:.2}", fixed / ours);
    println!("  published session:                   625.0 s   (its moves are slower too)");
}

fn measured() -> f64 {
    let bench = Bench::with(&shipped("paper-39.yaml"), |_| ());
    let _: SimHandle = bench.handle();
    let clock = bench.sim.clock();
    let (mut first, mut last) = (None, 0.0);
    let ran = bench
        .run(|command| match command {
            Command::Move { .. } => {
                first.get_or_insert(clock.seconds());
            }
            Command::Travel { .. } => last = clock.seconds(),
            _ => {}
        })
        .unwrap();
    assert!(ran.outcome.poses.iter().all(|p| p.capture.is_some()), "{:?}", ran.outcome.end);
    last - first.unwrap()
}

fn fixed_waits() -> f64 {
    let bench = Bench::with(&shipped("paper-39.yaml"), |_| ());
    let mut robot = bench.connect().unwrap();
    robot.start_program().unwrap();
    let turn = |robot: &mut cellcal::devices::ur::UrRobot| {
        let sample = robot.next_sample().unwrap();
        robot.heartbeat().unwrap();
        sample
    };
    while turn(&mut robot).1.executor_state != ExecutorState::Idle {}
    let clock = bench.sim.clock();
    let first = clock.seconds();
    for pose in &bench.planned.plan.poses {
        let sequence = robot.start_move(&pose.target).unwrap();
        while turn(&mut robot).1.executor_sequence != sequence {}
        let until_s = clock.seconds() + DWELL_S.iter().sum::<f64>() + CAPTURE_S;
        while clock.seconds() < until_s {
            turn(&mut robot);
        }
    }
    let passed_s = clock.seconds() - first;
    robot.finish(None).unwrap();
    passed_s
}
