//! Where the arm truly is: for the simulated cameras, never for the program under test.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use super::config::Individual;
use crate::geometry::{Base, Flange, Transform, kinematics::Joints};

/// Simulated time that is kept, s.
const KEPT_S: f64 = 10.0;

/// The recent true poses; cheap to clone, shared with the controller.
#[derive(Debug, Clone)]
pub struct Truth {
    individual: Individual,
    log: Arc<Mutex<VecDeque<(f64, Joints)>>>,
}

impl Truth {
    pub(super) fn new(individual: Individual) -> Self {
        Self { individual, log: Arc::default() }
    }

    /// The arm that was drawn.
    pub fn individual(&self) -> &Individual {
        &self.individual
    }

    /// True pose of the flange at a simulated time, seconds of [`super::SimClock`].
    ///
    /// Interpolated between ticks of 2 ms. `None` before the last 10 s and after now.
    pub fn base_from_flange_at(&self, sim_time_s: f64) -> Option<Transform<Base, Flange>> {
        self.joints_at(sim_time_s).map(|joints| self.individual.truth.forward(&joints))
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

    pub(super) fn push(&self, at_s: f64, true_joints_rad: Joints) {
        let mut log = self.lock();
        while log.front().is_some_and(|(first_s, _)| at_s - first_s > KEPT_S) {
            log.pop_front();
        }
        log.push_back((at_s, true_joints_rad));
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, VecDeque<(f64, Joints)>> {
        // A reader that panicked cannot have left the log half written.
        self.log.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
