//! How many of the display's transitions each pixel answered: what corners are fitted to.

use super::{BlinkClock, Event, Sink, Trigger};
use crate::image::FloatImage;

/// At least this share of the events must agree with their transitions, else the clock is not that of these events.
const AGREEING: f64 = 0.75;

/// Counts the answers of every pixel in a window: events of the sign that their transition has.
///
/// Without a clock, or where the events do not follow it (after a break in the session, on a display that lost its
/// rhythm), every event counts.
#[derive(Debug, Clone)]
pub struct Answered {
    width: usize,
    height: usize,
    clock: Option<BlinkClock>,
    /// Events that agree with their transition, and those that do not.
    counts: Vec<[u16; 2]>,
}

impl Answered {
    /// Nothing yet, for `width` by `height` pixels.
    pub fn new(width: u16, height: u16, clock: Option<BlinkClock>) -> Self {
        let (width, height) = (usize::from(width), usize::from(height));
        Self { width, height, clock, counts: vec![[0; 2]; width * height] }
    }

    /// Forgets all events, for the next window.
    pub fn clear(&mut self) {
        self.counts.fill([0; 2]);
    }

    /// Answers of every pixel; events against the transition take away from those with it.
    pub fn image(&self) -> FloatImage {
        let against = if self.follows_clock() { -1.0 } else { 1.0 };
        let value = |[with, other]: &[u16; 2]| (f32::from(*with) + against * f32::from(*other)).max(0.0);
        FloatImage { width: self.width, height: self.height, values: self.counts.iter().map(value).collect() }
    }

    fn follows_clock(&self) -> bool {
        let sums = self.counts.iter().fold([0_u64; 2], |s, c| [s[0] + u64::from(c[0]), s[1] + u64::from(c[1])]);
        self.clock.is_some() && sums[0] as f64 >= AGREEING * (sums[0] + sums[1]) as f64
    }
}

impl Sink for Answered {
    #[inline]
    fn event(&mut self, event: Event) {
        let (x, y) = (usize::from(event.x), usize::from(event.y));
        if x < self.width
            && let Some(counts) = self.counts.get_mut(y * self.width + x)
        {
            let against = self.clock.as_ref().is_some_and(|clock| clock.is_brighter(&event) != event.on);
            let slot = &mut counts[usize::from(against)];
            *slot = slot.saturating_add(1);
        }
    }

    fn trigger(&mut self, _: Trigger) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(x: u16, y: u16, on: bool) -> Event {
        Event { t_us: 0, x, y, on }
    }

    #[test]
    fn without_a_clock_every_event_counts() {
        let mut answered = Answered::new(3, 2, None);
        [event(0, 0, true), event(0, 0, false), event(2, 1, true), event(3, 0, true), event(0, 2, true)]
            .into_iter()
            .for_each(|e| answered.event(e));
        assert_eq!(answered.image().values, [2.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        answered.clear();
        assert!(answered.image().values.iter().all(|v| *v == 0.0));
    }
}
