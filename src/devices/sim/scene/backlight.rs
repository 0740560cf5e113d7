//! The pulse-width modulation of the backlight: what an exposure averages, and what an event pixel makes of it.

use super::spec::DisplaySpec;

/// A backlight that is switched many times a second; its mean is the nominal luminance.
#[derive(Debug, Clone)]
pub(super) struct Backlight {
    period_s: f64,
    duty: f64,
    /// Light while on and while off, as shares of the mean.
    high: f64,
    low: f64,
}

/// When an event pixel fires within a period of the backlight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ripple {
    /// After the light goes on, s.
    pub(super) on_s: f32,
    /// After the light goes off, s.
    pub(super) off_s: f32,
}

impl Backlight {
    /// `None` for a steady backlight.
    pub(super) fn new(display: &DisplaySpec) -> Option<Self> {
        let &DisplaySpec { pwm_hz, pwm_duty: duty, pwm_depth: depth, .. } = display;
        let modulated = pwm_hz > 0.0 && depth > 0.0 && duty < 1.0 && !display.off;
        let high = 1.0 / (duty + (1.0 - duty) * (1.0 - depth));
        modulated.then(|| Self { period_s: 1.0 / pwm_hz, duty, high, low: high * (1.0 - depth) })
    }

    pub(super) fn period_s(&self) -> f64 {
        self.period_s
    }

    /// How long the light is on in each period, s.
    pub(super) fn on_s(&self) -> f64 {
        self.duty * self.period_s
    }

    /// Mean of the light during an exposure, as a share of its mean over whole periods.
    pub(super) fn mean(&self, start_s: f64, exposure_s: f64) -> f64 {
        let exposure_s = exposure_s.max(1e-6);
        let on_until = |t_s: f64| {
            let periods = (t_s / self.period_s).floor();
            periods * self.on_s() + (t_s - periods * self.period_s).min(self.on_s())
        };
        let on = (on_until(start_s + exposure_s) - on_until(start_s)) / exposure_s;
        self.low + on * (self.high - self.low)
    }

    /// What a pixel with these thresholds (darker, brighter) fires in the steady state of the modulation.
    ///
    /// The logarithm of `steady + backlit` light goes through a first-order low-pass of time constant `tau_s`. A
    /// pixel whose swing exceeds both thresholds fires once each way; any other falls silent, since its reference
    /// stays where it last fired.
    pub(super) fn ripple(&self, steady: f32, backlit: f32, tau_s: f64, thresholds: [f64; 2]) -> Option<Ripple> {
        let level = |share: f64| f64::from(steady) + share * f64::from(backlit);
        let step = (level(self.high) / level(self.low)).ln();
        let (on, off) = ((-self.on_s() / tau_s).exp(), (-(self.period_s - self.on_s()) / tau_s).exp());
        let (rise, fall) = (step * (1.0 - off) / (1.0 - on * off), step * (1.0 - on) / (1.0 - on * off));
        let swing = rise * (1.0 - on);
        let after_s = |reach: f64, threshold: f64| (-tau_s * (1.0 - threshold / reach).ln()) as f32;
        let fires = thresholds.iter().all(|t| swing > *t);
        fires.then(|| Ripple { on_s: after_s(rise, thresholds[1]), off_s: after_s(fall, thresholds[0]) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn backlight(pwm_hz: f64, pwm_duty: f64, pwm_depth: f64) -> Backlight {
        Backlight::new(&DisplaySpec { pwm_hz, pwm_duty, pwm_depth, ..DisplaySpec::default() }).unwrap()
    }

    #[test]
    fn long_exposures_average_and_short_ones_see_the_pulse() {
        let light = backlight(250.0, 0.25, 1.0);
        assert!((light.mean(0.3, 0.1) - 1.0).abs() < 1e-9);
        assert!((light.mean(0.0001, 0.0005) - 4.0).abs() < 1e-9 && light.mean(0.002, 0.001).abs() < 1e-9);
        assert!(Backlight::new(&DisplaySpec::default()).is_none());
    }

    #[test]
    fn the_ripple_is_that_of_a_filter_stepped_through_time() {
        let (light, tau_s) = (backlight(240.0, 0.4, 0.8), 1.0 / (std::f64::consts::TAU * 300.0));
        let logs = [light.low, light.high].map(|share| (3.0 + share * 20.0).ln());
        let (mut value, mut range) = (logs[0], (f64::INFINITY, f64::NEG_INFINITY));
        let dt_s = light.period_s / 20_000.0;
        for i in 0..200_000 {
            value += dt_s / tau_s * (logs[usize::from(i % 20_000 < 8_000)] - value);
            if i >= 180_000 {
                range = (range.0.min(value), range.1.max(value));
            }
        }
        let swing = range.1 - range.0;
        assert!(light.ripple(3.0, 20.0, tau_s, [swing * 0.999; 2]).is_some());
        assert!(light.ripple(3.0, 20.0, tau_s, [swing * 1.001, 0.1]).is_none());
        let ripple = light.ripple(3.0, 20.0, tau_s, [0.2, 0.3]).unwrap();
        let crossed = tau_s * ((logs[1] - range.0) / (logs[1] - range.0 - 0.3)).ln();
        assert!((f64::from(ripple.on_s) - crossed).abs() < 1e-6, "{ripple:?} {crossed}");
    }
}
