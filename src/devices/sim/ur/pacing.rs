//! How fast simulated time runs against real time.

use tokio::time::{Duration, Instant};

/// Real time that may be caught up at once; more is forgotten.
const MAX_CATCH_UP: Duration = Duration::from_millis(50);

/// What time it is for the simulation.
#[derive(Debug, PartialEq)]
pub(super) enum Due {
    /// As many cycles as one likes.
    Unlimited,
    /// So many cycles, at least one.
    Ticks(u64),
    /// None before this.
    At(Instant),
}

/// Keeps simulated time at a multiple of real time.
#[derive(Debug, Default)]
pub(super) struct Pacer {
    anchor: Option<Anchor>,
}

#[derive(Debug, Clone, Copy)]
struct Anchor {
    at: Instant,
    tick: u64,
    scale: f64,
}

impl Pacer {
    /// Cycles due at `now`, when `tick` have been run; a scale that is not positive counts as 1.
    pub(super) fn due(&mut self, now: Instant, tick: u64, scale: f64, cycle: Duration) -> Due {
        let scale = if scale > 0.0 { scale } else { 1.0 };
        if scale.is_infinite() {
            self.anchor = None;
            return Due::Unlimited;
        }
        let cycle_s = cycle.as_secs_f64() / scale;
        let fresh = Anchor { at: now, tick, scale };
        let anchor = *self.anchor.get_or_insert(fresh);
        let lag_s = now.saturating_duration_since(anchor.at).as_secs_f64() - (tick - anchor.tick) as f64 * cycle_s;
        if anchor.scale != scale || lag_s > MAX_CATCH_UP.as_secs_f64() {
            self.anchor = Some(fresh);
            return Due::Ticks(1);
        }
        let due = (lag_s / cycle_s).floor();
        if due >= 1.0 {
            Due::Ticks(due as u64)
        } else {
            Due::At(now + Duration::from_secs_f64(cycle_s - lag_s.max(0.0)))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_runs_at_its_scale_and_never_bursts() {
        let (mut pacer, start, cycle) = (Pacer::default(), Instant::now(), Duration::from_millis(2));
        let after = |ms: u64| start + Duration::from_millis(ms);
        assert_eq!(pacer.due(start, 0, 1.0, cycle), Due::At(after(2)));
        assert_eq!(pacer.due(after(9), 0, 1.0, cycle), Due::Ticks(4));
        assert_eq!(pacer.due(after(9), 4, 1.0, cycle), Due::At(after(10)));
        assert_eq!(pacer.due(after(5000), 4, 1.0, cycle), Due::Ticks(1), "lost time is not caught up");
        assert_eq!(pacer.due(after(5001), 4, 10.0, cycle), Due::Ticks(1), "a new scale starts anew");
        assert_eq!(pacer.due(after(5002), 4, 10.0, cycle), Due::Ticks(5));
        assert_eq!(pacer.due(after(5003), 9, f64::INFINITY, cycle), Due::Unlimited);
    }
}
