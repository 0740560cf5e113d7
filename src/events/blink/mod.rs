//! Proof that the display blinks as it should, from the events alone: rate, transitions, duty, refreshes that came
//! late or early.
//!
//! Pixels that get brighter and darker about equally often are taken for the display. Rows are brought to one time
//! (panels write row by row), bursts of one sign are transitions. Start at [`DisplayProof::find`].

mod bursts;
mod pixels;
mod rhythm;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};

use super::Event;
use bursts::Burst;
use pixels::Blinking;
pub(super) use rhythm::delay_of;

/// Fewest pixels that a display must have: a board of 60 by 45 pixels has more.
const PIXELS_MIN: usize = 300;
/// Cycles that must be seen.
const CYCLES_MIN: f64 = 4.0;
/// The rate may be off by this share: panels of 59.94 Hz are called 60.
pub const RATE_TOLERANCE: f64 = 0.005;
/// More irregular states than this share are no rhythm.
const IRREGULAR_MAX: f64 = 0.34;

/// What the cell says about the display.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExpectedBlink {
    /// Full cycles (pattern and blended) per second, Hz.
    pub cycle_hz: f64,
    /// Refreshes of the panel per second, Hz.
    pub refresh_hz: f64,
}

/// How the display blinked while it was watched; times are the sensor's, microseconds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DisplayProof {
    /// Full cycles per second of the sensor's clock, Hz.
    pub cycle_hz: f64,
    /// Standard deviation of it, Hz.
    pub cycle_hz_sigma: f64,
    /// Share of a cycle in which the black cells are dark.
    pub dark_share: f64,
    /// Cycles that were seen.
    pub cycles: u32,
    /// A moment at which the black cells get brighter, where [`DisplayProof::row_delays`] are zero.
    pub brighter_us: f64,
    /// From there to the moment at which they get darker.
    pub darker_after_us: f64,
    /// Spread of the transitions about their rhythm, standard deviation.
    pub jitter_us: f64,
    /// Refreshes by which states lasted longer than they should.
    pub late_refreshes: u32,
    /// Refreshes by which states lasted shorter than they should.
    pub early_refreshes: u32,
    /// Pixels that blink.
    pub pixels: u32,
    /// First column, first row, last column, last row of 98 % of them.
    pub extent_px: [u16; 4],
    /// How much later than all together each band of rows changes, top to bottom.
    pub row_delays: Vec<RowDelay>,
}

/// How much later than all together a band of rows changes: panels write row by row.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RowDelay {
    /// Mean row of its events, pixels.
    pub row_px: f64,
    /// Microseconds, negative where it is earlier.
    pub delay_us: f64,
}

/// Why a display is not one that can be calibrated with.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DisplayProblem {
    /// Too little was recorded.
    #[error("the events of {got_s:.2} s show fewer than {CYCLES_MIN} cycles of {expected_hz} Hz; watch for longer")]
    TooShort {
        /// From the first event to the last, s.
        got_s: f64,
        /// The rate of the cell, Hz.
        expected_hz: f64,
    },
    /// Nothing blinks.
    #[error(
        "the event camera sees no blinking display: {pixels} pixels get brighter and darker in turn, at least \
         {PIXELS_MIN} are needed ({rate_kev_s:.0} thousand events a second); is the display on, not frozen, and \
         before the camera, and is the lens open?"
    )]
    NotVisible {
        /// Pixels that change in both directions.
        pixels: usize,
        /// All events, thousands a second.
        rate_kev_s: f64,
    },
    /// It changes without a rhythm.
    #[error(
        "{pixels} pixels change, but in no steady rhythm; does the display show the board, or is something moving \
         before the camera?"
    )]
    NoRhythm {
        /// Pixels that change in both directions.
        pixels: usize,
    },
    /// Another rate.
    #[error(
        "the display blinks at {found_hz:.3} Hz, the cell says {expected_hz} Hz (within 0.5 %); correct display.cycle_hz \
         or the refresh rate of the panel"
    )]
    WrongRate {
        /// Measured, Hz.
        found_hz: f64,
        /// The rate of the cell, Hz.
        expected_hz: f64,
    },
}

impl DisplayProof {
    /// Judges `events` (in order of time) of a sensor of `size` width and height.
    ///
    /// Needs at least four cycles; about a second is good. Rows whose delay differs by more than half a state are
    /// not told apart.
    ///
    /// # Errors
    /// [`DisplayProblem`], a sentence for the operator.
    pub fn find(events: &[Event], size: [u16; 2], expected: ExpectedBlink) -> Result<Self, DisplayProblem> {
        let ExpectedBlink { cycle_hz, refresh_hz } = expected;
        let (first_us, last_us) = match events {
            [first, .., last] => (first.t_us, last.t_us),
            [] | [_] => (0, 0),
        };
        let got_s = last_us.saturating_sub(first_us).max(0) as f64 * 1e-6;
        let long_enough = got_s * cycle_hz >= CYCLES_MIN;
        if !long_enough && !events.is_empty() {
            return Err(DisplayProblem::TooShort { got_s, expected_hz: cycle_hz });
        }
        let blinking = Blinking::find(events, size, got_s);
        let pixels = blinking.count();
        if pixels < PIXELS_MIN {
            let rate_kev_s = events.len() as f64 / got_s.max(1e-3) * 1e-3;
            return Err(DisplayProblem::NotVisible { pixels, rate_kev_s });
        }
        let lost = DisplayProblem::NoRhythm { pixels };
        let seen: Vec<Event> = events.iter().filter(|event| blinking.has(event)).copied().collect();
        let period_us = rhythm::period_us(&seen, 1e6 / refresh_hz).ok_or(lost.clone())?;
        let delays = rhythm::row_delays(&seen, size[1], period_us);
        let found = bursts::bursts(&seen, &|y| rhythm::delay_of(&delays, y), period_us);
        // The first and the last may be cut off.
        let found = found.get(1..found.len().saturating_sub(1)).unwrap_or_default();
        let rhythm = Rhythm::of(found, 1e6 / refresh_hz).ok_or(lost.clone())?;
        let irregular = f64::from(rhythm.late + rhythm.early) / found.len() as f64;
        let steady = irregular <= IRREGULAR_MAX;
        if !steady {
            return Err(lost);
        }
        let found_hz = 1e6 / rhythm.period_us;
        let right = (found_hz / cycle_hz - 1.0).abs() <= RATE_TOLERANCE;
        if !right {
            return Err(DisplayProblem::WrongRate { found_hz, expected_hz: cycle_hz });
        }
        Ok(Self {
            cycle_hz: found_hz,
            cycle_hz_sigma: found_hz * rhythm.period_sigma_us / rhythm.period_us,
            dark_share: 1.0 - rhythm.darker_after_us / rhythm.period_us,
            cycles: (found.len() / 2) as u32,
            brighter_us: rhythm.brighter_us,
            darker_after_us: rhythm.darker_after_us,
            jitter_us: rhythm.jitter_us,
            late_refreshes: rhythm.late,
            early_refreshes: rhythm.early,
            pixels: pixels as u32,
            extent_px: blinking.extent(),
            row_delays: delays,
        })
    }

    /// Delay of a row against the others, microseconds.
    pub fn row_delay_us(&self, y: u16) -> f64 {
        rhythm::delay_of(&self.row_delays, y)
    }
}

/// The regular part of a row of transitions.
struct Rhythm {
    period_us: f64,
    period_sigma_us: f64,
    brighter_us: f64,
    darker_after_us: f64,
    jitter_us: f64,
    late: u32,
    early: u32,
}

impl Rhythm {
    fn of(found: &[Burst], refresh_us: f64) -> Option<Self> {
        let steps: Vec<(bool, f64)> = found.windows(2).map(|w| (w[1].brighter, w[1].at_us - w[0].at_us)).collect();
        let usual = |brighter: bool| {
            let mut of: Vec<f64> = steps.iter().filter(|s| s.0 == brighter).map(|s| s.1).collect();
            of.sort_by(f64::total_cmp);
            of.get(of.len() / 2).copied()
        };
        let (to_brighter_us, to_darker_us) = (usual(true)?, usual(false)?);
        let (mut late, mut early, mut shift, mut index) = (0_u32, 0_u32, 0.0, 0.0);
        // Each transition at the time that it would have without the refreshes that came late or early.
        let mut straight = vec![(0.0, found.first()?.brighter, found.first()?.at_us)];
        for ((brighter, step_us), burst) in steps.iter().zip(found.iter().skip(1)) {
            let off = (step_us - if *brighter { to_brighter_us } else { to_darker_us }) / refresh_us;
            let extra = off.round();
            shift += extra * refresh_us;
            if extra > 0.0 {
                late += extra as u32;
            } else {
                early += (-extra) as u32;
            }
            index += 0.5;
            straight.push((index, *brighter, burst.at_us - shift));
        }
        Self::fit(&straight, late, early)
    }

    /// Least squares: one period, and a moment for each direction.
    fn fit(straight: &[(f64, bool, f64)], late: u32, early: u32) -> Option<Self> {
        let of = |brighter: bool| straight.iter().filter(move |s| s.1 == brighter).map(|s| (s.0, s.2));
        let mean = |brighter: bool| {
            let n = of(brighter).count() as f64;
            let sums = of(brighter).fold([0.0; 2], |a, (i, t)| [a[0] + i, a[1] + t]);
            (n > 0.0).then(|| (n, sums[0] / n, sums[1] / n))
        };
        let means = [mean(true)?, mean(false)?];
        let (mut sxx, mut sxy) = (0.0, 0.0);
        for (brighter, (_, mean_i, mean_t)) in [true, false].into_iter().zip(means) {
            for (i, t) in of(brighter) {
                sxx += (i - mean_i) * (i - mean_i);
                sxy += (i - mean_i) * (t - mean_t);
            }
        }
        let period_us = sxy / sxx;
        let moment = |(_, mean_i, mean_t): (f64, f64, f64)| mean_t - mean_i * period_us;
        let [bright_us, dark_us] = means.map(moment);
        let residual =
            |(i, brighter, t): &(f64, bool, f64)| t - i * period_us - if *brighter { bright_us } else { dark_us };
        let squares: f64 = straight.iter().map(|s| residual(s) * residual(s)).sum();
        let free = straight.len().checked_sub(3).filter(|free| *free > 0)? as f64;
        let jitter_us = (squares / free).sqrt();
        // Of both directions one has whole indices, the other ends in a half.
        let darker_after_us = (dark_us - bright_us + 0.5 * period_us).rem_euclid(period_us);
        let first_is_brighter = straight.first().is_some_and(|s| s.1);
        let brighter_us = bright_us + if first_is_brighter { 0.0 } else { 0.5 * period_us };
        let period_sigma_us = jitter_us / sxx.sqrt();
        let fine = [period_us, bright_us, darker_after_us, jitter_us].iter().all(|v| v.is_finite()) && period_us > 0.0;
        fine.then_some(Self { period_us, period_sigma_us, brighter_us, darker_after_us, jitter_us, late, early })
    }
}
