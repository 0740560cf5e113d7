//! Streaming decoders: bytes of a camera, cut anywhere, become events and triggers on the sensor's clock.

mod evt3;

use super::clock::{EVT2_TIME, HighClock, Step};
use super::{Event, Format, Trigger};
use evt3::Evt3;

/// Receives what a decoder finds, in stream order.
pub trait Sink {
    /// Takes a pixel event.
    fn event(&mut self, event: Event);
    /// Takes several pixel events at once.
    #[inline]
    fn events(&mut self, events: impl Iterator<Item = Event>) {
        events.for_each(|event| self.event(event));
    }
    /// Takes an edge at a trigger input.
    fn trigger(&mut self, trigger: Trigger);
}

/// What a decoder passed over, counted since it was made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub struct Skipped {
    /// Words that only the vendor understands (types OTHERS and CONTINUED); normal.
    pub vendor_words: u64,
    /// Words of reserved types; more than a few mean damage or the wrong format.
    pub unknown_words: u64,
    /// Events and triggers before the first TIME_HIGH; normal where a stream was joined midway.
    pub before_time: u64,
    /// EVT3 events before the first row, or before the first base column of a vector.
    pub before_address: u64,
    /// EVT3 vectors beyond column 2047.
    pub outside_format: u64,
    /// TIME_HIGH words that went back a little.
    pub time_steps_back: u64,
}

/// Decodes one stream of one format.
///
/// Events before the first TIME_HIGH are dropped and counted, as every known decoder does; so are EVT3 events whose
/// row is not known yet. Nothing in the bytes is fatal.
#[derive(Debug, Clone)]
pub struct Decoder {
    format: Format,
    state: State,
    /// The beginning of a word whose end has not arrived.
    partial: [u8; 8],
    partial_len: usize,
}

#[derive(Debug, Clone)]
enum State {
    Evt3(Evt3),
    Evt2(Evt2),
}

impl Decoder {
    /// A decoder at the start of a stream; the first TIME_HIGH is taken as it stands.
    pub fn new(format: Format) -> Self {
        let state = match format {
            Format::Evt3 => State::Evt3(Evt3::new()),
            Format::Evt2 | Format::Evt21 { .. } => State::Evt2(Evt2::new()),
        };
        Self { format, state, partial: [0; 8], partial_len: 0 }
    }

    /// The format it was made for.
    pub fn format(&self) -> Format {
        self.format
    }

    /// Says that bytes are missing before the next packet, which was taken about `epoch_us` on the sensor's clock.
    ///
    /// Half a word, the row and the time are forgotten; the next TIME_HIGH is resolved to the wrap nearest to
    /// `epoch_us`, so it may be wrong by 8.3 s for EVT3 and by 2.3 h for EVT2 and EVT2.1. Not for gapless packets:
    /// it drops what comes before the next TIME_HIGH.
    pub fn set_epoch_us(&mut self, epoch_us: i64) {
        self.partial_len = 0;
        match &mut self.state {
            State::Evt3(evt3) => evt3.resync(epoch_us),
            State::Evt2(evt2) => evt2.clock.resync(epoch_us),
        }
    }

    /// Bytes of a word that has not arrived whole; not 0 at the end of a stream means that it was cut off.
    pub fn pending_bytes(&self) -> usize {
        self.partial_len
    }

    /// What was passed over so far.
    pub fn skipped(&self) -> Skipped {
        match &self.state {
            State::Evt3(evt3) => evt3.skipped,
            State::Evt2(evt2) => evt2.skipped,
        }
    }

    /// Decodes the next bytes of the stream, cut anywhere, and appends what they hold.
    pub fn decode(&mut self, bytes: &[u8], events: &mut Vec<Event>, triggers: &mut Vec<Trigger>) {
        self.decode_into(bytes, &mut Collect { events, triggers });
    }

    /// Decodes the next bytes of the stream, cut anywhere, into a sink.
    pub fn decode_into<S: Sink>(&mut self, bytes: &[u8], sink: &mut S) {
        let missing = (self.format.word_bytes() - self.partial_len) % self.format.word_bytes();
        let (head, rest) = bytes.split_at(missing.min(bytes.len()));
        self.keep(head);
        if self.partial_len == self.format.word_bytes() {
            let word = self.partial;
            self.words(&word[..self.partial_len], sink);
            self.partial_len = 0;
        }
        let whole = rest.len() - rest.len() % self.format.word_bytes();
        let (whole, tail) = rest.split_at(whole);
        self.words(whole, sink);
        self.keep(tail);
    }

    fn keep(&mut self, bytes: &[u8]) {
        for (slot, byte) in self.partial[self.partial_len..].iter_mut().zip(bytes) {
            *slot = *byte;
        }
        self.partial_len += bytes.len();
    }

    fn words<S: Sink>(&mut self, bytes: &[u8], sink: &mut S) {
        match (&mut self.state, self.format) {
            (State::Evt3(evt3), _) => evt3.words(bytes.as_chunks().0, sink),
            (State::Evt2(evt2), Format::Evt21 { legacy_halves }) => {
                let turn = if legacy_halves { 32 } else { 0 };
                for word in bytes.as_chunks().0 {
                    evt2.vector_word(u64::from_le_bytes(*word).rotate_left(turn), sink);
                }
            }
            (State::Evt2(evt2), _) => bytes.as_chunks().0.iter().for_each(|w| evt2.word(u32::from_le_bytes(*w), sink)),
        }
    }
}

struct Collect<'a> {
    events: &'a mut Vec<Event>,
    triggers: &'a mut Vec<Trigger>,
}

impl Sink for Collect<'_> {
    #[inline]
    fn event(&mut self, event: Event) {
        self.events.push(event);
    }

    #[inline]
    fn events(&mut self, events: impl Iterator<Item = Event>) {
        self.events.extend(events);
    }

    #[inline]
    fn trigger(&mut self, trigger: Trigger) {
        self.triggers.push(trigger);
    }
}

/// The state of EVT2 and EVT2.1, whose words carry all but the upper time.
#[derive(Debug, Clone, Copy)]
struct Evt2 {
    clock: HighClock,
    skipped: Skipped,
}

impl Evt2 {
    fn new() -> Self {
        Self { clock: HighClock::new(EVT2_TIME), skipped: Skipped::default() }
    }

    #[inline(always)]
    fn word<S: Sink>(&mut self, word: u32, sink: &mut S) {
        match word >> 28 {
            on @ (0 | 1) => self.vector(word, on == 1, 1, sink),
            _ => self.other(word, sink),
        }
    }

    /// An EVT2.1 word: as in EVT2 above, with a bit for each of 32 pixels below.
    #[inline(always)]
    fn vector_word<S: Sink>(&mut self, word: u64, sink: &mut S) {
        let upper = (word >> 32) as u32;
        match upper >> 28 {
            on @ (0 | 1) => self.vector(upper, on == 1, word as u32, sink),
            _ => self.other(upper, sink),
        }
    }

    #[inline(always)]
    fn vector<S: Sink>(&mut self, word: u32, on: bool, valid: u32, sink: &mut S) {
        let Some(base_us) = self.clock.base_us() else {
            self.skipped.before_time += u64::from(valid.count_ones());
            return;
        };
        let (t_us, x, y) = (base_us + low_us(word), (word >> 11 & 0x7ff) as u16, (word & 0x7ff) as u16);
        let mut left = valid;
        while left != 0 {
            sink.event(Event { t_us, x: x + left.trailing_zeros() as u16, y, on });
            left &= left - 1;
        }
    }

    #[inline(always)]
    fn other<S: Sink>(&mut self, word: u32, sink: &mut S) {
        match word >> 28 {
            0x8 => self.skipped.time_steps_back += u64::from(self.clock.step(word & 0x0fff_ffff) == Step::Back),
            0xa => match self.clock.base_us() {
                Some(base_us) => {
                    let channel = (word >> 8 & 0x1f) as u8;
                    sink.trigger(Trigger { t_us: base_us + low_us(word), channel, rising: word & 1 != 0 });
                }
                None => self.skipped.before_time += 1,
            },
            0xe | 0xf => self.skipped.vendor_words += 1,
            _ => self.skipped.unknown_words += 1,
        }
    }
}

/// The six low time bits of an EVT2 word.
#[inline(always)]
fn low_us(word: u32) -> i64 {
    i64::from(word >> 22 & 0x3f)
}
