//! Streaming decoders: bytes of a camera, cut anywhere, become events and triggers on the sensor's clock.

use super::clock::{EVT2_TIME, EVT3_TIME, HighClock, Step};
use super::{Event, Format, Trigger};

/// Receives what a decoder finds, in stream order.
pub trait Sink {
    /// Takes a pixel event.
    fn event(&mut self, event: Event);
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
    fn trigger(&mut self, trigger: Trigger) {
        self.triggers.push(trigger);
    }
}

/// The state that EVT3 words change.
#[derive(Debug, Clone, Copy)]
struct Evt3 {
    clock: HighClock,
    time_us: i64,
    y: u16,
    vector_x: u16,
    vector_on: bool,
    time_known: bool,
    row_known: bool,
    vector_known: bool,
    skipped: Skipped,
}

impl Evt3 {
    const fn new() -> Self {
        let skipped = Skipped {
            vendor_words: 0,
            unknown_words: 0,
            before_time: 0,
            before_address: 0,
            outside_format: 0,
            time_steps_back: 0,
        };
        Self {
            clock: HighClock::new(EVT3_TIME),
            time_us: 0,
            y: 0,
            vector_x: 0,
            vector_on: false,
            time_known: false,
            row_known: false,
            vector_known: false,
            skipped,
        }
    }

    fn resync(&mut self, epoch_us: i64) {
        *self = Self { skipped: self.skipped, ..Self::new() };
        self.clock.resync(epoch_us);
    }

    fn words<S: Sink>(&mut self, words: &[[u8; 2]], sink: &mut S) {
        // A copy on the stack stays in registers; behind `self` every push would write it back.
        let mut state = *self;
        for word in words {
            state.word(u16::from_le_bytes(*word), sink);
        }
        *self = state;
    }

    #[inline(always)]
    fn word<S: Sink>(&mut self, word: u16, sink: &mut S) {
        match word >> 12 {
            0x0 => {
                self.y = word & 0x7ff;
                self.row_known = true;
            }
            0x2 => self.single(word, sink),
            0x3 => {
                self.vector_x = word & 0x7ff;
                self.vector_on = word & 0x800 != 0;
                self.vector_known = true;
            }
            0x4 => self.vector(word & 0xfff, 12, sink),
            0x5 => self.vector(word & 0xff, 8, sink),
            0x6 => self.time_us = (self.time_us & !0xfff) | i64::from(word & 0xfff),
            0x8 => self.time_high(word),
            0xa => self.trigger(word, sink),
            0x7 | 0xe | 0xf => self.skipped.vendor_words += 1,
            _ => self.skipped.unknown_words += 1,
        }
    }

    #[inline(always)]
    fn single<S: Sink>(&mut self, word: u16, sink: &mut S) {
        if self.time_known & self.row_known {
            sink.event(Event { t_us: self.time_us, x: word & 0x7ff, y: self.y, on: word & 0x800 != 0 });
        } else {
            self.drop_events(1);
        }
    }

    #[inline(always)]
    fn vector<S: Sink>(&mut self, valid: u16, width: u16, sink: &mut S) {
        let x = self.vector_x;
        if !(self.time_known & self.row_known & self.vector_known) {
            return self.drop_events(valid.count_ones());
        }
        if x > 0x7ff {
            self.skipped.outside_format += 1;
            return;
        }
        self.vector_x = x + width;
        let mut left = valid;
        while left != 0 {
            let x = x + left.trailing_zeros() as u16;
            sink.event(Event { t_us: self.time_us, x, y: self.y, on: self.vector_on });
            left &= left - 1;
        }
    }

    /// The low bits become 0 only where the high ones change: cameras repeat TIME_HIGH, and TIME_LOW follows a change.
    #[inline(always)]
    fn time_high(&mut self, word: u16) {
        match self.clock.step(u32::from(word & 0xfff)) {
            Step::Same => return,
            Step::Forward => (),
            Step::Back => self.skipped.time_steps_back += 1,
        }
        self.time_us = self.clock.base_us().unwrap_or(0);
        self.time_known = true;
    }

    #[cold]
    fn trigger<S: Sink>(&mut self, word: u16, sink: &mut S) {
        if self.time_known {
            let channel = (word >> 8 & 0xf) as u8;
            sink.trigger(Trigger { t_us: self.time_us, channel, rising: word & 1 != 0 });
        } else {
            self.skipped.before_time += 1;
        }
    }

    #[cold]
    fn drop_events(&mut self, count: u32) {
        let counter = if self.time_known { &mut self.skipped.before_address } else { &mut self.skipped.before_time };
        *counter += u64::from(count);
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
