//! The rules of EVT3 written down word by word: slow, and what the fast decoder is held against.

use crate::events::clock::{EVT3_TIME, HighClock, Step};
use crate::events::{Event, Sink, Skipped, Trigger};

/// The state that EVT3 words change, one word after the other.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlainEvt3 {
    clock: HighClock,
    time_us: i64,
    y: u16,
    vector_x: u16,
    vector_on: bool,
    time_known: bool,
    row_known: bool,
    vector_known: bool,
    pub(super) skipped: Skipped,
}

impl PlainEvt3 {
    pub(super) fn new() -> Self {
        Self {
            clock: HighClock::new(EVT3_TIME),
            time_us: 0,
            y: 0,
            vector_x: 0,
            vector_on: false,
            time_known: false,
            row_known: false,
            vector_known: false,
            skipped: Skipped::default(),
        }
    }

    pub(super) fn resync(&mut self, epoch_us: i64) {
        *self = Self { skipped: self.skipped, ..Self::new() };
        self.clock.resync(epoch_us);
    }

    pub(super) fn words<S: Sink>(&mut self, words: &[[u8; 2]], sink: &mut S) {
        for word in words {
            self.word(u16::from_le_bytes(*word), sink);
        }
    }

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

    fn single<S: Sink>(&mut self, word: u16, sink: &mut S) {
        if self.time_known & self.row_known {
            sink.event(Event { t_us: self.time_us, x: word & 0x7ff, y: self.y, on: word & 0x800 != 0 });
        } else {
            self.drop_events(1);
        }
    }

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
    fn time_high(&mut self, word: u16) {
        match self.clock.step(u32::from(word & 0xfff)) {
            Step::Same => return,
            Step::Forward => (),
            Step::Back => self.skipped.time_steps_back += 1,
        }
        self.time_us = self.clock.base_us().unwrap_or(0);
        self.time_known = true;
    }

    fn trigger<S: Sink>(&mut self, word: u16, sink: &mut S) {
        if self.time_known {
            let channel = (word >> 8 & 0xf) as u8;
            sink.trigger(Trigger { t_us: self.time_us, channel, rising: word & 1 != 0 });
        } else {
            self.skipped.before_time += 1;
        }
    }

    fn drop_events(&mut self, count: u32) {
        let counter = if self.time_known { &mut self.skipped.before_address } else { &mut self.skipped.before_time };
        *counter += u64::from(count);
    }
}
