use proptest::prelude::*;
use proptest::test_runner::RngSeed;

use super::{FORMATS, decode, decode_pieces};
use crate::events::{Decoder, EncodeError, Encoder, Event, Format, Trigger};

/// Rows of neighbouring events of one polarity, as edges of a blinking board give, with pauses between.
fn streams() -> impl Strategy<Value = (Vec<Event>, Vec<Trigger>)> {
    let pause_us = prop_oneof![4 => 0_i64..3, 4 => 0_i64..5_000, 1 => 0_i64..60_000_000];
    let row = (pause_us, 0_u16..2048, 0_u16..2048, any::<bool>(), prop::collection::vec(0_u16..20, 0..40));
    let edge = prop::option::weighted(0.2, (0_u8..16, any::<bool>()));
    prop::collection::vec((row, edge), 0..30).prop_map(|rows| {
        let (mut t_us, mut events, mut triggers) = (0, Vec::new(), Vec::new());
        for ((pause_us, mut x, y, on, steps), edge) in rows {
            t_us = if events.is_empty() && triggers.is_empty() { pause_us % 16_000_000 } else { t_us + pause_us };
            triggers.extend(edge.map(|(channel, rising)| Trigger { t_us, channel, rising }));
            for step in steps {
                // A step of 0 repeats a column, and past the last one it starts again: neither may join a vector.
                x = (x + step) % 2048;
                events.push(Event { t_us, x, y, on });
            }
        }
        (events, triggers)
    })
}

fn config() -> ProptestConfig {
    ProptestConfig { cases: 200, rng_seed: RngSeed::Fixed(7), failure_persistence: None, ..Default::default() }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn what_is_encoded_is_decoded(
        (events, triggers) in streams(),
        cuts in prop::collection::vec(any::<usize>(), 0..8),
        calls in 1_usize..4,
    ) {
        for format in FORMATS {
            let (mut encoder, mut bytes) = (Encoder::new(format), Vec::new());
            for call in 0..calls {
                let part = |t_us: i64| t_us as usize / 1_000_000 * calls / 600;
                let mine = |t_us: i64| part(t_us).min(calls - 1) == call;
                let some: Vec<Event> = events.iter().copied().filter(|event| mine(event.t_us)).collect();
                let edges: Vec<Trigger> = triggers.iter().copied().filter(|edge| mine(edge.t_us)).collect();
                encoder.encode(&some, &edges, &mut bytes).unwrap();
            }
            let mut decoder = Decoder::new(format);
            prop_assert_eq!(decode_pieces(&mut decoder, &bytes, &cuts), (events.clone(), triggers.clone()));
            prop_assert_eq!((decoder.pending_bytes(), decoder.skipped()), (0, Default::default()));
        }
    }

    #[test]
    fn arbitrary_bytes_do_no_harm_however_they_are_cut(
        bytes in prop::collection::vec(any::<u8>(), 0..2000),
        cuts in prop::collection::vec(any::<usize>(), 0..8),
        epoch_us in prop::option::of(any::<i64>()),
    ) {
        for format in FORMATS {
            let (mut whole, mut pieces) = (Decoder::new(format), Decoder::new(format));
            for decoder in [&mut whole, &mut pieces] {
                epoch_us.into_iter().for_each(|epoch_us| decoder.set_epoch_us(epoch_us));
            }
            let expected = decode_pieces(&mut whole, &bytes, &[]);
            prop_assert_eq!(decode_pieces(&mut pieces, &bytes, &cuts), expected);
            prop_assert_eq!(pieces.skipped(), whole.skipped());
            prop_assert_eq!(pieces.pending_bytes(), bytes.len() % format.word_bytes());
        }
    }

    #[test]
    fn a_foreign_decoder_reads_our_evt3((events, triggers) in streams()) {
        let mut bytes = Vec::new();
        Encoder::new(Format::Evt3).encode(&events, &triggers, &mut bytes).unwrap();
        let (mut seen, mut edges) = (Vec::new(), Vec::new());
        evt3::Evt3Decoder::new().decode_bytes(&bytes, &mut seen, &mut edges).unwrap();
        let seen: Vec<Event> = seen.iter().map(super::recordings::event_from_foreign).collect();
        prop_assert_eq!(seen, events);
        prop_assert_eq!(edges.len(), triggers.len());
    }
}

#[test]
fn neighbours_are_packed_into_vectors() {
    let row: Vec<Event> = (0..32).map(|x| Event { t_us: 5, x: 64 + x, y: 9, on: true }).collect();
    let size = |events: &[Event], format| {
        let mut bytes = Vec::new();
        Encoder::new(format).encode(events, &[], &mut bytes).unwrap();
        bytes.len() / Format::word_bytes(format)
    };
    assert_eq!(size(&row, Format::Evt3), 3 + 4, "time, time, row; base, 12, 12, 8");
    assert_eq!(size(&row[..2], Format::Evt3), 3 + 2);
    assert_eq!(size(&row, Format::Evt2), 1 + 32);
    for legacy_halves in [false, true] {
        assert_eq!(size(&row, Format::Evt21 { legacy_halves }), 1 + 1);
    }
}

#[test]
fn after_a_restart_bytes_stand_alone() {
    for format in FORMATS {
        let event = Event { t_us: 70_000, x: 3, y: 4, on: false };
        let (mut encoder, mut bytes) = (Encoder::new(format), Vec::new());
        encoder.encode(&[event], &[], &mut bytes).unwrap();
        encoder.restart();
        let mut again = Vec::new();
        encoder.encode(&[event], &[], &mut again).unwrap();
        assert_eq!(decode(format, &again).0, [event]);
        assert_eq!(again, bytes);
    }
}

#[test]
fn what_a_format_cannot_hold_is_refused_and_leaves_no_trace() {
    let event = |t_us, x, y| Event { t_us, x, y, on: true };
    let edge = |channel| Trigger { t_us: 10, channel, rising: true };
    let mut encoder = Encoder::new(Format::Evt3);
    let mut out = Vec::new();
    encoder.encode(&[event(10, 1, 1)], &[], &mut out).unwrap();
    let before = out.clone();
    let day_us = 86_400_000_000;
    for (events, triggers, error) in [
        (vec![event(9, 1, 1)], vec![], EncodeError::NotSorted { previous_us: 10, t_us: 9 }),
        (vec![event(12, 1, 1), event(11, 1, 1)], vec![], EncodeError::NotSorted { previous_us: 12, t_us: 11 }),
        (vec![event(-1, 1, 1)], vec![], EncodeError::NegativeTime { t_us: -1 }),
        (vec![event(day_us + 11, 1, 1)], vec![], EncodeError::Gap { gap_us: day_us + 1 }),
        (vec![event(11, 2048, 1)], vec![], EncodeError::Pixel { x: 2048, y: 1 }),
        (vec![event(11, 1, 9999)], vec![], EncodeError::Pixel { x: 1, y: 9999 }),
        (vec![], vec![edge(16)], EncodeError::Channel { channel: 16, max: 15 }),
    ] {
        assert_eq!(encoder.encode(&events, &triggers, &mut out), Err(error));
        assert_eq!(out, before);
    }
    assert_eq!(Encoder::new(Format::Evt2).encode(&[], &[edge(31)], &mut out), Ok(()));
}
