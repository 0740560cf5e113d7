//! Fresh samples out of a connection: what waited in some buffer, or comes from before a restart, never
//! passes as the state of the robot.

use std::time::Duration;

use tokio::time::timeout;

use super::config::UrConfig;
use super::connection::Connection;
use super::fields;
use crate::devices::rtde::Value;
use crate::devices::{Clock, RobotError};
use crate::session::{RobotSample, Stamp};

/// Real time after which a silent socket is looked at again.
const LOOK_AGAIN: Duration = Duration::from_millis(20);

/// Share of time by which the two clocks may drift apart without counting as lateness.
const CLOCK_DRIFT: f64 = 2e-4;

/// A fresh sample and what came with it.
#[derive(Debug)]
pub(super) struct Fresh {
    pub(super) at: Stamp,
    pub(super) sample: RobotSample,
    /// The heartbeat that our script has read last.
    pub(super) echo: i32,
    /// The values of the fields that were asked for beside it.
    pub(super) extra: Vec<Value>,
}

/// The next fresh sample.
pub(super) async fn next_sample(
    connection: &mut Connection,
    freshness: &mut Freshness,
    clock: &dyn Clock,
    config: &UrConfig,
) -> Result<Fresh, RobotError> {
    let asked = clock.now();
    let mut waited = Duration::ZERO;
    loop {
        while let Some(mut values) = connection.next_values()? {
            let extra = values.split_off(fields::OUTPUTS.len().min(values.len()));
            let (sample, echo) = fields::sample_from(&values).map_err(|what| connection.protocol(what))?;
            let stamp = clock.now();
            let fresh = freshness.judge(stamp, sample.controller_time_s, config.stale_after);
            if fresh.map_err(|what| connection.protocol(what))? {
                return Ok(Fresh { at: stamp, sample, echo, extra });
            }
        }
        match timeout(LOOK_AGAIN, connection.read()).await {
            Ok(read) => read?,
            Err(_) => waited += LOOK_AGAIN,
        }
        let silent_s = clock.now().seconds() - asked.seconds();
        let patient = silent_s <= config.stale_after.as_secs_f64() && waited < config.real_time_guard;
        if !patient {
            return Err(RobotError::Silent { silent_s: silent_s.max(waited.as_secs_f64()) });
        }
    }
}

/// Tells fresh samples from those that waited in some buffer, by comparing the two clocks.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Freshness {
    /// Stamp of the last fresh sample.
    last_seen: Option<Stamp>,
    last_controller_s: f64,
    /// Smallest stamp minus controller time so far, let go slowly.
    offset_s: f64,
}

impl Freshness {
    /// Whether a sample is new and not late; the error says that the controller's time ran backwards.
    fn judge(&mut self, stamp: Stamp, controller_s: f64, stale_after: Duration) -> Result<bool, String> {
        let offset_s = stamp.seconds() - controller_s;
        if self.last_seen.is_none() {
            *self = Self { last_seen: Some(stamp), last_controller_s: controller_s, offset_s };
            return Ok(true);
        }
        let passed_s = controller_s - self.last_controller_s;
        if passed_s < 0.0 {
            let before_s = self.last_controller_s;
            return Err(format!("controller time went from {before_s} s back to {controller_s} s; it has restarted"));
        }
        self.last_controller_s = controller_s;
        self.offset_s = (self.offset_s + CLOCK_DRIFT * passed_s).min(offset_s);
        let in_time = offset_s - self.offset_s <= stale_after.as_secs_f64();
        let fresh = passed_s > 0.0 && in_time;
        if fresh {
            self.last_seen = Some(stamp);
        }
        Ok(fresh)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: Duration = Duration::from_millis(100);

    #[test]
    fn samples_that_waited_are_not_fresh() {
        let mut freshness = Freshness::default();
        let mut judge =
            |now_s: f64, controller_s: f64| freshness.judge(Stamp::from_seconds(now_s), controller_s, LIMIT);
        assert_eq!(judge(1.000, 50.000), Ok(true));
        assert_eq!(judge(1.008, 50.008), Ok(true));
        assert_eq!(judge(1.009, 50.008), Ok(false), "the same again");
        assert_eq!(judge(1.200, 50.016), Ok(false), "waited for 184 ms");
        assert_eq!(judge(1.201, 50.190), Ok(true), "caught up");
        assert!(judge(1.3, 2.0).is_err(), "restarted");
    }

    #[test]
    fn clocks_may_drift() {
        let mut freshness = Freshness::default();
        for i in 0..100_000 {
            let controller_s = 50.0 + 0.008 * f64::from(i);
            let stamp = Stamp::from_seconds(0.008 * f64::from(i) * (1.0 + 150e-6));
            assert_eq!(freshness.judge(stamp, controller_s, LIMIT), Ok(true), "{i}");
        }
    }
}
