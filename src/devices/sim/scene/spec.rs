//! What the display and the two sensors are like: every number with its default and its range.
//!
//! The defaults lie in the middle of what data sheets and published figures show. What no data sheet gives is set
//! by what was published: the high-pass gain, the dark current and the off-axis leakage so that the trends over
//! alpha, brightness and viewing angle come out, the frame camera's white level so that its corners are not found
//! better than on the real camera (at 200 DN the RMS of a calibration is 0.06 px, below anything published).

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::SceneError;
use super::overlay::{Occluder, Spotlight};

/// The display that shows the board.
///
/// Seen from the side the default keeps more contrast than the published display, of which corners are lost from 55
/// deg on. `leak_horizontal: 0.8, leak_power: 4, leak_diagonal: 16` loses them where that did.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DisplaySpec {
    /// Luminance of white, looked at squarely, cd/m2.
    pub white_cd_m2: f64,
    /// Luminance of black, looked at squarely, cd/m2.
    pub black_cd_m2: f64,
    /// Brightness setting by the published table, 0 to 100; given, it replaces `white_cd_m2` and `black_cd_m2`.
    ///
    /// A cell file that gives it beside one of these is refused.
    pub brightness_percent: Option<f64>,
    /// Exponent from code value to luminance.
    pub gamma: f64,
    /// Time from 10 % to 90 % when a pixel gets brighter, s.
    pub rise_s: f64,
    /// Time from 90 % to 10 % when a pixel gets darker, s.
    pub fall_s: f64,
    /// Time from the top row to the bottom row of a refresh, s.
    pub scan_out_s: f64,
    /// Room light that the panel reflects, cd/m2.
    pub ambient_cd_m2: f64,
    /// Largest height difference of the bent panel over the board, m.
    pub bow_m: f64,
    /// White falls with the cosine of the viewing angle to this power.
    pub off_axis_dimming: f64,
    /// Share of white that leaks into black when seen at 90 deg from the left or right.
    pub leak_horizontal: f64,
    /// Share of white that leaks into black when seen at 90 deg from above or below.
    pub leak_vertical: f64,
    /// Leakage on the diagonals beyond both: share of white times the product of the direction cosines, to the
    /// power `leak_power`.
    pub leak_diagonal: f64,
    /// How steeply the leakage begins: power of the squared direction cosines.
    pub leak_power: f64,
    /// White margin around the board, in squares.
    pub margin_squares: f64,
    /// Dark bezel around the margin, in squares.
    pub bezel_squares: f64,
    /// Luminance of the bezel, cd/m2.
    pub bezel_cd_m2: f64,
    /// Luminance of everything behind the display, cd/m2.
    pub background_cd_m2: f64,
    /// Share of the light that the lens spreads over the image.
    pub glare: f64,
    /// How far the lens spreads it, standard deviation, px.
    pub glare_sigma_px: f64,
    /// The reflection of a lamp.
    pub spotlight: Option<Spotlight>,
    /// Things between the display and the cameras; the first hides the next.
    pub occluders: Vec<Occluder>,
    /// Frequency of the backlight's pulse-width modulation, Hz; 0: steady.
    pub pwm_hz: f64,
    /// Share of a period that the backlight is on.
    pub pwm_duty: f64,
    /// Share of the light that is switched.
    pub pwm_depth: f64,
    /// The rate at which the display really blinks, Hz, where it is not the declared one.
    pub actual_cycle_hz: Option<f64>,
    /// Refresh rate, Hz; matters where refreshes are dropped.
    pub refresh_hz: f64,
    /// Probability that a refresh is shown twice: its state lasts longer and all that follows comes later.
    ///
    /// During the first six hours of simulated time.
    pub dropped_refreshes: f64,
    /// The display shows the pattern and never changes.
    pub frozen: bool,
    /// The display is dark.
    pub off: bool,
}

impl Default for DisplaySpec {
    fn default() -> Self {
        Self {
            white_cd_m2: 391.0,
            black_cd_m2: 0.32,
            brightness_percent: None,
            gamma: 2.2,
            rise_s: 0.004,
            fall_s: 0.003,
            scan_out_s: 0.015,
            ambient_cd_m2: 3.0,
            bow_m: 50e-6,
            off_axis_dimming: 1.0,
            leak_horizontal: 0.15,
            leak_vertical: 0.02,
            leak_diagonal: 1.0,
            leak_power: 2.0,
            margin_squares: 0.5,
            bezel_squares: 1.0,
            bezel_cd_m2: 1.0,
            background_cd_m2: 5.0,
            glare: 0.02,
            glare_sigma_px: 150.0,
            spotlight: None,
            occluders: Vec::new(),
            pwm_hz: 0.0,
            pwm_duty: 0.5,
            pwm_depth: 1.0,
            actual_cycle_hz: None,
            refresh_hz: 60.0,
            dropped_refreshes: 0.0,
            frozen: false,
            off: false,
        }
    }
}

/// Measured luminance by brightness setting: percent, white, black (cd/m2). From the paper.
const BRIGHTNESS: [[f64; 3]; 6] = [
    [0.0, 35.0, 0.03],
    [20.0, 78.0, 0.06],
    [40.0, 121.0, 0.10],
    [60.0, 164.0, 0.13],
    [80.0, 236.0, 0.19],
    [100.0, 391.0, 0.32],
];

impl DisplaySpec {
    /// The same display at a brightness setting of 0 to 100 percent (clamped), straight between measured ones.
    pub fn at_brightness(self, percent: f64) -> Self {
        let percent = percent.clamp(0.0, 100.0);
        let [mut white_cd_m2, mut black_cd_m2] = [BRIGHTNESS[0][1], BRIGHTNESS[0][2]];
        for pair in BRIGHTNESS.windows(2) {
            let ([p0, w0, b0], [p1, w1, b1]) = (pair[0], pair[1]);
            let f = ((percent - p0) / (p1 - p0)).min(1.0);
            if f > 0.0 {
                (white_cd_m2, black_cd_m2) = (w0 + f * (w1 - w0), b0 + f * (b1 - b0));
            }
        }
        Self { white_cd_m2, black_cd_m2, ..self }
    }

    /// With the luminance of the brightness setting, where there is one.
    pub(super) fn at_its_brightness(self) -> Self {
        match self.brightness_percent {
            Some(percent) => self.at_brightness(percent),
            None => self,
        }
    }

    pub(super) fn check(&self) -> Result<(), SceneError> {
        self.brightness_percent.map_or(Ok(()), |p| in_range("display.brightness_percent", p, 0.0, 100.0))?;
        in_range("display.white_cd_m2", self.white_cd_m2, 1.0, 1e4)?;
        in_range("display.black_cd_m2", self.black_cd_m2, 0.0, self.white_cd_m2)?;
        in_range("display.gamma", self.gamma, 0.5, 4.0)?;
        in_range("display.rise_s", self.rise_s, 1e-5, 0.05)?;
        in_range("display.fall_s", self.fall_s, 1e-5, 0.05)?;
        in_range("display.scan_out_s", self.scan_out_s, 0.0, 0.05)?;
        in_range("display.ambient_cd_m2", self.ambient_cd_m2, 0.0, 1e3)?;
        in_range("display.bow_m", self.bow_m, 0.0, 2e-3)?;
        in_range("display.off_axis_dimming", self.off_axis_dimming, 0.0, 10.0)?;
        in_range("display.leak_horizontal", self.leak_horizontal, 0.0, 1.0)?;
        in_range("display.leak_vertical", self.leak_vertical, 0.0, 1.0)?;
        in_range("display.leak_diagonal", self.leak_diagonal, 0.0, 100.0)?;
        in_range("display.leak_power", self.leak_power, 1.0, 8.0)?;
        in_range("display.margin_squares", self.margin_squares, 0.0, 5.0)?;
        in_range("display.bezel_squares", self.bezel_squares, 0.0, 5.0)?;
        in_range("display.bezel_cd_m2", self.bezel_cd_m2, 0.0, 1e3)?;
        in_range("display.background_cd_m2", self.background_cd_m2, 0.0, 1e4)?;
        in_range("display.glare", self.glare, 0.0, 0.5)?;
        in_range("display.glare_sigma_px", self.glare_sigma_px, 10.0, 1e4)?;
        self.spotlight.as_ref().map_or(Ok(()), Spotlight::check)?;
        self.occluders.iter().try_for_each(Occluder::check)?;
        self.check_timing()
    }

    fn check_timing(&self) -> Result<(), SceneError> {
        if self.pwm_hz != 0.0 {
            in_range("display.pwm_hz", self.pwm_hz, 20.0, 1e5)?;
        }
        in_range("display.pwm_duty", self.pwm_duty, 0.01, 1.0)?;
        in_range("display.pwm_depth", self.pwm_depth, 0.0, 1.0)?;
        self.actual_cycle_hz.map_or(Ok(()), |hz| in_range("display.actual_cycle_hz", hz, 0.1, 120.0))?;
        in_range("display.refresh_hz", self.refresh_hz, 10.0, 1000.0)?;
        in_range("display.dropped_refreshes", self.dropped_refreshes, 0.0, 0.5)
    }
}

/// The sensor of the frame camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct FrameSpec {
    /// What white gives, looked at squarely, DN; the gain follows exposure and brightness.
    pub white_dn: f64,
    /// Electrons for one DN: the shot noise has a variance of signal / this, DN2.
    pub electrons_per_dn: f64,
    /// Read noise, standard deviation, DN.
    pub read_noise_dn: f64,
    /// Gain differences between pixels, standard deviation as a share.
    pub prnu: f64,
}

impl Default for FrameSpec {
    fn default() -> Self {
        Self { white_dn: 80.0, electrons_per_dn: 9.0, read_noise_dn: 0.8, prnu: 0.006 }
    }
}

impl FrameSpec {
    pub(super) fn check(&self) -> Result<(), SceneError> {
        in_range("rgb.white_dn", self.white_dn, 1.0, 1e4)?;
        in_range("rgb.electrons_per_dn", self.electrons_per_dn, 0.01, 1e6)?;
        in_range("rgb.read_noise_dn", self.read_noise_dn, 0.0, 100.0)?;
        in_range("rgb.prnu", self.prnu, 0.0, 0.5)
    }
}

/// The pixels and the readout of the event camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct EventSpec {
    /// Mean threshold for brighter, natural logarithm of luminance.
    pub threshold_on: f64,
    /// Mean threshold for darker, natural logarithm of luminance.
    pub threshold_off: f64,
    /// Differences between pixels, standard deviation as a share of the threshold; ON and OFF apart.
    pub threshold_mismatch: f64,
    /// Share of a step of the log luminance that passes the high-pass (bias `hpf`).
    pub high_pass_gain: f64,
    /// Luminance that the dark current is worth: dim steps look smaller, cd/m2.
    pub dark_cd_m2: f64,
    /// Mean delay of a pixel, s.
    pub latency_s: f64,
    /// Differences of that delay from event to event, standard deviation, s.
    pub jitter_s: f64,
    /// Longest time that a row waits for the readout, s.
    pub row_readout_s: f64,
    /// Corner frequency of the pixel's low-pass (bias `fo`), Hz; acts on the backlight's modulation.
    pub low_pass_hz: f64,
    /// Most events a second that flicker of the backlight gives; beyond it they are dropped at random.
    pub flicker_events_per_s: f64,
    /// Events of a pixel without cause, Hz.
    pub background_hz: f64,
    /// Number of hot pixels.
    pub hot_pixels: u32,
    /// Events of a hot pixel, Hz.
    pub hot_pixel_hz: f64,
}

impl Default for EventSpec {
    fn default() -> Self {
        Self {
            threshold_on: 0.22,
            threshold_off: 0.28,
            threshold_mismatch: 0.065,
            high_pass_gain: 0.35,
            dark_cd_m2: 8.0,
            latency_s: 150e-6,
            jitter_s: 75e-6,
            row_readout_s: 200e-6,
            low_pass_hz: 300.0,
            flicker_events_per_s: 3e7,
            background_hz: 0.3,
            hot_pixels: 40,
            hot_pixel_hz: 100.0,
        }
    }
}

impl EventSpec {
    pub(super) fn check(&self) -> Result<(), SceneError> {
        in_range("event.threshold_on", self.threshold_on, 0.01, 5.0)?;
        in_range("event.threshold_off", self.threshold_off, 0.01, 5.0)?;
        in_range("event.threshold_mismatch", self.threshold_mismatch, 0.0, 0.5)?;
        in_range("event.high_pass_gain", self.high_pass_gain, 0.0, 1.0)?;
        in_range("event.dark_cd_m2", self.dark_cd_m2, 1e-3, 1e3)?;
        in_range("event.latency_s", self.latency_s, 0.0, 0.01)?;
        in_range("event.jitter_s", self.jitter_s, 0.0, 0.01)?;
        in_range("event.row_readout_s", self.row_readout_s, 0.0, 0.01)?;
        in_range("event.low_pass_hz", self.low_pass_hz, 1.0, 1e5)?;
        in_range("event.flicker_events_per_s", self.flicker_events_per_s, 0.0, 2e8)?;
        in_range("event.background_hz", self.background_hz, 0.0, 1e3)?;
        in_range("event.hot_pixels", f64::from(self.hot_pixels), 0.0, 1e5)?;
        in_range("event.hot_pixel_hz", self.hot_pixel_hz, 0.0, 1e5)
    }
}

/// Refuses a value outside `low` to `high`; NaN is outside.
pub(super) fn in_range(name: &'static str, value: f64, low: f64, high: f64) -> Result<(), SceneError> {
    if (low..=high).contains(&value) { Ok(()) } else { Err(SceneError::Value { name, value, low, high }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_section_gives_the_defaults_and_an_unknown_key_is_refused() {
        assert_eq!(serde_json::from_str::<DisplaySpec>("{}").unwrap(), DisplaySpec::default());
        assert_eq!(serde_json::from_str::<EventSpec>(r#"{"threshold_on": 0.25}"#).unwrap().threshold_on, 0.25);
        assert!(serde_json::from_str::<FrameSpec>(r#"{"prnuu": 0.01}"#).is_err());
    }

    #[test]
    fn the_defaults_are_allowed_and_not_a_number_is_not() {
        DisplaySpec::default().check().unwrap();
        FrameSpec::default().check().unwrap();
        EventSpec::default().check().unwrap();
        let error = DisplaySpec { bow_m: f64::NAN, ..DisplaySpec::default() }.check().unwrap_err();
        assert_eq!(error.to_string(), "display.bow_m of the simulated cell is NaN, outside 0 to 0.002");
    }

    #[test]
    fn brightness_follows_the_measured_table() {
        let white = |percent| DisplaySpec::default().at_brightness(percent).white_cd_m2;
        assert_eq!(
            [white(-5.0), white(0.0), white(40.0), white(100.0), white(300.0)],
            [35.0, 35.0, 121.0, 391.0, 391.0]
        );
        assert!((white(90.0) - 313.5).abs() < 1e-9);
    }
}
