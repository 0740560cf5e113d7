//! Accumulation that knows when the display changes: every event is assigned to the transition that it belongs to.

use super::blink::{DisplayProof, RowDelay, delay_of};
use super::{Event, LastPolarity, PolarityCounts, Sink, Trigger};
use crate::image::GrayImage;

/// When the black cells get brighter and darker, by the sensor's clock.
#[derive(Debug, Clone, PartialEq)]
pub struct BlinkClock {
    brighter_us: f64,
    darker_after_us: f64,
    period_us: f64,
    row_delays: Vec<RowDelay>,
    /// Pixels answer early by up to this much, microseconds: the spread of the transitions.
    early_us: f64,
}

impl BlinkClock {
    /// The rhythm that was found when the display was watched. It drifts away by some 10 us a second: find it anew for
    /// events of long after.
    pub fn of(proof: &DisplayProof) -> Self {
        let period_us = 1e6 / proof.cycle_hz;
        Self {
            brighter_us: proof.brighter_us,
            darker_after_us: proof.darker_after_us,
            period_us,
            row_delays: proof.row_delays.clone(),
            early_us: period_us / 16.0,
        }
    }

    /// Whether the last transition of the event's row was to brighter.
    pub fn is_brighter(&self, event: &Event) -> bool {
        let since_us = event.t_us as f64 - delay_of(&self.row_delays, event.y) - self.brighter_us + self.early_us;
        since_us.rem_euclid(self.period_us) < self.darker_after_us
    }
}

/// What one pass over the events of a window gives: last polarities, counts, and the signed image.
#[derive(Debug, Clone)]
pub struct Accumulated {
    /// The event image of the paper.
    pub last: LastPolarity,
    /// ON and OFF of every pixel.
    pub counts: PolarityCounts,
    clock: Option<BlinkClock>,
    width: usize,
    height: usize,
    signed: Vec<i32>,
}

impl Accumulated {
    /// Nothing yet, for `width` by `height` pixels; without a clock there is no signed image.
    pub fn new(width: u16, height: u16, clock: Option<BlinkClock>) -> Self {
        let (last, counts) = (LastPolarity::new(width, height), PolarityCounts::new(width, height));
        let (width, height) = (usize::from(width), usize::from(height));
        let signed = vec![0; if clock.is_some() { width * height } else { 0 }];
        Self { last, counts, clock, width, height, signed }
    }

    /// Events that agree with their transition minus those that do not, pixel by pixel, row by row; empty without a
    /// clock. Black cells are positive, noise averages to zero, and what answers in opposite phase is negative.
    pub fn signed(&self) -> &[i32] {
        &self.signed
    }

    /// The signed image for the eye: 128 is zero, darker is more events of a black cell; full scale is the 99th
    /// percentile of its absolute values.
    pub fn signed_image(&self) -> GrayImage {
        let mut sizes: Vec<u32> = self.signed.iter().map(|v| v.unsigned_abs()).filter(|v| *v > 0).collect();
        sizes.sort_unstable();
        let full = f64::from(sizes.get(sizes.len() * 99 / 100).copied().unwrap_or(1));
        // Clamped: 1 to 255.
        let shade = |v: &i32| (128.0 - 127.0 * (f64::from(*v) / full).clamp(-1.0, 1.0)).round() as u8;
        let mut pixels: Vec<u8> = self.signed.iter().map(shade).collect();
        pixels.resize(self.width * self.height, 128);
        GrayImage { width: self.width, height: self.height, pixels }
    }
}

impl Sink for Accumulated {
    #[inline]
    fn event(&mut self, event: Event) {
        self.last.add(&event);
        self.counts.add(&event);
        let (x, y) = (usize::from(event.x), usize::from(event.y));
        if let Some(clock) = self.clock.as_ref().filter(|_| x < self.width)
            && let Some(slot) = self.signed.get_mut(y * self.width + x)
        {
            *slot += if clock.is_brighter(&event) == event.on { 1 } else { -1 };
        }
    }

    fn trigger(&mut self, _: Trigger) {}
}

#[cfg(test)]
mod tests {
    use rand::{Rng as _, SeedableRng as _};
    use rand_pcg::Pcg64;

    use super::*;

    const PERIOD_US: f64 = 1e6 / 15.0;

    fn clock() -> BlinkClock {
        BlinkClock {
            brighter_us: 3000.0,
            darker_after_us: PERIOD_US / 2.0,
            period_us: PERIOD_US,
            row_delays: vec![RowDelay { row_px: 0.0, delay_us: -7500.0 }, RowDelay { row_px: 99.0, delay_us: 7500.0 }],
            early_us: PERIOD_US / 16.0,
        }
    }

    /// When a row changes for the `k`-th time, microseconds; even is to brighter.
    fn transition_us(k: i64, y: u16) -> f64 {
        3000.0 + k as f64 * PERIOD_US / 2.0 - 7500.0 + 15000.0 * f64::from(y) / 99.0
    }

    #[test]
    fn events_belong_to_the_transition_of_their_row() {
        let clock = clock();
        for k in -40..40 {
            for y in [0, 40, 99] {
                // From 2 ms too early (noise of the clock) to 25 ms late (slow pixels).
                for late_us in [-2000.0, 0.0, 500.0, 25_000.0] {
                    let t_us = (transition_us(k, y) + late_us) as i64;
                    assert_eq!(clock.is_brighter(&Event { t_us, x: 0, y, on: true }), k % 2 == 0, "{k} {y} {late_us}");
                }
            }
        }
    }

    #[test]
    fn cells_add_up_and_noise_does_not() {
        let mut random = Pcg64::seed_from_u64(3);
        let mut seen = Accumulated::new(100, 100, Some(clock()));
        let cycles = 30;
        for k in 0..2 * cycles {
            for y in 0..100 {
                let t_us = (transition_us(k, y) + 1000.0 * random.random::<f64>()) as i64;
                seen.event(Event { t_us, x: 10, y, on: k % 2 == 0 });
                let t_us = random.random_range(0..(cycles as f64 * PERIOD_US) as i64);
                seen.event(Event { t_us, x: 20, y, on: random.random() });
            }
        }
        let at = |x: usize| (0..100).map(move |y| y * 100 + x);
        assert!(at(10).all(|i| seen.signed()[i] == 60), "every event agrees");
        // 60 random signs in each of 100 pixels: a walk of sqrt(6000) = 77 in all.
        let noise: i32 = at(20).map(|i| seen.signed()[i]).sum();
        assert!(noise.abs() < 4 * 77, "{noise}");
        assert!(at(20).all(|i| seen.last.image().pixels[i] == 0), "the last polarity takes noise for a cell");
        let image = seen.signed_image();
        assert_eq!((image.pixels[10], image.pixels[11]), (1, 128));
        assert_eq!((seen.counts.on()[10], seen.counts.off()[10]), (30, 30));
    }

    #[test]
    fn without_a_clock_nothing_is_signed_and_events_outside_are_passed_over() {
        let mut seen = Accumulated::new(4, 4, None);
        seen.event(Event { t_us: 0, x: 1, y: 1, on: true });
        assert!(seen.signed().is_empty());
        assert!(seen.signed_image().pixels.iter().all(|p| *p == 128));
        let mut seen = Accumulated::new(4, 4, Some(clock()));
        seen.event(Event { t_us: i64::MAX, x: 5, y: 1, on: true });
        seen.event(Event { t_us: i64::MIN, x: 1, y: 9, on: true });
        assert!(seen.signed().iter().all(|v| *v == 0));
    }
}
