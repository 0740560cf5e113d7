//! Pixel events: Prophesee RAW EVT2, EVT2.1 and EVT3 in and out, windows, accumulation into images.
//!
//! Uses `image` only; pure Rust, no OpenCV, no files. Start at [`Event`] and [`Decoder`].

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
