//! What a RAW file holds, in one pass over its bytes: the answer of `cellcal events info`.

use sha2::{Digest as _, Sha256};

use super::{Decoder, Event, Format, Header, RawError, Sink, Skipped, Trigger};

/// Bytes of packed events that are hashed at once.
const HASH_BLOCK_BYTES: usize = 1 << 14;

/// An edge at a trigger input, as in JSON.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct TriggerInfo {
    /// Time on the sensor's clock, microseconds.
    pub t_us: i64,
    /// Trigger input.
    pub channel: u8,
    /// 1 rising, 0 falling.
    pub edge: u8,
}

/// Everything about a RAW file that does not need its pictures. Unknown values are absent from the JSON.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct RawInfo {
    /// `evt2`, `evt21` or `evt3`.
    pub format: &'static str,
    /// `legacy` or `little`, for EVT2.1 only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub endianness: Option<&'static str>,
    /// Columns of the sensor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub width: Option<u16>,
    /// Rows of the sensor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height: Option<u16>,
    /// Events decoded.
    pub events: u64,
    /// ON events.
    pub on: u64,
    /// OFF events.
    pub off: u64,
    /// Time of the first event in the stream, microseconds of the sensor's clock, wraps unrolled.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub first_us: Option<i64>,
    /// Time of the last event in the stream.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub last_us: Option<i64>,
    /// Edges at the trigger inputs, in stream order.
    pub triggers: Vec<TriggerInfo>,
    /// SHA-256, in hex, over all events as packed little-endian records: t i64, x u16, y u16, polarity u8.
    pub sha256: String,
    /// Events outside `width` and `height`.
    pub outside: u64,
    /// Events that are earlier than the one before.
    pub backward_steps: u64,
    /// Bytes of a last word that was cut off.
    pub truncated_bytes: usize,
    /// Words that were passed over.
    pub skipped: Skipped,
    /// Bytes of the header.
    pub header_bytes: usize,
}

impl RawInfo {
    /// Reads a whole RAW file.
    ///
    /// # Errors
    /// [`RawError`] where [`Header::parse`] gives one; damage in the data is counted instead.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, RawError> {
        let header = Header::parse(bytes)?;
        let mut decoder = Decoder::new(header.format);
        let mut tally = Tally::new(&header);
        decoder.decode_into(bytes.get(header.len_bytes..).unwrap_or_default(), &mut tally);
        let sha256 = tally.digest.finish();
        let endianness = match header.format {
            Format::Evt21 { legacy_halves } => Some(if legacy_halves { "legacy" } else { "little" }),
            Format::Evt2 | Format::Evt3 => None,
        };
        Ok(Self {
            format: header.format.name(),
            endianness,
            width: header.width,
            height: header.height,
            events: tally.events,
            on: tally.on,
            off: tally.events - tally.on,
            first_us: tally.first_us,
            last_us: tally.last_us,
            triggers: tally.triggers,
            sha256,
            outside: tally.outside,
            backward_steps: tally.backward_steps,
            truncated_bytes: decoder.pending_bytes(),
            skipped: decoder.skipped(),
            header_bytes: header.len_bytes,
        })
    }
}

/// Counts what the decoder finds.
struct Tally {
    width: u16,
    height: u16,
    events: u64,
    on: u64,
    first_us: Option<i64>,
    last_us: Option<i64>,
    outside: u64,
    backward_steps: u64,
    triggers: Vec<TriggerInfo>,
    digest: EventDigest,
}

impl Tally {
    fn new(header: &Header) -> Self {
        Self {
            width: header.width.unwrap_or(u16::MAX),
            height: header.height.unwrap_or(u16::MAX),
            events: 0,
            on: 0,
            first_us: None,
            last_us: None,
            outside: 0,
            backward_steps: 0,
            triggers: Vec::new(),
            digest: EventDigest::default(),
        }
    }
}

impl Sink for Tally {
    #[inline]
    fn event(&mut self, event: Event) {
        self.events += 1;
        self.on += u64::from(event.on);
        self.outside += u64::from(event.x >= self.width || event.y >= self.height);
        self.backward_steps += u64::from(self.last_us.is_some_and(|last_us| event.t_us < last_us));
        self.first_us = self.first_us.or(Some(event.t_us));
        self.last_us = Some(event.t_us);
        self.digest.add(&event);
    }

    fn trigger(&mut self, trigger: Trigger) {
        let Trigger { t_us, channel, rising } = trigger;
        self.triggers.push(TriggerInfo { t_us, channel, edge: rising.into() });
    }
}

/// SHA-256 over events as packed records, the checksum by which decoders are compared.
#[derive(Debug, Clone, Default)]
pub struct EventDigest {
    sha: Sha256,
    block: Vec<u8>,
}

impl EventDigest {
    /// Adds one event: t i64, x u16, y u16, polarity u8, little-endian.
    #[inline]
    pub fn add(&mut self, event: &Event) {
        let mut record = [0; 13];
        record[..8].copy_from_slice(&event.t_us.to_le_bytes());
        record[8..10].copy_from_slice(&event.x.to_le_bytes());
        record[10..12].copy_from_slice(&event.y.to_le_bytes());
        record[12] = event.on.into();
        self.block.extend_from_slice(&record);
        if self.block.len() >= HASH_BLOCK_BYTES {
            self.sha.update(&self.block);
            self.block.clear();
        }
    }

    /// The checksum in lower-case hex.
    pub fn finish(mut self) -> String {
        self.sha.update(&self.block);
        self.sha.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }
}
