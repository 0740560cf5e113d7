//! Pixel events: Prophesee RAW EVT2, EVT2.1 and EVT3 in and out, windows, accumulation into images.
//!
//! Uses `image` only; pure Rust, no OpenCV, no files: everything works on byte slices. Start at [`Event`] and
//! [`Decoder`]; [`Header`] opens a RAW file, [`RawInfo`] sums one up, [`sync`] finds the windows of a session.

mod accumulate;
mod answered;
pub mod blink;
mod clock;
mod decode;
mod encode;
mod error;
mod header;
mod info;
mod phase;
pub mod sync;

#[cfg(test)]
mod tests;

pub use accumulate::{LastPolarity, PolarityCounts};
pub use answered::Answered;
pub use decode::{Decoder, Sink, Skipped};
pub use encode::Encoder;
pub use error::{EncodeError, RawError};
pub use header::{Format, Header};
pub use info::{EventDigest, RawInfo, TriggerInfo};
pub use phase::{Accumulated, BlinkClock};

/// One pixel event.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Event {
    /// Time on the sensor's own clock, microseconds, wraps of the format unrolled.
    pub t_us: i64,
    /// Column.
    pub x: u16,
    /// Row.
    pub y: u16,
    /// Brighter (ON) or darker (OFF).
    pub on: bool,
}

/// One edge at the sensor's trigger input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
pub struct Trigger {
    /// Time on the sensor's own clock, microseconds.
    pub t_us: i64,
    /// Trigger input.
    pub channel: u8,
    /// Rising or falling edge.
    pub rising: bool,
}

/// The events of `start_us..end_us`, from events in order of time.
pub fn events_between(events: &[Event], start_us: i64, end_us: i64) -> &[Event] {
    let start = events.partition_point(|event| event.t_us < start_us);
    let after = events.get(start..).unwrap_or_default();
    &after[..after.partition_point(|event| event.t_us < end_us)]
}
