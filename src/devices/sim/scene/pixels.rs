//! The event camera: thresholds on the change of log luminance, delays, noise.

use rand::Rng as _;
use rand_distr::{Distribution as _, Poisson, StandardNormal};
use rayon::prelude::*;

use super::SceneError;
use super::backlight::Backlight;
use super::blink::{Blink, Transition};
use super::flicker::Flicker;
use super::noise::{Stream, rng};
use super::optics::{Lens, Optics};
use super::render::Rendered;
use super::spec::EventSpec;
use crate::events::Event;

/// Noise is drawn for slots of this length, so that windows that meet have the same events as one window.
const NOISE_SLOT_US: i64 = 10_000;
/// Delays beyond this many standard deviations do not happen.
pub(super) const JITTER_LIMIT: f64 = 6.0;

/// The event camera.
#[derive(Debug)]
pub(super) struct EventSensor {
    pub(super) lens: Lens,
    pub(super) spec: EventSpec,
    /// Thresholds of each pixel on the step of log luminance before the high-pass: darker, brighter.
    step_thresholds: Vec<[f32; 2]>,
    pub(super) hot_pixels: Vec<[u16; 2]>,
    pub(super) seed: u64,
}

/// Microseconds from the first (included) to the last (excluded).
#[derive(Debug, Clone, Copy)]
pub(super) struct Window {
    from_us: i64,
    to_us: i64,
}

impl Window {
    pub(super) fn has(self, t_us: i64) -> bool {
        (self.from_us..self.to_us).contains(&t_us)
    }
}

impl EventSensor {
    pub(super) fn new(optics: Optics, spec: EventSpec, seed: u64) -> Result<Self, SceneError> {
        spec.check()?;
        let lens = Lens::new(optics)?;
        let (w, h) = (lens.optics.width, lens.optics.height);
        let mut thresholds = rng(seed, Stream::Thresholds, 0, 0);
        let mut threshold = |mean: f64| {
            let spread = 1.0 + spec.threshold_mismatch * thresholds.sample::<f64, _>(StandardNormal);
            (mean * spread.max(0.2) / spec.high_pass_gain.max(1e-9)) as f32
        };
        let step_thresholds = (0..w * h).map(|_| [threshold(spec.threshold_off), threshold(spec.threshold_on)]);
        let step_thresholds = step_thresholds.collect();
        let mut places = rng(seed, Stream::HotPixels, 0, 0);
        let mut place = || [places.random_range(0..w) as u16, places.random_range(0..h) as u16];
        let hot_pixels = (0..spec.hot_pixels).map(|_| place()).collect();
        Ok(Self { lens, spec, step_thresholds, hot_pixels, seed })
    }

    /// Thresholds of a pixel on the logarithm of luminance, without the high-pass: darker, brighter.
    pub(super) fn contrast_thresholds(&self, x: usize, y: usize) -> [f64; 2] {
        let gain = self.spec.high_pass_gain.max(1e-9);
        self.step_thresholds[y * self.lens.optics.width + x].map(|t| f64::from(t) * gain)
    }

    /// From the crossing of a threshold to the event, at most, s.
    pub(super) fn longest_delay_s(&self) -> f64 {
        self.spec.latency_s + JITTER_LIMIT * self.spec.jitter_s + self.spec.row_readout_s
    }

    /// All events from `from_s` to `to_s` of what was rendered, by time.
    pub(super) fn events(
        &self,
        seen: &Rendered,
        blink: &Blink,
        backlight: Option<&Backlight>,
        from_s: f64,
        to_s: f64,
    ) -> Vec<Event> {
        let window = Window { from_us: (from_s * 1e6).round() as i64, to_us: (to_s * 1e6).round() as i64 };
        if !(from_s.is_finite() && to_s.is_finite() && window.from_us < window.to_us) {
            return Vec::new();
        }
        let steps = self.steps(seen);
        let delay_s = blink.half_s() + self.longest_delay_s();
        let mut events = Vec::new();
        for transition in blink.transitions(from_s, to_s, delay_s) {
            let row = |y: usize| self.row_events(seen, &steps, blink, transition, y, window);
            events.par_extend((0..seen.roi.height).into_par_iter().flat_map_iter(row));
        }
        let (first, last) = (window.from_us.div_euclid(NOISE_SLOT_US), (window.to_us - 1).div_euclid(NOISE_SLOT_US));
        for slot in first..=last {
            let row = |y: usize| self.background(slot, y, window);
            events.par_extend((0..self.lens.optics.height).into_par_iter().flat_map_iter(row));
            events.extend(self.hot(slot, window));
        }
        if let Some(backlight) = backlight {
            events.extend(Flicker::new(self, seen, blink, backlight).events(blink, from_s, to_s, window));
        }
        events.par_sort_unstable();
        events
    }

    /// How much brighter the blended state is than the pattern, natural logarithm, for each pixel of the display.
    fn steps(&self, seen: &Rendered) -> Vec<f32> {
        let (roi, dark) = (seen.roi, self.spec.dark_cd_m2 as f32);
        let step = |i: usize| {
            let [pattern, blended] = seen.states(roi.x + i % roi.width, roi.y + i / roi.width);
            ((blended + dark) / (pattern + dark)).ln()
        };
        (0..roi.width * roi.height).into_par_iter().map(step).collect()
    }

    /// The events of one transition in row `y` of the display's rectangle: at most one a pixel.
    fn row_events(
        &self,
        seen: &Rendered,
        steps: &[f32],
        blink: &Blink,
        transition: Transition,
        y: usize,
        window: Window,
    ) -> Vec<Event> {
        let roi = seen.roi;
        let (row, on) = (roi.y + y, transition.brighter());
        let mut rng = rng(self.seed, Stream::Transition, transition.index as u64, row as u64);
        let row_delay_s = self.spec.latency_s + rng.random_range(0.0..=1.0) * self.spec.row_readout_s;
        let mut events = Vec::new();
        for x in 0..roi.width {
            let (step, column) = (steps[y * roi.width + x], roi.x + x);
            let threshold = self.step_thresholds[row * self.lens.optics.width + column][usize::from(on)];
            let fires = step > threshold;
            if !fires {
                continue;
            }
            let jitter: f64 = rng.sample(StandardNormal);
            let jitter_s = self.spec.jitter_s * jitter.clamp(-JITTER_LIMIT, JITTER_LIMIT);
            let rise_s = -f64::from(1.0 - threshold / step).ln() * blink.time_constant_s(on);
            if rise_s >= blink.half_s() {
                continue;
            }
            let scan_s = blink.scan_delay_s(f64::from(seen.scan[y * roi.width + x]));
            let t_s = transition.start_s + scan_s + rise_s + (row_delay_s + jitter_s).max(0.0);
            let t_us = (t_s * 1e6).round() as i64;
            if window.has(t_us) {
                events.push(Event { t_us, x: column as u16, y: row as u16, on });
            }
        }
        events
    }

    /// Events without cause in one row during one slot.
    fn background(&self, slot: i64, y: usize, window: Window) -> Vec<Event> {
        let width = self.lens.optics.width;
        let mut rng = rng(self.seed, Stream::Background, slot as u64, y as u64);
        let count = poisson(&mut rng, self.spec.background_hz * width as f64 * NOISE_SLOT_US as f64 * 1e-6);
        let mut event = || {
            let t_us = slot * NOISE_SLOT_US + rng.random_range(0..NOISE_SLOT_US);
            Event { t_us, x: rng.random_range(0..width) as u16, y: y as u16, on: rng.random() }
        };
        (0..count).map(|_| event()).filter(|e| window.has(e.t_us)).collect()
    }

    /// Events of the hot pixels during one slot.
    fn hot(&self, slot: i64, window: Window) -> Vec<Event> {
        let mut rng = rng(self.seed, Stream::HotEvents, slot as u64, 0);
        let mut events = Vec::new();
        for &[x, y] in &self.hot_pixels {
            for _ in 0..poisson(&mut rng, self.spec.hot_pixel_hz * NOISE_SLOT_US as f64 * 1e-6) {
                let t_us = slot * NOISE_SLOT_US + rng.random_range(0..NOISE_SLOT_US);
                events.push(Event { t_us, x, y, on: rng.random() });
            }
        }
        events.retain(|e| window.has(e.t_us));
        events
    }
}

/// A Poisson number; 0 for a mean of 0.
fn poisson(rng: &mut rand_pcg::Pcg64Mcg, mean: f64) -> u64 {
    Poisson::new(mean).map_or(0, |p| p.sample(rng) as u64)
}
