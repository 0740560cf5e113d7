//! State across packet borders, wraps of the time, words that mean nothing to us; the fast decoder against the rules.

use proptest::prelude::*;
use proptest::test_runner::RngSeed;

use super::plain_evt3::PlainEvt3;
use super::{FORMATS, decode, decode_pieces};
use crate::events::{Decoder, Encoder, Event, Format, Sink, Skipped, Trigger};

const EVT21: [Format; 2] = [Format::Evt21 { legacy_halves: false }, Format::Evt21 { legacy_halves: true }];

fn event(t_us: i64, x: u16) -> Event {
    Event { t_us, x, y: 7, on: x % 2 == 1 }
}

fn encoded(format: Format, events: &[Event], triggers: &[Trigger]) -> Vec<u8> {
    let mut bytes = Vec::new();
    Encoder::new(format).encode(events, triggers, &mut bytes).unwrap();
    bytes
}

/// Words of a format with nothing but a kind in each, spread over the bytes as the format does.
fn words_of_kinds(format: Format, kinds: &[u32]) -> Vec<u8> {
    let word = |kind: &u32| match format {
        Format::Evt3 => ((kind << 12) as u16 | 0x123).to_le_bytes().to_vec(),
        Format::Evt2 => (kind << 28 | 0x0123_4567).to_le_bytes().to_vec(),
        Format::Evt21 { legacy_halves } => {
            let halves = [0x89ab_cdef_u32, kind << 28 | 0x0123_4567];
            let [low, high] = halves.map(u32::to_le_bytes);
            if legacy_halves { [high, low].concat() } else { [low, high].concat() }
        }
    };
    kinds.iter().flat_map(word).collect()
}

#[test]
fn a_cut_at_any_byte_changes_nothing() {
    let on_row = |t_us, columns: std::ops::Range<u16>| columns.map(move |x| Event { t_us, x, y: 9, on: true });
    let events: Vec<Event> =
        on_row(100, 40..75).chain(on_row(16_777_300, 3..9)).chain([event(16_777_300, 2000)]).collect();
    let edge = |t_us, rising| Trigger { t_us, channel: 2, rising };
    let triggers = [edge(100, true), edge(9_000_000, false)];
    for format in FORMATS {
        let bytes = encoded(format, &events, &triggers);
        for cut in 0..=bytes.len() {
            let found = decode_pieces(&mut Decoder::new(format), &bytes, &[cut]);
            assert_eq!(found, (events.clone(), triggers.to_vec()), "{format} cut at {cut}");
        }
        let every_byte: Vec<usize> = (0..bytes.len()).collect();
        assert_eq!(decode_pieces(&mut Decoder::new(format), &bytes, &every_byte).0, events, "{format}");
    }
}

#[test]
fn wraps_of_every_format_are_unrolled() {
    for format in FORMATS {
        let wrap_us: i64 = if format == Format::Evt3 { 1 << 24 } else { 1 << 34 };
        let times_us = [wrap_us - 1, wrap_us, wrap_us + 1, 2 * wrap_us - 63, 2 * wrap_us, 3 * wrap_us + 5];
        let events = times_us.map(|t_us| event(t_us, 5));
        let edges = times_us.map(|t_us| Trigger { t_us, channel: 0, rising: true });
        let bytes = encoded(format, &events, &edges);
        assert_eq!(decode(format, &bytes), (events.to_vec(), edges.to_vec()), "{format}");
        // Joined later, the number of wraps before is not in the bytes.
        let mut late = Decoder::new(format);
        late.set_epoch_us(5 * wrap_us);
        let (moved, _) = decode_pieces(&mut late, &bytes, &[]);
        assert_eq!(moved.first().map(|event| event.t_us), Some(5 * wrap_us - 1), "{format}");
    }
}

#[test]
fn words_of_the_vendor_and_of_the_future_lose_no_event() {
    let [before, after] = [event(5_000, 11), event(5_001, 12)];
    for (format, vendor, unknown) in [
        (Format::Evt3, vec![0xe, 0xf, 0xf, 0x7, 0x7], vec![0x1, 0x9, 0xb, 0xc, 0xd]),
        (Format::Evt2, vec![0xe, 0xf, 0xf], vec![0x2, 0x3, 0x4, 0x5, 0x6, 0x7, 0x9, 0xb, 0xc, 0xd]),
        (EVT21[0], vec![0xe, 0xf, 0xf], vec![0x2, 0x7, 0x9, 0xd]),
        (EVT21[1], vec![0xe, 0xf, 0xf], vec![0x2, 0x7, 0x9, 0xd]),
    ] {
        let whole = encoded(format, &[before, after], &[]);
        let first = encoded(format, &[before], &[]).len();
        let foreign = [words_of_kinds(format, &vendor), words_of_kinds(format, &unknown)].concat();
        let bytes = [&whole[..first], &foreign, &whole[first..]].concat();
        let mut decoder = Decoder::new(format);
        assert_eq!(decode_pieces(&mut decoder, &bytes, &[]), (vec![before, after], vec![]), "{format}");
        let (vendor_words, unknown_words) = (vendor.len() as u64, unknown.len() as u64);
        assert_eq!(decoder.skipped(), Skipped { vendor_words, unknown_words, ..Skipped::default() }, "{format}");
    }
}

#[test]
fn the_halves_of_evt21_are_told_apart_by_the_format_alone() {
    let events: Vec<Event> = (64..90).map(|x| Event { t_us: 77, x, y: 3, on: false }).collect();
    let [little, legacy] = EVT21.map(|format| encoded(format, &events, &[]));
    let turned: Vec<u8> = little.chunks(8).flat_map(|word| [&word[4..], &word[..4]].concat()).collect();
    assert_eq!(turned, legacy);
    assert_eq!(decode(EVT21[1], &legacy).0, events);
    assert_ne!(decode(EVT21[0], &legacy).0, events);
}

/// Everything in the order in which it arrives.
#[derive(Debug, Default, PartialEq)]
struct Arrived(Vec<Result<Event, Trigger>>);

impl Sink for Arrived {
    fn event(&mut self, event: Event) {
        self.0.push(Ok(event));
    }

    fn trigger(&mut self, trigger: Trigger) {
        self.0.push(Err(trigger));
    }
}

/// EVT3 words as cameras send them, with whatever can go wrong: any kind at any place, rows and vectors more often.
fn words() -> impl Strategy<Value = Vec<u16>> {
    let kinds: [(u32, u16); 12] = [
        (6, 0x0),
        (6, 0x2),
        (4, 0x3),
        (8, 0x4),
        (6, 0x5),
        (6, 0x6),
        (1, 0x7),
        (1, 0xa),
        (1, 0xe),
        (1, 0xf),
        (1, 0xb),
        (1, 0x1),
    ];
    let any_word = kinds.map(|(weight, kind)| (weight, (0_u16..0x1000).prop_map(move |v| kind << 12 | v).boxed()));
    // TIME_HIGH mostly repeats or goes on by one; now and then it jumps.
    let high = prop_oneof![6 => 0x8100_u16..0x8103, 1 => 0x8000_u16..0x9000].boxed();
    let all = any_word.into_iter().chain([(5, high)]).collect();
    prop::collection::vec(prop::strategy::Union::new_weighted(all), 0..400)
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 400, rng_seed: RngSeed::Fixed(11), failure_persistence: None, ..Default::default()
    })]

    #[test]
    fn the_fast_decoder_keeps_to_the_rules(
        words in words(),
        epoch_us in prop::option::of(0_i64..1 << 40),
        cuts in prop::collection::vec(any::<usize>(), 0..6),
    ) {
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        let (mut plain, mut fast, mut pieces) =
            (PlainEvt3::new(), Decoder::new(Format::Evt3), Decoder::new(Format::Evt3));
        if let Some(epoch_us) = epoch_us {
            plain.resync(epoch_us);
            fast.set_epoch_us(epoch_us);
            pieces.set_epoch_us(epoch_us);
        }
        let (mut expected, mut found) = (Arrived::default(), Arrived::default());
        plain.words(bytes.as_chunks().0, &mut expected);
        fast.decode_into(&bytes, &mut found);
        prop_assert_eq!(&found, &expected);
        prop_assert_eq!(fast.skipped(), plain.skipped);
        let (events, _) = decode_pieces(&mut pieces, &bytes, &cuts);
        prop_assert!(events.into_iter().eq(expected.0.into_iter().filter_map(Result::ok)));
        prop_assert_eq!(pieces.skipped(), plain.skipped);
    }
}
