//! Events that the modulation of the backlight causes.

use rand::Rng as _;
use rand_distr::StandardNormal;
use rayon::prelude::*;

use super::backlight::{Backlight, Ripple};
use super::blink::{Blink, Transition};
use super::noise::{Stream, rng};
use super::pixels::{EventSensor, JITTER_LIMIT, Window};
use super::render::Rendered;
use crate::events::Event;

/// What every pixel of the display's rectangle does in each period of the backlight.
pub(super) struct Flicker<'a> {
    sensor: &'a EventSensor,
    seen: &'a Rendered,
    backlight: &'a Backlight,
    /// By pixel; while the pattern, while the blended state is shown.
    ripples: Vec<[Option<Ripple>; 2]>,
    /// Share of the events that the readout keeps.
    kept: f64,
}

impl<'a> Flicker<'a> {
    pub(super) fn new(sensor: &'a EventSensor, seen: &'a Rendered, blink: &Blink, backlight: &'a Backlight) -> Self {
        let (roi, spec) = (seen.roi, &sensor.spec);
        let (tau_s, dark) = (1.0 / (std::f64::consts::TAU * spec.low_pass_hz), spec.dark_cd_m2 as f32);
        let ripple = |i: usize| {
            let (x, y) = (roi.x + i % roi.width, roi.y + i / roi.width);
            let steady = seen.steady(x, y);
            let thresholds = sensor.contrast_thresholds(x, y);
            seen.states(x, y).map(|total| backlight.ripple(steady + dark, total - steady, tau_s, thresholds))
        };
        let ripples: Vec<_> = (0..roi.width * roi.height).into_par_iter().map(ripple).collect();
        let firing = |state: usize| ripples.iter().filter(|ripple| ripple[state].is_some()).count() as f64;
        let firing = if blink.is_still() { firing(0) } else { 0.5 * (firing(0) + firing(1)) };
        let events_per_s = 2.0 * firing / backlight.period_s();
        let kept = (spec.flicker_events_per_s / events_per_s.max(1e-9)).min(1.0);
        Self { sensor, seen, backlight, ripples, kept }
    }

    pub(super) fn events(&self, blink: &Blink, from_s: f64, to_s: f64, window: Window) -> Vec<Event> {
        if self.ripples.iter().flatten().all(Option::is_none) {
            return Vec::new();
        }
        let period_s = self.backlight.period_s();
        let delay_s = 2.0 * period_s + self.sensor.longest_delay_s();
        let shown = blink.transitions(from_s, to_s, delay_s + period_s);
        let (first, last) = ((from_s - delay_s) / period_s, to_s / period_s);
        let periods = (first.floor() as i64..=last.ceil() as i64).into_par_iter();
        let rows = periods.flat_map_iter(|period| (0..self.seen.roi.height).map(move |y| (period, y)));
        rows.flat_map_iter(|(period, y)| self.row(blink, &shown, period, y, window)).collect()
    }

    /// One period of the backlight in one row; the draws do not depend on the window.
    fn row(&self, blink: &Blink, shown: &[Transition], period: i64, y: usize, window: Window) -> Vec<Event> {
        let (roi, spec) = (self.seen.roi, &self.sensor.spec);
        let mut rng = rng(self.sensor.seed, Stream::Flicker, period as u64, (roi.y + y) as u64);
        let row_delay_s = spec.latency_s + rng.random_range(0.0..=1.0) * spec.row_readout_s;
        let start_s = period as f64 * self.backlight.period_s();
        let mut events = Vec::new();
        for x in 0..roi.width {
            let i = y * roi.width + x;
            let scan_s = blink.scan_delay_s(f64::from(self.seen.scan[i]));
            let state = shown.iter().rev().find(|t| t.start_s + scan_s <= start_s).is_some_and(|t| t.brighter());
            let Some(ripple) = self.ripples[i][usize::from(state)] else { continue };
            let edges = [(true, 0.0, ripple.on_s), (false, self.backlight.on_s(), ripple.off_s)];
            for (on, edge_s, after_s) in edges {
                let (kept, jitter): (bool, f64) = (rng.random_bool(self.kept), rng.sample(StandardNormal));
                let jitter_s = spec.jitter_s * jitter.clamp(-JITTER_LIMIT, JITTER_LIMIT);
                let t_s = start_s + edge_s + f64::from(after_s) + (row_delay_s + jitter_s).max(0.0);
                let t_us = (t_s * 1e6).round() as i64;
                if kept && window.has(t_us) {
                    events.push(Event { t_us, x: (roi.x + x) as u16, y: (roi.y + y) as u16, on });
                }
            }
        }
        events
    }
}
