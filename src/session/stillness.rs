//! Decides whether the arm stands still, from what the controller measured; keeps the evidence.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use super::types::{ExecutorState, RobotSample, Stamp};
use crate::config::Stillness as Limits;
use crate::geometry::{Base, Tcp, Transform, kinematics::Joints};

/// How still the arm was through the exposures of one capture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// `measured`, or `declared by source` for an imported session.
    pub source: String,
    /// Start of the interval, s since the session began.
    pub from_s: f64,
    /// End of the interval, s since the session began.
    pub to_s: f64,
    /// Samples in the interval.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub samples: Option<usize>,
    /// Largest joint speed, rad/s.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub max_joint_speed_rad_s: Option<f64>,
    /// Largest spread of a joint position, rad.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub max_joint_spread_rad: Option<f64>,
    /// Largest TCP speed, m/s.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub max_tcp_speed_m_s: Option<f64>,
}

/// The latest samples, as long as they are needed.
#[derive(Debug, Default)]
pub(super) struct History {
    samples: VecDeque<(Stamp, RobotSample)>,
}

impl History {
    /// Adds a sample and forgets those older than `keep_s`.
    pub(super) fn push(&mut self, at: Stamp, sample: &RobotSample, keep_s: f64) {
        self.samples.push_back((at, sample.clone()));
        while self.samples.front().is_some_and(|(first, _)| at.seconds() - first.seconds() > keep_s) {
            self.samples.pop_front();
        }
    }

    pub(super) fn clear(&mut self) {
        self.samples.clear();
    }

    /// Whether the arm has been still for the whole window that ends with the newest sample, in which the program
    /// that moves it says that it is steady.
    pub(super) fn is_still(&self, limits: &Limits) -> bool {
        let Some((last, sample)) = self.samples.back() else { return false };
        if sample.executor_state != ExecutorState::Steady {
            return false;
        }
        let from_s = last.seconds() - limits.window_s;
        let covers = self.samples.front().is_some_and(|(first, _)| first.seconds() <= from_s);
        covers && self.kept_limits(limits, from_s, last.seconds())
    }

    /// Whether every sample from `from_s` to `to_s` kept the limits, without a gap.
    pub(super) fn kept_limits(&self, limits: &Limits, from_s: f64, to_s: f64) -> bool {
        let inside: Vec<_> = self.between(from_s, to_s).collect();
        let gaps_small = inside.windows(2).all(|w| w[1].0.seconds() - w[0].0.seconds() <= limits.max_gap_s);
        let each_still = inside.iter().all(|(_, sample)| sample_is_still(sample, limits));
        let spread = max_spread(inside.iter().map(|(_, s)| &s.joints_rad));
        let (first_s, last_s) = match inside.as_slice() {
            [] => return false,
            [(first, _), .., (last, _)] => (first.seconds(), last.seconds()),
            [(only, _)] => (only.seconds(), only.seconds()),
        };
        let ends_seen = first_s - from_s <= limits.max_gap_s && to_s - last_s <= limits.max_gap_s;
        inside.len() >= limits.min_samples as usize
            && ends_seen
            && gaps_small
            && each_still
            && spread <= limits.joint_spread_rad
    }

    /// Whether the program that moves the arm said from `from_s` to `to_s` that it is steady.
    pub(super) fn stayed_steady(&self, from_s: f64, to_s: f64) -> bool {
        self.between(from_s, to_s).all(|(_, sample)| sample.executor_state == ExecutorState::Steady)
    }

    /// Samples from `from_s` to `to_s`.
    pub(super) fn count(&self, from_s: f64, to_s: f64) -> usize {
        self.between(from_s, to_s).count()
    }

    /// Mean pose of the TCP from `from_s` to `to_s`; absent without samples.
    pub(super) fn mean_pose(&self, from_s: f64, to_s: f64) -> Option<Transform<Base, Tcp>> {
        let poses: Vec<_> = self.between(from_s, to_s).map(|(_, s)| s.base_from_tcp()).collect();
        let first = *poses.first()?;
        // Samples of a still arm differ by less than 1 mrad: averaging in the tangent of the first is exact enough.
        let mut sum = [0.0; 6];
        for pose in &poses {
            let delta = (first.inverse() * *pose).pose_vector();
            sum.iter_mut().zip(delta).for_each(|(s, d)| *s += d);
        }
        Some(first * Transform::from_pose_vector(sum.map(|s| s / poses.len() as f64)))
    }

    /// Mean joint positions from `from_s` to `to_s`, rad; absent without samples.
    pub(super) fn mean_joints(&self, from_s: f64, to_s: f64) -> Option<Joints> {
        let count = self.count(from_s, to_s);
        let mut sum = [0.0; 6];
        for (_, sample) in self.between(from_s, to_s) {
            sum.iter_mut().zip(sample.joints_rad).for_each(|(s, q)| *s += q);
        }
        (count > 0).then(|| sum.map(|s| s / count as f64))
    }

    /// What the samples from `from_s` to `to_s` show.
    pub(super) fn evidence(&self, from_s: f64, to_s: f64) -> Evidence {
        let inside: Vec<_> = self.between(from_s, to_s).map(|(_, s)| s).collect();
        let speed = |s: &&RobotSample| s.joint_speeds_rad_s.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        let tcp = |s: &&RobotSample| norm3(&s.tcp_speed[..3]);
        Evidence {
            source: "measured".into(),
            from_s,
            to_s,
            samples: Some(inside.len()),
            max_joint_speed_rad_s: Some(inside.iter().map(speed).fold(0.0, f64::max)),
            max_joint_spread_rad: Some(max_spread(inside.iter().map(|s| &s.joints_rad))).filter(|s| s.is_finite()),
            max_tcp_speed_m_s: Some(inside.iter().map(tcp).fold(0.0, f64::max)),
        }
    }

    fn between(&self, from_s: f64, to_s: f64) -> impl Iterator<Item = &(Stamp, RobotSample)> {
        // Half a nanosecond of slack: stamps are whole nanoseconds.
        self.samples.iter().filter(move |(at, _)| at.seconds() >= from_s - 5e-10 && at.seconds() <= to_s + 5e-10)
    }
}

fn sample_is_still(sample: &RobotSample, limits: &Limits) -> bool {
    let aimed_still = sample.target_joint_speeds_rad_s.iter().all(|s| s.abs() <= 1e-12);
    let slow = sample.joint_speeds_rad_s.iter().all(|s| s.abs() < limits.joint_speed_rad_s);
    let mut pairs = sample.joints_rad.iter().zip(&sample.target_joints_rad);
    let arrived = pairs.all(|(q, target)| (q - target).abs() < limits.joint_error_rad);
    let tcp_slow = norm3(&sample.tcp_speed[..3]) < limits.tcp_speed_m_s;
    let tcp_not_turning = norm3(&sample.tcp_speed[3..]) < limits.tcp_rotation_rad_s;
    aimed_still && slow && arrived && tcp_slow && tcp_not_turning
}

fn norm3(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Largest spread (largest minus smallest) of a joint; infinite without samples.
fn max_spread<'a>(joints: impl Iterator<Item = &'a Joints>) -> f64 {
    let mut range = [[f64::INFINITY, f64::NEG_INFINITY]; 6];
    for q in joints {
        for (r, v) in range.iter_mut().zip(q) {
            *r = [r[0].min(*v), r[1].max(*v)];
        }
    }
    let spread = range.iter().map(|r| r[1] - r[0]).fold(0.0, f64::max);
    if range[0][0] <= range[0][1] { spread } else { f64::INFINITY }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in super::super) fn limits() -> Limits {
        Limits::default()
    }

    pub(in super::super) fn still_sample() -> RobotSample {
        RobotSample {
            controller_time_s: 100.0,
            joints_rad: [0.1; 6],
            joint_speeds_rad_s: [0.0; 6],
            target_joints_rad: [0.1; 6],
            target_joint_speeds_rad_s: [0.0; 6],
            tcp_pose: [0.1, 0.2, 0.3, 0.0, std::f64::consts::PI, 0.0],
            tcp_speed: [0.0; 6],
            tcp_offset: [0.0; 6],
            payload_kg: 0.5,
            payload_cog_m: [0.0; 3],
            robot_mode: 7,
            safety_mode: 1,
            safety_status_bits: 1,
            robot_status_bits: 3,
            runtime_state: 2,
            speed_scaling: 1.0,
            target_speed_fraction: 1.0,
            digital_inputs: 0,
            digital_outputs: 0,
            joint_temperatures_c: [30.0; 6],
            executor_sequence: 0,
            executor_state: ExecutorState::Steady,
        }
    }

    fn still_after(spoil: impl Fn(usize, &mut RobotSample)) -> Option<usize> {
        let mut history = History::default();
        (0..100).find(|i| {
            let mut sample = still_sample();
            spoil(*i, &mut sample);
            history.push(Stamp::from_seconds(*i as f64 * 0.008), &sample, 1.0);
            history.is_still(&limits())
        })
    }

    #[test]
    fn stillness_takes_the_whole_window() {
        assert_eq!(still_after(|_, _| ()), Some(38));
    }

    #[test]
    fn one_fast_sample_restarts_the_window() {
        assert_eq!(still_after(|i, s| s.joint_speeds_rad_s[3] = if i == 20 { -0.01 } else { 0.0 }), Some(58));
        assert_eq!(still_after(|i, s| s.joints_rad[0] += if i == 20 { 2e-4 } else { 0.0 }), Some(58));
    }

    #[test]
    fn nan_and_a_moving_program_are_never_still() {
        assert_eq!(still_after(|_, s| s.joint_speeds_rad_s[0] = f64::NAN), None);
        assert_eq!(still_after(|_, s| s.joints_rad[5] = f64::NAN), None);
        assert_eq!(still_after(|_, s| s.tcp_speed[4] = f64::NAN), None);
        assert_eq!(still_after(|_, s| s.executor_state = ExecutorState::Moving), None);
    }

    #[test]
    fn a_gap_in_the_samples_is_not_still() {
        let mut history = History::default();
        for i in 0..60 {
            let at = i as f64 * 0.008 + if i > 45 { 0.15 } else { 0.0 };
            history.push(Stamp::from_seconds(at), &still_sample(), 1.0);
        }
        assert!(!history.is_still(&limits()));
    }

    #[test]
    fn the_mean_pose_is_right_at_half_turns() {
        let mut history = History::default();
        for (i, sign) in [1.0, -1.0, 1.0, -1.0].iter().enumerate() {
            let mut sample = still_sample();
            // The rotation vector flips its sign near pi.
            sample.tcp_pose[4] = sign * (std::f64::consts::PI - 1e-6);
            history.push(Stamp::from_seconds(i as f64 * 0.01), &sample, 1.0);
        }
        let mean = history.mean_pose(0.0, 1.0).unwrap();
        assert!(mean.angle_to_rad(&still_sample().base_from_tcp()) < 1e-5, "{mean:?}");
    }
}
