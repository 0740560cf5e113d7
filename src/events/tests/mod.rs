//! Tests of reading and writing event data as a whole.

mod cuts;
mod header;
mod plain_evt3;
mod recordings;
mod round_trip;
mod words;

use super::{Decoder, Event, Format, Trigger};

/// All formats.
const FORMATS: [Format; 4] =
    [Format::Evt2, Format::Evt21 { legacy_halves: false }, Format::Evt21 { legacy_halves: true }, Format::Evt3];

/// Everything in a stream that arrives in pieces cut at `cuts`.
fn decode_pieces(decoder: &mut Decoder, bytes: &[u8], cuts: &[usize]) -> (Vec<Event>, Vec<Trigger>) {
    let mut cuts: Vec<usize> = cuts.iter().map(|cut| cut % (bytes.len() + 1)).collect();
    cuts.push(bytes.len());
    cuts.sort_unstable();
    let (mut events, mut triggers, mut start) = (Vec::new(), Vec::new(), 0);
    for cut in cuts {
        decoder.decode(&bytes[start..cut], &mut events, &mut triggers);
        start = cut;
    }
    (events, triggers)
}

/// Everything in a whole stream.
fn decode(format: Format, bytes: &[u8]) -> (Vec<Event>, Vec<Trigger>) {
    decode_pieces(&mut Decoder::new(format), bytes, &[])
}
