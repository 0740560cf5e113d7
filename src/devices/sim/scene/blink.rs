//! When each row of the display shows what: drive, row scan-out and the response of the liquid crystal.

use rand::Rng as _;

use super::noise::{Stream, rng};
use super::spec::DisplaySpec;

/// Ratio of a 10 % to 90 % time to the time constant: ln 9.
const RESPONSE_TO_TIME_CONSTANT: f64 = 2.197_224_577_336_219;

/// Refreshes are dropped up to here, s.
const DROPS_UNTIL_S: f64 = 6.0 * 3600.0;

/// The blinking of the display.
#[derive(Debug)]
pub(super) struct Blink {
    half_s: f64,
    phase_s: f64,
    rise_s: f64,
    fall_s: f64,
    scan_out_s: f64,
    /// The display shows the first state only.
    still: bool,
    drops: Option<Drops>,
}

/// One change of the whole display, as it begins at the top row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Transition {
    /// Its number; odd ones turn brighter.
    pub(super) index: i64,
    /// When it begins at the top row, s.
    pub(super) start_s: f64,
}

impl Transition {
    pub(super) fn brighter(self) -> bool {
        self.index.rem_euclid(2) == 1
    }
}

impl Blink {
    /// Blinking that began at a random phase.
    pub(super) fn new(display: &DisplaySpec, cycle_hz: f64, seed: u64) -> Self {
        let cycle_hz = display.actual_cycle_hz.unwrap_or(cycle_hz);
        Self {
            still: display.frozen || display.off,
            drops: Drops::new(display, seed),
            half_s: 0.5 / cycle_hz,
            phase_s: rng(seed, Stream::Phase, 0, 0).random_range(0.0..1.0) / cycle_hz,
            rise_s: display.rise_s / RESPONSE_TO_TIME_CONSTANT,
            fall_s: display.fall_s / RESPONSE_TO_TIME_CONSTANT,
            scan_out_s: display.scan_out_s,
        }
    }

    /// Mean share of the blended state while `start_s` to `start_s + exposure_s`, 0 to 1.
    ///
    /// `scan` is the display row, 0 at the top to 1 at the bottom.
    pub(super) fn mean_blend(&self, start_s: f64, exposure_s: f64, scan: f64) -> f64 {
        let exposure_s = exposure_s.max(1e-6);
        if self.still || self.drops.is_some() {
            return self.uneven_blend(start_s - scan * self.scan_out_s, exposure_s);
        }
        let from_s = start_s - self.phase_s - scan * self.scan_out_s;
        ((self.blend_integral(from_s + exposure_s) - self.blend_integral(from_s)) / exposure_s).clamp(0.0, 1.0)
    }

    /// Integral of the share of the blended state since a cycle began; settles within every half cycle.
    fn blend_integral(&self, since_s: f64) -> f64 {
        let cycle_s = 2.0 * self.half_s;
        let cycles = (since_s / cycle_s).floor();
        cycles * self.cycle_integral(cycle_s) + self.cycle_integral(since_s - cycles * cycle_s)
    }

    /// The same within one cycle: first the pattern, then the blended state.
    fn cycle_integral(&self, since_s: f64) -> f64 {
        let settled = |t: f64, tau: f64| tau * (1.0 - (-t / tau).exp());
        let falling = settled(since_s.clamp(0.0, self.half_s), self.fall_s);
        let rising_for_s = (since_s - self.half_s).max(0.0);
        falling + rising_for_s - settled(rising_for_s, self.rise_s)
    }

    /// Mean share of the blended state over an exposure of the top row, from the transitions one by one.
    fn uneven_blend(&self, from_s: f64, exposure_s: f64) -> f64 {
        let to_s = from_s + exposure_s;
        let all = self.transitions(from_s, to_s, 0.0);
        let ends = all.iter().skip(1).map(|t| t.start_s).chain([f64::INFINITY]);
        let settled = |t: f64, tau: f64| tau * (1.0 - (-t / tau).exp());
        let mut blended_s = 0.0;
        for (transition, end_s) in all.iter().zip(ends) {
            let since_s = |t_s: f64| (t_s.min(end_s) - transition.start_s).max(0.0);
            let until = |t_s: f64| match transition.brighter() {
                true => since_s(t_s) - settled(since_s(t_s), self.rise_s),
                false => settled(since_s(t_s), self.fall_s),
            };
            blended_s += until(to_s) - until(from_s);
        }
        (blended_s / exposure_s).clamp(0.0, 1.0)
    }

    /// Every transition that can cause something in `from_s` to `to_s`, given the longest delay behind it.
    ///
    /// The first is the last one before all that, so that it tells what is shown at the beginning.
    pub(super) fn transitions(&self, from_s: f64, to_s: f64, delay_s: f64) -> Vec<Transition> {
        if self.still {
            return Vec::new();
        }
        let begin_s = from_s - delay_s - self.scan_out_s;
        let most_late_s = self.drops.as_ref().map_or(0.0, |drops| drops.late_s(f64::INFINITY).min(to_s.max(0.0)));
        let first = ((begin_s - most_late_s - self.phase_s) / self.half_s).floor() as i64;
        let last = ((to_s - self.phase_s) / self.half_s).ceil() as i64;
        let mut all: Vec<Transition> = (first..=last).map(|index| self.transition(index)).collect();
        if self.drops.is_some() {
            let before = all.partition_point(|t| t.start_s <= begin_s);
            all.drain(..before.saturating_sub(1));
            all.truncate(all.partition_point(|t| t.start_s <= to_s));
        }
        all
    }

    fn transition(&self, index: i64) -> Transition {
        let shown_s = index as f64 * self.half_s;
        let late_s = self.drops.as_ref().map_or(0.0, |drops| drops.late_s(shown_s));
        Transition { index, start_s: self.phase_s + shown_s + late_s }
    }

    /// Whether it shows the first state only.
    pub(super) fn is_still(&self) -> bool {
        self.still
    }

    /// How long each state lasts, s.
    pub(super) fn half_s(&self) -> f64 {
        self.half_s
    }

    /// Time constant of the change, s.
    pub(super) fn time_constant_s(&self, brighter: bool) -> f64 {
        if brighter { self.rise_s } else { self.fall_s }
    }

    /// When a display row changes, after the top row, s.
    pub(super) fn scan_delay_s(&self, scan: f64) -> f64 {
        scan * self.scan_out_s
    }
}

/// Refreshes that the display shows twice.
#[derive(Debug)]
struct Drops {
    refresh_s: f64,
    /// When each would have been shown if none before had been repeated, s after the display began.
    shown_s: Vec<f64>,
}

impl Drops {
    /// `None` where no refresh is dropped.
    fn new(display: &DisplaySpec, seed: u64) -> Option<Self> {
        let (share, refresh_s) = (display.dropped_refreshes, 1.0 / display.refresh_hz);
        let happens = share > 0.0;
        let mut rng = rng(seed, Stream::Drops, 0, 0);
        let mut refresh = -1.0;
        let next = || {
            // The number of refreshes up to the next dropped one is geometric.
            let uniform: f64 = rng.random_range(f64::MIN_POSITIVE..1.0);
            refresh += 1.0 + (uniform.ln() / (1.0 - share).ln()).floor();
            Some(refresh * refresh_s).filter(|shown_s| *shown_s < DROPS_UNTIL_S)
        };
        happens.then(|| Self { refresh_s, shown_s: std::iter::from_fn(next).collect() })
    }

    /// How much later the display is, at what would have been shown at `shown_s`, s.
    fn late_s(&self, shown_s: f64) -> f64 {
        let before = self.shown_s.partition_point(|s| *s < shown_s - 0.5 * self.refresh_s);
        before as f64 * self.refresh_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn blink(rise_s: f64, fall_s: f64) -> Blink {
        Blink::new(&DisplaySpec { rise_s, fall_s, ..DisplaySpec::default() }, 15.0, 7)
    }

    /// The share of the blended state at one instant, straight from the exponentials.
    fn share(blink: &Blink, t_s: f64, scan: f64) -> f64 {
        let since = (t_s - blink.phase_s - scan * blink.scan_out_s).rem_euclid(2.0 * blink.half_s);
        if since < blink.half_s {
            (-since / blink.fall_s).exp()
        } else {
            1.0 - (-(since - blink.half_s) / blink.rise_s).exp()
        }
    }

    #[test]
    fn the_mean_over_an_exposure_is_the_sum_of_its_instants() {
        let blink = blink(0.005, 0.002);
        for (start_s, exposure_s, scan) in [(0.0, 0.1, 0.0), (1.234, 0.01, 0.7), (-3.3, 0.05, 1.0), (500.02, 1.7, 0.2)]
        {
            let steps = 200_000;
            let at = |i: u32| start_s + exposure_s * (f64::from(i) + 0.5) / f64::from(steps);
            let summed = (0..steps).map(|i| share(&blink, at(i), scan)).sum::<f64>() / f64::from(steps);
            let closed = blink.mean_blend(start_s, exposure_s, scan);
            assert!((closed - summed).abs() < 1e-5, "{start_s} {exposure_s} {scan}: {closed} {summed}");
        }
    }

    #[test]
    fn whole_cycles_are_half_blended_and_100_ms_nearly() {
        let blink = blink(1e-4, 1e-4);
        assert!((blink.mean_blend(0.123, 2.0 / 15.0, 0.4) - 0.5).abs() < 1e-9);
        let means: Vec<f64> = (0..60).map(|i| blink.mean_blend(f64::from(i) * 0.0031, 0.1, 0.0)).collect();
        let (low, high) = means.iter().fold((1.0_f64, 0.0_f64), |(l, h), m| (l.min(*m), h.max(*m)));
        assert!((low - 1.0 / 3.0).abs() < 0.01 && (high - 2.0 / 3.0).abs() < 0.01, "{low} {high}");
    }

    #[test]
    fn transitions_come_30_times_a_second_and_alternate() {
        let blink = blink(0.004, 0.003);
        let inside = |t: &Transition| (10.0..11.0).contains(&t.start_s);
        let all: Vec<_> = blink.transitions(10.0, 11.0, 0.04).into_iter().filter(inside).collect();
        assert!((29..=31).contains(&all.len()));
        assert!(all.windows(2).all(|p| p[0].brighter() != p[1].brighter()));
    }
}
