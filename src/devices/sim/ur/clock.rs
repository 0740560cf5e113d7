//! Simulated time as a session clock.

use std::sync::{
    Arc,
    atomic::{AtomicU64, Ordering},
};

use crate::devices::Clock;
use crate::session::Stamp;

/// Simulated time since the controller thread started; only its ticks advance it.
#[derive(Debug, Clone, Default)]
pub struct SimClock {
    nanoseconds: Arc<AtomicU64>,
}

impl SimClock {
    pub(super) fn set_ns(&self, nanoseconds: u64) {
        self.nanoseconds.store(nanoseconds, Ordering::Release);
    }

    /// Lets time pass where there is no controller.
    pub(in crate::devices::sim) fn advance(&self, seconds: f64) {
        self.nanoseconds.fetch_add((seconds * 1e9).round() as u64, Ordering::AcqRel);
    }

    /// Simulated time, seconds.
    pub fn seconds(&self) -> f64 {
        self.now().seconds()
    }
}

impl Clock for SimClock {
    fn now(&self) -> Stamp {
        Stamp(self.nanoseconds.load(Ordering::Acquire))
    }
}
