//! What can be wrong with event data as a whole; single bad words are counted, not errors.

/// Why a file or a list of events cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RawError {
    /// No bytes at all.
    #[error("the file is empty; a Prophesee RAW file begins with `% ` lines; was the recording closed properly?")]
    Empty,
    /// No header lines.
    #[error(
        "not a Prophesee RAW file: it begins with `{found}`, expected ASCII lines that begin with `% `; convert other \
         files first, or import a rosbag or MCAP as such"
    )]
    NotRaw {
        /// The first bytes, made printable.
        found: String,
    },
    /// The header names no format and no known system.
    #[error(
        "the header names no event format; add a line `% evt 2.0`, `% evt 2.1` or `% evt 3.0` that is right for the \
         camera before the data"
    )]
    NoFormat,
    /// A format that cannot be decoded.
    #[error(
        "events are in format {found}, which cannot be decoded; allowed are EVT2, EVT2.1 (little or legacy) and EVT3; \
         record or export in one of these"
    )]
    UnknownFormat {
        /// Its name as in the file.
        found: String,
    },
    /// The header says two different things.
    #[error("the header contradicts itself about the {what}: `{one}` but `{other}`; correct or delete the wrong line")]
    Contradiction {
        /// About what.
        what: &'static str,
        /// One statement.
        one: String,
        /// The other.
        other: String,
    },
    /// The size of the sensor cannot be read.
    #[error("the header gives the sensor size `{found}`; expected WIDTHxHEIGHT, each 1 to 2048, such as 1280x720")]
    BadSize {
        /// The text found.
        found: String,
    },
}

impl RawError {
    pub(super) fn not_raw(bytes: &[u8]) -> Self {
        let head = &bytes[..bytes.len().min(12)];
        Self::NotRaw { found: head.escape_ascii().to_string() }
    }
}

/// Why events cannot be encoded; nothing has been written then.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum EncodeError {
    /// Times must not go back, within a call and from call to call.
    #[error("time goes back from {previous_us} us to {t_us} us; sort by time, or restart the encoder for a new stream")]
    NotSorted {
        /// The later time, which came first.
        previous_us: i64,
        /// The earlier time.
        t_us: i64,
    },
    /// Formats count from 0.
    #[error("time {t_us} us is negative; shift the times so that the first is 0 or more")]
    NegativeTime {
        /// The time.
        t_us: i64,
    },
    /// A gap so long that it is a mistake; bridging it takes a word for every 4 s of EVT3.
    #[error("a gap of {gap_us} us from one event to the next, allowed are 24 h; restart the encoder after the gap")]
    Gap {
        /// Its length.
        gap_us: i64,
    },
    /// All formats have 11 bits.
    #[error("pixel ({x}, {y}) is outside 0 to 2047, which is all that the format can hold")]
    Pixel {
        /// Column.
        x: u16,
        /// Row.
        y: u16,
    },
    /// Not enough bits.
    #[error("trigger channel {channel} is outside 0 to {max} of this format")]
    Channel {
        /// The channel.
        channel: u8,
        /// Highest channel.
        max: u8,
    },
}
