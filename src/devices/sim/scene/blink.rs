//! When each row of the display shows what: drive, row scan-out and the response of the liquid crystal.

use rand::Rng as _;

use super::noise::{Stream, rng};
use super::spec::DisplaySpec;

/// Ratio of a 10 % to 90 % time to the time constant: ln 9.
const RESPONSE_TO_TIME_CONSTANT: f64 = 2.197_224_577_336_219;

/// The blinking of the display.
#[derive(Debug)]
pub(super) struct Blink {
    half_s: f64,
    phase_s: f64,
    rise_s: f64,
    fall_s: f64,
    scan_out_s: f64,
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
        Self {
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

    /// Every transition that can cause something in `from_s` to `to_s`, given the longest delay behind it.
    pub(super) fn transitions(&self, from_s: f64, to_s: f64, delay_s: f64) -> impl Iterator<Item = Transition> {
        let (half_s, phase_s) = (self.half_s, self.phase_s);
        let first = ((from_s - delay_s - self.scan_out_s - phase_s) / half_s).floor() as i64;
        let last = ((to_s - phase_s) / half_s).ceil() as i64;
        (first..=last).map(move |index| Transition { index, start_s: phase_s + index as f64 * half_s })
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
        let all: Vec<_> = blink.transitions(10.0, 11.0, 0.04).filter(inside).collect();
        assert!((29..=31).contains(&all.len()));
        assert!(all.windows(2).all(|p| p[0].brighter() != p[1].brighter()));
    }
}
