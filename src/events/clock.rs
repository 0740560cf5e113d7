//! Unrolls the TIME_HIGH words of a stream, which count modulo a wrap, to microseconds that only grow.

/// How one format splits and wraps its time.
#[derive(Debug, Clone, Copy)]
pub(super) struct TimeLayout {
    /// Bits of a TIME_HIGH word.
    pub(super) high_bits: u32,
    /// Bits below them, sent with or just before the event.
    pub(super) low_bits: u32,
    /// A step back of fewer TIME_HIGH units than this is a step back; a larger one is a wrap.
    pub(super) back_steps: i64,
}

/// EVT3: 24 bits, a wrap every 16.78 s. Recordings of windows have gaps of seconds and real clocks never run back
/// far, so only 1.05 s of the wrap is kept for steps back.
pub(super) const EVT3_TIME: TimeLayout = TimeLayout { high_bits: 12, low_bits: 12, back_steps: 256 };

/// EVT2 and EVT2.1: 34 bits, a wrap every 4 h 46 min; the nearer direction wins.
pub(super) const EVT2_TIME: TimeLayout = TimeLayout { high_bits: 28, low_bits: 6, back_steps: 1 << 27 };

impl TimeLayout {
    /// Microseconds from one wrap to the next.
    pub(super) const fn wrap_us(self) -> i64 {
        1 << (self.high_bits + self.low_bits)
    }
}

/// Times stop here, 146,000 years on; only damaged data gets there, and adding low bits must not overflow.
const TIME_MAX_US: i64 = 1 << 62;

/// What a TIME_HIGH word did to the clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Step {
    /// The same word again.
    Same,
    /// Time went on, perhaps over a wrap.
    Forward,
    /// Time went back a little.
    Back,
}

/// The upper part of the time of a stream.
#[derive(Debug, Clone, Copy)]
pub(super) struct HighClock {
    layout: TimeLayout,
    base_us: Option<i64>,
    epoch_us: i64,
}

impl HighClock {
    /// A clock that takes its first TIME_HIGH as it stands.
    pub(super) const fn new(layout: TimeLayout) -> Self {
        Self { layout, base_us: None, epoch_us: layout.wrap_us() / 2 }
    }

    /// Forgets the time; the next TIME_HIGH is the one nearest to `epoch_us`.
    pub(super) fn resync(&mut self, epoch_us: i64) {
        self.base_us = None;
        // A bound far beyond any recording keeps the arithmetic below from overflowing.
        self.epoch_us = epoch_us.clamp(-(1 << 60), 1 << 60);
    }

    /// The time of the last TIME_HIGH, microseconds.
    pub(super) fn base_us(&self) -> Option<i64> {
        self.base_us
    }

    /// Takes a TIME_HIGH word; only its `high_bits` lowest bits count.
    #[inline]
    pub(super) fn step(&mut self, high: u32) -> Step {
        let wrap_us = self.layout.wrap_us();
        let within_us = (i64::from(high) << self.layout.low_bits) & (wrap_us - 1);
        let Some(base_us) = self.base_us else {
            self.base_us = Some(nearest_us(within_us, self.epoch_us, wrap_us));
            return Step::Forward;
        };
        let ahead_us = within_us.wrapping_sub(base_us) & (wrap_us - 1);
        if ahead_us == 0 {
            return Step::Same;
        }
        let back_us = wrap_us - ahead_us;
        if back_us < self.layout.back_steps << self.layout.low_bits {
            self.base_us = Some((base_us - back_us).max(-TIME_MAX_US));
            return Step::Back;
        }
        self.base_us = Some((base_us + ahead_us).min(TIME_MAX_US));
        Step::Forward
    }
}

/// The time nearest to `epoch_us` that is `within_us` after a wrap.
fn nearest_us(within_us: i64, epoch_us: i64, wrap_us: i64) -> i64 {
    within_us + (epoch_us - within_us + wrap_us / 2 - 1).div_euclid(wrap_us) * wrap_us
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times_us(layout: TimeLayout, highs: &[u32]) -> Vec<i64> {
        let mut clock = HighClock::new(layout);
        highs
            .iter()
            .map(|&high| {
                clock.step(high);
                clock.base_us().unwrap()
            })
            .collect()
    }

    #[test]
    fn first_word_stands_as_it_is() {
        for high in [0, 1, 2047, 2048, 4094, 4095] {
            assert_eq!(times_us(EVT3_TIME, &[high]), [i64::from(high) << 12]);
        }
        for high in [0, 1, 1 << 27, (1 << 28) - 1] {
            assert_eq!(times_us(EVT2_TIME, &[high]), [i64::from(high) << 6]);
        }
    }

    #[test]
    fn wraps_are_unrolled_and_small_steps_back_are_not_wraps() {
        assert_eq!(times_us(EVT3_TIME, &[4095, 0, 4095, 0, 1]), [4095, 4096, 4095, 4096, 4097].map(|h: i64| h << 12));
        assert_eq!(times_us(EVT3_TIME, &[100, 50, 100]), [100, 50, 100].map(|h: i64| h << 12));
        assert_eq!(times_us(EVT2_TIME, &[(1 << 28) - 1, 0]), [((1 << 28) - 1) << 6, 1 << 34]);
    }

    #[test]
    fn gap_of_up_to_fifteen_seconds_goes_forward() {
        assert_eq!(times_us(EVT3_TIME, &[3000, 2700]), [3000, 4096 + 2700].map(|h: i64| h << 12));
        assert_eq!(times_us(EVT3_TIME, &[10, 3800]), [10, 3800].map(|h: i64| h << 12));
    }

    #[test]
    fn epoch_chooses_the_nearest_wrap() {
        let wrap_us = EVT3_TIME.wrap_us();
        for truth_us in [0, 5 * wrap_us, 5 * wrap_us - 4096, 1234 * wrap_us + (77 << 12)] {
            for error_us in [-8_000_000, 0, 8_000_000] {
                let mut clock = HighClock::new(EVT3_TIME);
                clock.resync(truth_us + error_us);
                clock.step((truth_us >> 12) as u32 & 0xfff);
                assert_eq!(clock.base_us(), Some(truth_us), "{truth_us} {error_us}");
            }
        }
        let mut clock = HighClock::new(EVT3_TIME);
        for epoch_us in [i64::MIN, i64::MAX] {
            clock.resync(epoch_us);
            clock.step(17);
            assert!(clock.base_us().unwrap().abs_diff(epoch_us) < u64::MAX / 2);
        }
    }
}
