//! EVT3: 16-bit words, most of which only change a state.
//!
//! Which kind of word comes next cannot be guessed, so the loop does not branch on it: every word passes through the
//! same few steps, and only kinds that are rare or that come in groups (vectors) leave it. Events are gathered in a
//! packed form and handed over a batch at a time.

use super::{Sink, Skipped};
use crate::events::clock::{EVT3_TIME, HighClock, Step};
use crate::events::{Event, Trigger};

/// Words that are looked at before the events in them are handed over.
const BATCH_WORDS: usize = 64;
/// Most events of one word.
const VECTOR_COLUMNS: usize = 12;
/// Most events of a batch.
const BATCH_EVENTS: usize = BATCH_WORDS * VECTOR_COLUMNS;

/// The base column of a vector before the first base word.
const NO_COLUMN: u16 = u16::MAX;
/// Up to this base a vector ends inside the 11 bits of a column.
const WHOLE_VECTOR_MAX: u16 = 0x7ff - VECTOR_COLUMNS as u16;

/// ADDR_X.
const SINGLE: usize = 0x2;

/// All bits for a kind of word that asks for more than to change the row or to write one event, 0 for the others.
const SPECIAL: [u16; 16] = {
    let mut special = [u16::MAX; 16];
    // ADDR_Y, ADDR_X, TIME_LOW; vendor words, which are counted elsewhere.
    let plain = [0x0, SINGLE, 0x6, 0x7, 0xe, 0xf];
    let mut at = 0;
    while at < plain.len() {
        special[plain[at]] = 0;
        at += 1;
    }
    special
};

/// An event without the upper time: column in bits 0 to 15, row in 16 to 31, polarity in 32, low time from 40.
type Packed = u64;

const Y_AT: u32 = 16;
const ON_AT: u32 = 32;
const LOW_AT: u32 = 40;

/// Where a kind of word puts its value in a packed event: a shift written as a factor, and the bits it replaces.
#[derive(Clone, Copy)]
struct Place {
    factor: u64,
    field: u64,
}

const PLACES: [Place; 16] = {
    let mut places = [Place { factor: 0, field: 0 }; 16];
    places[0x0] = Place { factor: 1 << Y_AT, field: 0x7ff << Y_AT };
    places[0x6] = Place { factor: 1 << LOW_AT, field: 0xfff << LOW_AT };
    places
};

/// The columns that are set in each mask of six, and how many.
const COLUMNS: [([u64; 6], usize); 64] = {
    let mut columns = [([0; 6], 0); 64];
    let mut mask = 0;
    while mask < 64 {
        let mut column = 0;
        while column < 6 {
            if mask >> column & 1 != 0 {
                columns[mask].0[columns[mask].1] = column;
                columns[mask].1 += 1;
            }
            column += 1;
        }
        mask += 1;
    }
    columns
};

/// The column and polarity of an ADDR_X word, packed.
#[inline(always)]
fn column_and_polarity(word: u16) -> Packed {
    u64::from(word & 0x7ff) | u64::from(word & 0x800) << (ON_AT - 11)
}

fn unpack(packed: Packed, base_us: i64) -> Event {
    Event {
        t_us: base_us + (packed >> LOW_AT) as i64,
        x: packed as u16,
        y: (packed >> Y_AT) as u16,
        on: packed >> ON_AT & 1 != 0,
    }
}

/// Room for the events of a batch, all of one upper time. How many there are is counted by the caller: a length in
/// here would live in memory, and the loop would wait for it.
struct Room([Packed; BATCH_EVENTS]);

impl Room {
    /// Writes an event behind the first `len` that counts only if the caller says so: cheaper than to ask first.
    #[inline(always)]
    fn put(&mut self, len: usize, packed: Packed) {
        if let Some(slot) = self.0.get_mut(len) {
            *slot = packed;
        }
    }

    /// Writes the events of those of six columns that are in `mask`; returns how many.
    #[inline(always)]
    fn put_columns(&mut self, len: usize, first: Packed, mask: u16) -> usize {
        let (columns, count) = &COLUMNS[usize::from(mask & 0x3f)];
        if let Some(slots) = self.0.get_mut(len..).and_then(<[Packed]>::first_chunk_mut::<6>) {
            for (slot, column) in slots.iter_mut().zip(columns) {
                *slot = first + column;
            }
        }
        *count
    }

    #[inline(always)]
    fn hand_over<S: Sink>(&self, len: usize, base_us: i64, sink: &mut S) {
        let events = self.0.get(..len).unwrap_or_default();
        sink.events(events.iter().map(|packed| unpack(*packed, base_us)));
    }
}

/// Counts CONTINUED and OTHERS words of a batch, many at a time.
fn vendor_words(words: &[[u8; 2]]) -> u16 {
    words.iter().map(|word| u16::from_le_bytes(*word)).map(|word| u16::from(word >> 12 == 0x7 || word >= 0xe000)).sum()
}

/// The state that EVT3 words change.
#[derive(Debug, Clone, Copy)]
pub(super) struct Evt3 {
    clock: HighClock,
    /// Row and low time, packed.
    row: Packed,
    row_known: bool,
    /// The next column of a vector.
    column: u16,
    /// The polarity of vectors, packed.
    vector_on: Packed,
    pub(super) skipped: Skipped,
}

impl Evt3 {
    pub(super) fn new() -> Self {
        Self {
            clock: HighClock::new(EVT3_TIME),
            row: 0,
            row_known: false,
            column: NO_COLUMN,
            vector_on: 0,
            skipped: Skipped::default(),
        }
    }

    pub(super) fn resync(&mut self, epoch_us: i64) {
        *self = Self { skipped: self.skipped, ..Self::new() };
        self.clock.resync(epoch_us);
    }

    pub(super) fn words<S: Sink>(&mut self, mut words: &[[u8; 2]], sink: &mut S) {
        let mut room = Room([0; BATCH_EVENTS]);
        while let Some((word, rest)) = words.split_first()
            && !(self.row_known && self.clock.base_us().is_some())
        {
            self.unplaced(word, &mut room, sink);
            words = rest;
        }
        for batch in words.chunks(BATCH_WORDS) {
            self.batch(batch, &mut room, sink);
        }
    }

    /// Takes a word before the first row or the first upper time: its events are dropped.
    fn unplaced<S: Sink>(&mut self, word: &[u8; 2], room: &mut Room, sink: &mut S) {
        let value = u16::from_le_bytes(*word);
        match value >> 12 {
            0x2 => self.drop_events(1),
            0x4 => self.drop_events((value & 0xfff).count_ones()),
            0x5 => self.drop_events((value & 0xff).count_ones()),
            kind => {
                self.row_known |= kind == 0x0;
                self.batch(&[*word], room, sink);
            }
        }
    }

    /// Takes at most [`BATCH_WORDS`] words; row and upper time are known, or the words hold no events.
    fn batch<S: Sink>(&mut self, words: &[[u8; 2]], room: &mut Room, sink: &mut S) {
        // Copies stay in registers; behind `self` each would be written back.
        let Self { mut row, mut column, mut vector_on, .. } = *self;
        let (mut len, mut high_word) = (0, self.high_word());
        for word in words {
            let word = u16::from_le_bytes(*word);
            let kind = usize::from(word >> 12);
            let Place { factor, field } = PLACES[kind];
            row = (row & !field) | ((u64::from(word) * factor) & field);
            room.put(len, row | column_and_polarity(word));
            len += usize::from(kind == SINGLE);
            // One condition, because TIME_HIGH words are many and nearly all of them repeat the last one.
            if SPECIAL[kind] & (word ^ high_word) == 0 {
                continue;
            }
            match kind {
                0x3 => (column, vector_on) = (word & 0x7ff, column_and_polarity(word & 0x800)),
                0x4 | 0x5 if column <= WHOLE_VECTOR_MAX => {
                    let columns_less = 4 * (word >> 12 & 1);
                    let (mask, width) = (word & 0xfff >> columns_less, 12 - columns_less);
                    let first = row | vector_on | u64::from(column);
                    len += room.put_columns(len, first, mask);
                    len += room.put_columns(len, first + 6, mask >> 6);
                    column += width;
                }
                _ => {
                    room.hand_over(len, self.clock.base_us().unwrap_or(0), sink);
                    len = 0;
                    *self = Self { row, column, vector_on, ..*self };
                    self.rare(word, sink);
                    Self { row, column, .. } = *self;
                    high_word = self.high_word();
                }
            }
        }
        room.hand_over(len, self.clock.base_us().unwrap_or(0), sink);
        *self = Self { row, column, vector_on, ..*self };
        self.skipped.vendor_words += u64::from(vendor_words(words));
    }

    /// The TIME_HIGH word that changes nothing; cameras repeat it all the time. None before the first.
    fn high_word(&self) -> u16 {
        self.clock.base_us().map_or(0, |base_us| 0x8000 | (base_us >> EVT3_TIME.low_bits & 0xfff) as u16)
    }

    #[cold]
    fn rare<S: Sink>(&mut self, word: u16, sink: &mut S) {
        match word >> 12 {
            0x4 => self.vector_at_border(word & 0xfff, 12, sink),
            0x5 => self.vector_at_border(word & 0xff, 8, sink),
            0x8 => self.time_high(word),
            0xa => self.trigger(word, sink),
            _ => self.skipped.unknown_words += 1,
        }
    }

    /// A vector without a base, or one that reaches beyond the last column.
    fn vector_at_border<S: Sink>(&mut self, valid: u16, width: u16, sink: &mut S) {
        match self.column {
            NO_COLUMN => self.drop_events(valid.count_ones()),
            0x800.. => self.skipped.outside_format += 1,
            column => {
                let event = unpack(self.row | self.vector_on, self.clock.base_us().unwrap_or(0));
                let set = (0..width).filter(|bit| valid >> bit & 1 != 0);
                sink.events(set.map(|bit| Event { x: column + bit, ..event }));
                self.column = column + width;
            }
        }
    }

    /// The low bits become 0 only where the high ones change: cameras repeat TIME_HIGH, and TIME_LOW follows a change.
    fn time_high(&mut self, word: u16) {
        match self.clock.step(u32::from(word & 0xfff)) {
            Step::Same => return,
            Step::Forward => (),
            Step::Back => self.skipped.time_steps_back += 1,
        }
        self.row &= !PLACES[0x6].field;
    }

    fn trigger<S: Sink>(&mut self, word: u16, sink: &mut S) {
        let Some(base_us) = self.clock.base_us() else {
            self.skipped.before_time += 1;
            return;
        };
        let t_us = unpack(self.row, base_us).t_us;
        sink.trigger(Trigger { t_us, channel: (word >> 8 & 0xf) as u8, rising: word & 1 != 0 });
    }

    #[cold]
    fn drop_events(&mut self, count: u32) {
        let time_known = self.clock.base_us().is_some();
        let counter = if time_known { &mut self.skipped.before_address } else { &mut self.skipped.before_time };
        *counter += u64::from(count);
    }
}
