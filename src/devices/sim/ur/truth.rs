//! Where the arm truly is: for the simulated cameras, never for the program under test.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use super::config::{Individual, SimUrConfig};
use super::motion::TICK_S;
use crate::geometry::{Base, Flange, Tcp, Transform, kinematics::Joints};

/// Two cycles of the controller: what may lie between the end of an interval and the nearest known time, s.
const GAP_S: f64 = 2.0 * TICK_S;

/// The recent true poses; cheap to clone, shared with the controller.
#[derive(Debug, Clone)]
pub struct Truth {
    individual: Individual,
    flange_from_tcp: Transform<Flange, Tcp>,
    kept_s: f64,
    log: Arc<Mutex<VecDeque<(f64, Joints)>>>,
    /// Digital outputs and since when they are so.
    outputs: Arc<Mutex<VecDeque<(f64, u64)>>>,
}

impl Truth {
    pub(super) fn new(individual: Individual, config: &SimUrConfig) -> Self {
        let flange_from_tcp = Transform::from_pose_vector(config.tcp_offset);
        Self { individual, flange_from_tcp, kept_s: config.truth_kept_s, log: Arc::default(), outputs: Arc::default() }
    }

    /// The arm that was drawn.
    pub fn individual(&self) -> &Individual {
        &self.individual
    }

    /// True pose of the flange at a simulated time, seconds of [`super::SimClock`].
    ///
    /// Interpolated between ticks of 2 ms. `None` before the time that is kept (`SimUrConfig::truth_kept_s`) and after now.
    pub fn base_from_flange_at(&self, sim_time_s: f64) -> Option<Transform<Base, Flange>> {
        self.joints_at(sim_time_s).map(|joints| self.individual.truth.forward(&joints))
    }

    /// When the arm truly moved faster than these limits for the last time between two simulated times, s.
    ///
    /// Speeds are differences between cycles of 2 ms, with the ringing after a stop: of the fastest joint, and of
    /// the origin of the configured TCP. `None` if it never did; the end of the interval where a part of it is not
    /// known (not kept any more, or still to come), so that the unknown does not count as still.
    pub fn last_above(&self, joint_speed_rad_s: f64, tcp_speed_m_s: f64, from_s: f64, to_s: f64) -> Option<f64> {
        let known: Vec<_> = self.lock().iter().filter(|(at, _)| *at >= from_s && *at <= to_s).copied().collect();
        let covered = match known.as_slice() {
            [(first_s, _), .., (last_s, _)] => first_s - from_s <= GAP_S && to_s - last_s <= GAP_S,
            _ => false,
        };
        if !covered {
            return Some(to_s);
        }
        let tcp = |joints: &Joints| (self.individual.truth.forward(joints) * self.flange_from_tcp).translation_m();
        let slow = |step: &&[(f64, Joints)]| {
            let [(before_s, before), (after_s, after)] = step else { return false };
            let step_s = after_s - before_s;
            let joints_slow = before.iter().zip(after).all(|(b, a)| (a - b).abs() / step_s <= joint_speed_rad_s);
            joints_slow && {
                let (b, a) = (tcp(before), tcp(after));
                let moved_m = (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
                moved_m / step_s <= tcp_speed_m_s
            }
        };
        known.windows(2).rfind(|step| !slow(step)).and_then(|step| step.last()).map(|(at_s, _)| *at_s)
    }

    /// When a joint was for the last time farther than this from a place where it was later, before `to_s`, rad.
    ///
    /// `None` if it never was; `to_s` where a part of the interval is not known.
    pub fn last_apart(&self, joint_spread_rad: f64, from_s: f64, to_s: f64) -> Option<f64> {
        let known: Vec<_> = self.lock().iter().filter(|(at, _)| *at >= from_s && *at <= to_s).copied().collect();
        if known.last().is_none_or(|(last_s, _)| to_s - last_s > GAP_S) {
            return Some(to_s);
        }
        let mut range = [[f64::INFINITY, f64::NEG_INFINITY]; 6];
        known.iter().rev().find_map(|(at_s, joints)| {
            range.iter_mut().zip(joints).for_each(|(r, q)| *r = [r[0].min(*q), r[1].max(*q)]);
            let together = range.iter().all(|r| r[1] - r[0] <= joint_spread_rad);
            (!together).then_some(*at_s)
        })
    }

    /// When a digital output went on, after a simulated time, s; as far back as is kept.
    pub fn rises(&self, output: u8, after_s: f64) -> Vec<f64> {
        let outputs = self.outputs.lock().unwrap_or_else(PoisonError::into_inner);
        let on = |bits: u64| bits >> output & 1 == 1;
        let pairs = outputs.iter().zip(outputs.iter().skip(1));
        let risen = pairs.filter(|((_, before), (at_s, now))| !on(*before) && on(*now) && *at_s > after_s);
        risen.map(|(_, (at_s, _))| *at_s).collect()
    }

    /// Oldest simulated time that is known, s.
    pub fn oldest_s(&self) -> Option<f64> {
        self.lock().front().map(|(at_s, _)| *at_s)
    }

    /// Newest simulated time that is known, s.
    pub fn newest_s(&self) -> Option<f64> {
        self.lock().back().map(|(at_s, _)| *at_s)
    }

    fn joints_at(&self, sim_time_s: f64) -> Option<Joints> {
        let log = self.lock();
        let after = log.partition_point(|(at_s, _)| *at_s < sim_time_s);
        let (late_s, late) = log.get(after)?;
        if *late_s == sim_time_s {
            return Some(*late);
        }
        let (early_s, early) = log.get(after.checked_sub(1)?)?;
        let fraction = (sim_time_s - early_s) / (late_s - early_s);
        fraction.is_finite().then(|| std::array::from_fn(|i| early[i] + fraction * (late[i] - early[i])))
    }

    pub(super) fn push(&self, at_s: f64, true_joints_rad: Joints, digital_outputs: u64) {
        self.push_outputs(at_s, digital_outputs);
        let mut log = self.lock();
        while log.front().is_some_and(|(first_s, _)| at_s - first_s > self.kept_s) {
            log.pop_front();
        }
        log.push_back((at_s, true_joints_rad));
    }

    fn push_outputs(&self, at_s: f64, digital_outputs: u64) {
        let mut outputs = self.outputs.lock().unwrap_or_else(PoisonError::into_inner);
        if outputs.back().is_some_and(|(_, bits)| *bits == digital_outputs) {
            return;
        }
        while outputs.get(1).is_some_and(|(second_s, _)| at_s - second_s > self.kept_s) {
            outputs.pop_front();
        }
        outputs.push_back((at_s, digital_outputs));
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, VecDeque<(f64, Joints)>> {
        // A reader that panicked cannot have left the log half written.
        self.log.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
