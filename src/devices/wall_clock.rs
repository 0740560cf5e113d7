//! The session's clock where devices are real: monotonic time since a start.

use std::time::{Duration, Instant};

use super::Clock;
use crate::session::Stamp;

/// Monotonic time since the session began.
#[derive(Debug, Clone, Copy)]
pub struct WallClock {
    began: Instant,
    /// The stamp at that moment; a resumed session goes on where it was.
    first: Stamp,
}

impl WallClock {
    /// A clock that says `first` now.
    #[expect(clippy::disallowed_methods, reason = "the clock of real devices")]
    pub fn starting_at(first: Stamp) -> Self {
        Self { began: Instant::now(), first }
    }
}

/// Lets a moment of real time pass.
#[expect(clippy::disallowed_methods, reason = "where no device waits")]
pub fn pause(time: Duration) {
    std::thread::sleep(time);
}

impl Clock for WallClock {
    fn now(&self) -> Stamp {
        let passed: Duration = self.began.elapsed();
        // 584 years fit.
        Stamp(self.first.0.saturating_add(u64::try_from(passed.as_nanos()).unwrap_or(u64::MAX)))
    }
}
