//! Streaming encoders: events and triggers, sorted by time, become the bytes of a camera.

use super::clock::{EVT2_TIME, EVT3_TIME, TimeLayout};
use super::{EncodeError, Event, Format, Trigger};

/// Longest gap that is bridged.
const GAP_MAX_US: i64 = 24 * 3_600_000_000;

/// A vector of EVT3 takes a base word and a mask; below this many events in 12 columns single words are no longer.
const VECTOR_EVENTS_MIN: usize = 3;

/// Encodes one stream in one format; decoding gives back the same events in the same order.
///
/// Times count modulo the wrap of the format, so a stream that starts after the first wrap (16.78 s for EVT3) is
/// decoded as starting in the first, as with real cameras. Gaps are bridged by TIME_HIGH words, and every wrap is
/// passed from the highest to 0, so that no decoder loses count.
#[derive(Debug, Clone)]
pub struct Encoder {
    format: Format,
    last_us: Option<i64>,
    /// The upper time last written, not wrapped.
    high: Option<i64>,
    low: Option<u16>,
    y: Option<u16>,
}

impl Encoder {
    /// An encoder at the start of a stream.
    pub fn new(format: Format) -> Self {
        Self { format, last_us: None, high: None, low: None, y: None }
    }

    /// Forgets what has been written, so that the next bytes can be decoded without the ones before.
    pub fn restart(&mut self) {
        *self = Self::new(self.format);
    }

    /// Appends `events` and `triggers`, each sorted by time and none earlier than the call before.
    ///
    /// Of equal times the trigger comes first.
    ///
    /// # Errors
    /// [`EncodeError`] where the format cannot hold the input; `out` and the encoder are as before then.
    pub fn encode(
        &mut self,
        mut events: &[Event],
        mut triggers: &[Trigger],
        out: &mut Vec<u8>,
    ) -> Result<(), EncodeError> {
        self.check(events, triggers)?;
        loop {
            match (events.first(), triggers.split_first()) {
                (None, None) => return Ok(()),
                (Some(event), Some((trigger, _))) if event.t_us < trigger.t_us => events = self.run(events, out),
                (_, Some((trigger, rest))) => {
                    self.trigger(trigger, out);
                    triggers = rest;
                }
                (Some(_), None) => events = self.run(events, out),
            }
        }
    }

    fn check(&self, events: &[Event], triggers: &[Trigger]) -> Result<(), EncodeError> {
        self.check_times(events.iter().map(|event| event.t_us))?;
        self.check_times(triggers.iter().map(|trigger| trigger.t_us))?;
        if let Some(&Event { x, y, .. }) = events.iter().find(|event| event.x > 0x7ff || event.y > 0x7ff) {
            return Err(EncodeError::Pixel { x, y });
        }
        let max = if self.format == Format::Evt3 { 15 } else { 31 };
        match triggers.iter().find(|trigger| trigger.channel > max) {
            Some(&Trigger { channel, .. }) => Err(EncodeError::Channel { channel, max }),
            None => Ok(()),
        }
    }

    fn check_times(&self, times_us: impl Iterator<Item = i64>) -> Result<(), EncodeError> {
        let mut previous = self.last_us;
        for t_us in times_us {
            if t_us < 0 {
                return Err(EncodeError::NegativeTime { t_us });
            }
            match previous {
                Some(previous_us) if t_us < previous_us => return Err(EncodeError::NotSorted { previous_us, t_us }),
                Some(previous_us) if t_us - previous_us > GAP_MAX_US => {
                    return Err(EncodeError::Gap { gap_us: t_us - previous_us });
                }
                _ => previous = Some(t_us),
            }
        }
        Ok(())
    }

    /// Writes the longest start of `events` that shares time, row and polarity; returns the others.
    fn run<'a>(&mut self, events: &'a [Event], out: &mut Vec<u8>) -> &'a [Event] {
        let (run, rest) = events.split_at(run_len(events));
        let Some(&Event { t_us, y, on, .. }) = run.first() else { return rest };
        self.time(t_us, out);
        match self.format {
            Format::Evt2 => run.iter().for_each(|event| out.extend(evt2_word(event).to_le_bytes())),
            Format::Evt21 { legacy_halves } => evt21_run(run, legacy_halves, out),
            Format::Evt3 => {
                if self.y != Some(y) {
                    push16(out, y);
                    self.y = Some(y);
                }
                evt3_run(run, on, out);
            }
        }
        rest
    }

    fn trigger(&mut self, trigger: &Trigger, out: &mut Vec<u8>) {
        self.time(trigger.t_us, out);
        let Trigger { t_us, channel, rising } = *trigger;
        let evt2 = 0xa << 28 | low6(t_us) << 22 | u32::from(channel) << 8 | u32::from(rising);
        match self.format {
            Format::Evt2 => out.extend(evt2.to_le_bytes()),
            Format::Evt21 { legacy_halves } => push64(out, evt2, 0, legacy_halves),
            Format::Evt3 => push16(out, 0xa000 | u16::from(channel) << 8 | u16::from(rising)),
        }
    }

    /// Brings the time of the stream to `t_us`.
    fn time(&mut self, t_us: i64, out: &mut Vec<u8>) {
        self.last_us = Some(t_us);
        let layout = if self.format == Format::Evt3 { EVT3_TIME } else { EVT2_TIME };
        let high = t_us >> layout.low_bits;
        while self.high != Some(high) {
            let next = self.high.map_or(high, |at| next_high(at, high, layout));
            self.push_high(next, out);
            self.high = Some(next);
            self.low = None;
        }
        let low = (t_us & 0xfff) as u16;
        if self.format == Format::Evt3 && self.low != Some(low) {
            push16(out, 0x6000 | low);
            self.low = Some(low);
        }
    }

    fn push_high(&self, high: i64, out: &mut Vec<u8>) {
        let evt2 = 0x8 << 28 | (high & 0x0fff_ffff) as u32;
        match self.format {
            Format::Evt2 => out.extend(evt2.to_le_bytes()),
            Format::Evt21 { legacy_halves } => push64(out, evt2, 0, legacy_halves),
            Format::Evt3 => push16(out, 0x8000 | (high & 0xfff) as u16),
        }
    }
}

/// The next TIME_HIGH on the way from `at` to `goal`: at most a quarter wrap on, and never across a wrap but from its
/// last to its first, because decoders tell wraps by rules that differ.
fn next_high(at: i64, goal: i64, layout: TimeLayout) -> i64 {
    let wrap = 1_i64 << layout.high_bits;
    let last = at | (wrap - 1);
    if at == last { at + 1 } else { goal.min(last).min(at + wrap / 4) }
}

/// Events from the first on with its time, row and polarity, and rising columns.
fn run_len(events: &[Event]) -> usize {
    let joins = |pair: &&[Event; 2]| {
        let [a, b] = **pair;
        a.t_us == b.t_us && a.y == b.y && a.on == b.on && a.x < b.x
    };
    let pairs = events.iter().zip(events.iter().skip(1)).map(|(a, b)| [*a, *b]);
    1.min(events.len()) + pairs.take_while(|pair| joins(&pair)).count()
}

/// Writes a run as vectors where they are shorter, and as single events elsewhere.
fn evt3_run(mut run: &[Event], on: bool, out: &mut Vec<u8>) {
    let polarity = u16::from(on) << 11;
    while let Some(&Event { x, .. }) = run.first() {
        let mut ahead = within(run, x, 12);
        if ahead < VECTOR_EVENTS_MIN {
            push16(out, 0x2000 | polarity | x);
            run = &run[1..];
            continue;
        }
        push16(out, 0x3000 | polarity | x);
        let mut base = x;
        // A further vector of the same base costs one word, as much as a single event, so it pays from two events on.
        while ahead >= 2 {
            let (vector, rest) = run.split_at(ahead);
            base += push_vector(vector, base, out);
            run = rest;
            ahead = within(run, base, 12);
        }
    }
}

/// Writes a mask for columns from `base` on; returns how far it moves the base.
fn push_vector(events: &[Event], base: u16, out: &mut Vec<u8>) -> u16 {
    let mask = events.iter().fold(0_u16, |mask, event| mask | 1 << (event.x - base));
    if mask <= 0xff {
        push16(out, 0x5000 | mask);
        8
    } else {
        push16(out, 0x4000 | mask);
        12
    }
}

/// How many events at the start of a run lie in `base..base + columns`; 0 if the base is beyond the format.
fn within(run: &[Event], base: u16, columns: u16) -> usize {
    if base > 0x7ff { 0 } else { run.iter().take_while(|event| event.x - base < columns).count() }
}

/// Writes a run as one word for every aligned 32 columns that it touches.
fn evt21_run(run: &[Event], legacy_halves: bool, out: &mut Vec<u8>) {
    for block in run.chunk_by(|a, b| a.x / 32 == b.x / 32) {
        let Some(first) = block.first() else { continue };
        let valid = block.iter().fold(0_u32, |mask, event| mask | 1 << (event.x % 32));
        push64(out, evt2_word(&Event { x: first.x / 32 * 32, ..*first }), valid, legacy_halves);
    }
}

fn evt2_word(event: &Event) -> u32 {
    u32::from(event.on) << 28 | low6(event.t_us) << 22 | u32::from(event.x) << 11 | u32::from(event.y)
}

fn low6(t_us: i64) -> u32 {
    (t_us & 0x3f) as u32
}

fn push16(out: &mut Vec<u8>, word: u16) {
    out.extend(word.to_le_bytes());
}

fn push64(out: &mut Vec<u8>, upper: u32, lower: u32, legacy_halves: bool) {
    let word = u64::from(upper) << 32 | u64::from(lower);
    out.extend(word.rotate_left(if legacy_halves { 32 } else { 0 }).to_le_bytes());
}
