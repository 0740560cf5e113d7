//! What the event decoders do with bytes: shared by the fuzz target and the test over its corpus.

use cellcal::events::{Decoder, Event, Format, RawInfo, Skipped, Trigger};

const FORMATS: [Format; 4] =
    [Format::Evt2, Format::Evt21 { legacy_halves: false }, Format::Evt21 { legacy_halves: true }, Format::Evt3];

/// Decodes bytes in every format, whole and in pieces, and opens them as a RAW file.
pub(crate) fn decode_anything(bytes: &[u8]) {
    // The first byte says how the pieces grow, the second whether the stream is joined midway, and where.
    let [growth, joined, data @ ..] = bytes else { return };
    let epoch_us = (joined % 2 == 1).then_some(i64::from(*joined) << 55);
    for format in FORMATS {
        let whole = decode(format, epoch_us, [data]);
        assert!(whole.0.iter().all(|event| event.y < 2048), "{format} has 11 bits for a row");
        assert_eq!(decode(format, epoch_us, pieces(data, *growth)), whole, "{format} cut into pieces");
    }
    let _ = RawInfo::from_bytes(bytes);
}

type Decoded = (Vec<Event>, Vec<Trigger>, Skipped, usize);

fn decode<'a>(format: Format, epoch_us: Option<i64>, pieces: impl IntoIterator<Item = &'a [u8]>) -> Decoded {
    let (mut decoder, mut events, mut triggers) = (Decoder::new(format), Vec::new(), Vec::new());
    if let Some(epoch_us) = epoch_us {
        decoder.set_epoch_us(epoch_us);
    }
    for piece in pieces {
        decoder.decode(piece, &mut events, &mut triggers);
    }
    (events, triggers, decoder.skipped(), decoder.pending_bytes())
}

/// Pieces of 0, `growth`, 2 `growth`, ... bytes modulo 17, so that every cut of a word occurs.
fn pieces(mut data: &[u8], growth: u8) -> Vec<&[u8]> {
    let mut pieces = Vec::new();
    for length in (0..).map(|n: usize| n * usize::from(growth) % 17 + n % 2) {
        if data.is_empty() {
            return pieces;
        }
        let (piece, rest) = data.split_at(length.min(data.len()));
        pieces.push(piece);
        data = rest;
    }
    pieces
}
