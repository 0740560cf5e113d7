//! When a capture is triggered, against when the arm truly stood still.
//!
//! The simulated arm rings after a stop. Its true motion is known to the simulator only: the trigger must come
//! after it has last exceeded the limits, and not much later than the still window.

use cellcal::recording::{Entry, Recording};
use cellcal::session::{Command, Input};

use crate::bench::{Bench, shipped};

/// The program may need this long beyond the still window, s: a sample, and the answer of the controller.
const BEYOND_WINDOW_S: f64 = 0.05;

/// Times of the triggers after the true end of motion, s; one for each pose. `moves` has one more: the way home.
fn lags(bench: &Bench, moves: &[f64], triggers: &[f64]) -> Vec<f64> {
    let limits = &bench.planned.cell.robot.stillness;
    let truth = bench.sim.truth();
    let lag = |(stretch, trigger): (&[f64], &f64)| {
        let fast = truth.last_above(limits.joint_speed_rad_s, limits.tcp_speed_m_s, stretch[0], stretch[1]);
        let apart = truth.last_apart(limits.joint_spread_rad, stretch[0], stretch[1]);
        trigger - fast.expect("the arm has moved").max(apart.expect("it has"))
    };
    moves.windows(2).zip(triggers).map(lag).collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[test]
fn captures_are_triggered_after_the_arm_is_truly_still_and_soon() {
    let bench = Bench::with(&shipped("paper-39.yaml"), |config| config.truth_kept_s = 1000.0);
    let clock = bench.sim.clock();
    let (mut moves, mut triggers) = (Vec::new(), Vec::new());
    let ran = bench
        .run(|command| match command {
            Command::Move { .. } | Command::Travel { .. } => moves.push(clock.seconds()),
            Command::Capture { .. } => triggers.push(clock.seconds()),
            _ => {}
        })
        .unwrap();
    assert_eq!((moves.len(), triggers.len()), (40, 39));
    let ours = lags(&bench, &moves, &triggers);
    let window_s = bench.planned.cell.robot.stillness.window_s;
    let smallest = ours.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(smallest >= 0.0, "a trigger {:.3} s before the arm was still", -smallest);
    let typical = median(ours);
    assert!(typical <= window_s + BEYOND_WINDOW_S, "median lag {typical:.3} s");

    // The naive way: when the move has returned, that is, when the controller aims at standing still.
    let recording = Recording::open(&ran.recording).unwrap();
    let mut samples = recording.entries.iter().filter_map(|entry| match entry {
        Entry::Input(at, Input::Robot(sample)) => Some((at.seconds(), sample.target_joint_speeds_rad_s)),
        _ => None,
    });
    let mut returned = Vec::new();
    for begun in &moves[..39] {
        let aimed_still = |speeds: &[f64; 6]| speeds.iter().all(|s| *s == 0.0);
        samples.find(|(at, speeds)| at > begun && !aimed_still(speeds)).expect("it moved");
        returned.push(samples.find(|(_, speeds)| aimed_still(speeds)).expect("it stopped").0);
    }
    let naive = lags(&bench, &moves, &returned);
    let too_early = naive.iter().filter(|lag| **lag < 0.0).count();
    assert!(too_early > 20, "the naive trigger is too early at {too_early} poses only: the arm does not ring");
}
