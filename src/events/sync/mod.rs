//! Pairs the trigger edges that an event camera saw with the exposures that the host logged.
//!
//! The two clocks differ by an unknown offset and some ppm. Every exposure makes a rising edge at its start and a
//! falling one at its end; after the last exposure of a pose a short closing pulse ends the last window. Edges may be
//! missing, doubled or extra anywhere. A camera that runs freely makes edges between captures too; then only the
//! arrival of the packets ([`HostClock`]) tells which image an edge belongs to. Start at [`TriggerSync::find`].

mod align;
mod edges;
mod fit;
mod host;
mod windows;

#[cfg(test)]
mod tests;

use super::Trigger;
pub use host::{Arrival, HostClock};

/// Largest difference of two clocks that is believed, ppm.
const DRIFT_MAX_PPM: f64 = 200.0;
/// Two rising edges closer than this are one edge that bounced, microseconds.
const DOUBLED_MAX_US: i64 = 1000;
/// Fewest exposures and edges from which offset and drift can be found and checked.
const PAIRS_MIN: usize = 3;
/// Pairs may lie this part of the shortest exposure spacing apart.
const TOLERANCE_PERIODS: f64 = 1.0 / 20.0;
/// The root mean square of all residuals may be this part of the shortest exposure spacing.
const RESIDUAL_PERIODS: f64 = 1.0 / 50.0;

/// One exposure of the frame camera, on the host's clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExposureTime {
    /// Index of the pose.
    pub pose: usize,
    /// Start, seconds of the host's clock.
    pub start_host_s: f64,
    /// End, seconds of the host's clock.
    pub end_host_s: f64,
    /// Whether it was made only to end the window of the exposure before.
    pub closing: bool,
}

/// What is known about the trigger signal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SyncSettings {
    /// Trigger input of the event camera.
    pub channel: u8,
    /// Length of an exposure, seconds; a pulse shorter than half of it is a closing pulse.
    pub exposure_s: f64,
    /// Time from one exposure to the next within a pose (1 / fps), seconds.
    pub frame_period_s: f64,
    /// What the arrival of the packets says about the clocks: excludes maps that are wrong by a whole image.
    pub arrivals: Option<HostClock>,
}

/// `host_s = offset_s + (1 + ppm * 1e-6) * sensor_s`.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ClockMap {
    /// Host time at sensor time 0, seconds.
    pub offset_s: f64,
    /// How much faster the host's clock counts than the sensor's, parts per million.
    pub ppm: f64,
}

impl ClockMap {
    /// Host time of a sensor time, seconds.
    pub fn host_s_from_sensor_us(&self, sensor_us: i64) -> f64 {
        self.offset_s + self.rate() * (sensor_us as f64 * 1e-6)
    }

    /// Sensor time of a host time, microseconds, rounded; NaN becomes 0.
    pub fn sensor_us_from_host_s(&self, host_s: f64) -> i64 {
        ((host_s - self.offset_s) / self.rate() * 1e6).round() as i64
    }

    fn rate(&self) -> f64 {
        1.0 + self.ppm * 1e-6
    }
}

/// The events that belong to one exposure: sensor times `start_us..end_us`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Window {
    /// The rising edge of the exposure, microseconds of the sensor's clock.
    pub start_us: i64,
    /// The next rising edge, microseconds of the sensor's clock.
    pub end_us: i64,
    /// Whether that edge is missing and the end is one frame period after the start.
    pub assumed_end: bool,
}

/// How the clocks run, and which events belong to which exposure.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct TriggerSync {
    /// From the sensor's clock to the host's.
    pub clock: ClockMap,
    /// Root mean square of host time minus mapped edge time, over the pairs in the fit, seconds.
    pub residual_rms_s: f64,
    /// Exposures that have an edge.
    pub matched: usize,
    /// For each exposure as given; `None` where its edge is missing.
    pub windows: Vec<Option<Window>>,
    /// Rising edges that are neither closing pulses nor start an exposure.
    pub unmatched_edges: usize,
    /// Rising edges that came within 1 ms of another and were dropped.
    pub doubled_edges: usize,
    /// What a person should know.
    pub notes: Vec<String>,
}

/// Why edges and exposures cannot be paired.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SyncError {
    /// A setting that makes no sense.
    #[error("{name} is {value} s; expected a finite time above 0")]
    Setting {
        /// Which.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// An exposure that makes no sense.
    #[error("exposure {index} (pose {pose}) {what}; correct its row in the table of exposures")]
    Exposure {
        /// Its place in the input.
        index: usize,
        /// Its pose.
        pose: usize,
        /// What is wrong.
        what: &'static str,
    },
    /// Not enough to find two unknowns and check them.
    #[error(
        "{exposures} exposures and {edges} rising edges on trigger channel {channel} (besides {closing} closing \
         pulses; edges were seen on channels {channels:?}); at least 3 of each are needed: check the channel, the \
         trigger cable and exposure_s"
    )]
    TooFew {
        /// Exposures given.
        exposures: usize,
        /// Rising edges that could start one.
        edges: usize,
        /// Closing pulses.
        closing: usize,
        /// The channel asked for.
        channel: u8,
        /// Channels with any edge.
        channels: Vec<u8>,
    },
    /// Nothing fits.
    #[error(
        "no clock offset and drift (up to 200 ppm) puts a rising edge at half of the {exposures} exposures ({edges} \
         edges, {closing} closing pulses); are the events and the exposures of the same session, and is exposure_s \
         right?"
    )]
    NoAlignment {
        /// Exposures given.
        exposures: usize,
        /// Rising edges that could start one.
        edges: usize,
        /// Closing pulses.
        closing: usize,
    },
    /// Two answers fit equally well.
    #[error(
        "two clock offsets cannot be told apart: {offset_s:.6} s pairs {matched} exposures, {other_offset_s:.6} s pairs \
         {other_matched}; edges are missing or extra and the exposures are evenly spaced: record again without losing \
         edges, or with uneven pauses between poses"
    )]
    Ambiguous {
        /// Offset of one answer.
        offset_s: f64,
        /// Exposures it pairs.
        matched: usize,
        /// Offset of another.
        other_offset_s: f64,
        /// Exposures that one pairs.
        other_matched: usize,
    },
    /// The edges fit best where the packets cannot have come from.
    #[error(
        "images and trigger edges are paired wrongly, by about {images} images: the edges fit {by_s:.6} s from where \
         the arrival of the events puts them; was an image or an edge lost in every capture, or does the wire carry \
         another signal than `exposure active`?"
    )]
    Shifted {
        /// Host time of an edge by the best pairing minus that by the arrivals, seconds.
        by_s: f64,
        /// The same in frame periods, rounded away from zero.
        images: i64,
    },
    /// The best answer is poor.
    #[error(
        "trigger edges are {residual_rms_s:.6} s (rms) off the exposures, allowed are {limit_s:.6} s; the host's time \
         stamps are too noisy or a clock jumped"
    )]
    Residual {
        /// Root mean square over all pairs.
        residual_rms_s: f64,
        /// Largest allowed.
        limit_s: f64,
    },
}

impl TriggerSync {
    /// Finds the clock map and the window of each exposure.
    ///
    /// `triggers` in any order, other channels are ignored; `exposures` in any order, a window is returned for each.
    /// The map is voted for by pairs of edges and exposures and fitted by robust least squares. One pulse more in its
    /// place makes one map better than another, as does a far smaller noise; otherwise the answer is refused.
    ///
    /// # Errors
    /// [`SyncError`] for senseless input, when no map or more than one explains it, and when the best one is poor.
    pub fn find(triggers: &[Trigger], exposures: &[ExposureTime], settings: &SyncSettings) -> Result<Self, SyncError> {
        check(exposures, settings)?;
        let edges = edges::Edges::classify(triggers, settings);
        let (starts, closing) = (edges.starts(), edges.closing());
        if exposures.len() < PAIRS_MIN || starts.len() < PAIRS_MIN {
            let mut channels: Vec<u8> = triggers.iter().map(|trigger| trigger.channel).collect();
            channels.sort_unstable();
            channels.dedup();
            let (exposures, edges, channel) = (exposures.len(), starts.len(), settings.channel);
            return Err(SyncError::TooFew { exposures, edges, closing, channel, channels });
        }
        let aligned = align::align(exposures, &edges, settings)?.ok_or(SyncError::NoAlignment {
            exposures: exposures.len(),
            edges: starts.len(),
            closing,
        })?;
        let (windows, mut notes) = windows::windows(&edges, &aligned.pairs, exposures, settings);
        notes.extend(aligned.note());
        let matched = aligned.pairs.iter().flatten().count();
        Ok(Self {
            clock: aligned.clock,
            residual_rms_s: aligned.rms_s,
            matched,
            windows,
            unmatched_edges: starts.len() - matched,
            doubled_edges: edges.doubled,
            notes,
        })
    }
}

fn check(exposures: &[ExposureTime], settings: &SyncSettings) -> Result<(), SyncError> {
    let SyncSettings { channel: _, exposure_s, frame_period_s, arrivals: _ } = *settings;
    for (name, value) in [("exposure_s", exposure_s), ("frame_period_s", frame_period_s)] {
        if !(value.is_finite() && value > 0.0) {
            return Err(SyncError::Setting { name, value });
        }
    }
    let wrong = |index: usize, what| SyncError::Exposure { index, pose: exposures[index].pose, what };
    for (index, exposure) in exposures.iter().enumerate() {
        if !(exposure.start_host_s.is_finite() && exposure.end_host_s.is_finite()) {
            return Err(wrong(index, "has a start or end that is not a number"));
        }
        if exposure.end_host_s <= exposure.start_host_s {
            return Err(wrong(index, "does not end after its start"));
        }
    }
    let mut order: Vec<usize> = (0..exposures.len()).collect();
    order.sort_by(|&a, &b| exposures[a].start_host_s.total_cmp(&exposures[b].start_host_s));
    let twice = order
        .windows(2)
        .find(|pair| exposures[pair[1]].start_host_s - exposures[pair[0]].start_host_s <= exposure_s / 2.0);
    twice.map_or(Ok(()), |pair| Err(wrong(pair[1], "starts during the exposure before it")))
}
