use super::decode;
use crate::events::{Decoder, Encoder, Event, Format, Skipped, Trigger, events_between};

fn evt3(words: &[u16]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

fn event(t_us: i64, x: u16, y: u16, on: bool) -> Event {
    Event { t_us, x, y, on }
}

fn skipped(format: Format, bytes: &[u8]) -> Skipped {
    let mut decoder = Decoder::new(format);
    decoder.decode(bytes, &mut Vec::new(), &mut Vec::new());
    decoder.skipped()
}

#[test]
fn evt3_words_by_hand() {
    let bytes = evt3(&[
        0x8001, 0x6064, 0x0032, 0x2864, // time 4096 + 100, row 50, ON at 100
        0xa301, 0xe123, 0xf456, 0x7007, // rising edge on 3, vendor words
        0x3008, 0x4801, 0x500d, // OFF vectors from column 8: 8, 19, then 20, 22, 23
        0x8001, 0x2005, // the same TIME_HIGH again keeps the low bits
        0x8002, 0x2006, // a new one clears them
    ]);
    let (events, triggers) = decode(Format::Evt3, &bytes);
    let off = |x| event(4196, x, 50, false);
    let expected =
        [event(4196, 100, 50, true), off(8), off(19), off(20), off(22), off(23), off(5), event(8192, 6, 50, false)];
    assert_eq!(events, expected);
    assert_eq!(triggers, [Trigger { t_us: 4196, channel: 3, rising: true }]);
    assert_eq!(skipped(Format::Evt3, &bytes), Skipped { vendor_words: 3, ..Skipped::default() });
}

#[test]
fn evt2_and_evt21_words_by_hand() {
    let evt2: [u32; 5] =
        [0x8000_0002, 0x1000_0000 | 5 << 22 | 1279 << 11 | 719, 0xa000_0000 | 6 << 22 | 17 << 8, 0, 0xe000_0000];
    let bytes: Vec<u8> = evt2.iter().flat_map(|word| word.to_le_bytes()).collect();
    let (events, triggers) = decode(Format::Evt2, &bytes);
    assert_eq!(events, [event(133, 1279, 719, true), event(128, 0, 0, false)]);
    assert_eq!(triggers, [Trigger { t_us: 134, channel: 17, rising: false }]);
    // Whole words (GenX320), and words sent upper half first (IMX636).
    for (legacy_halves, words) in [
        (false, [0x8000_0002_0000_0000_u64, (0x1000_0000 | 5 << 22 | 32 << 11 | 719) << 32 | 0x8000_0001]),
        (true, [0x0000_0000_8000_0002, 0x8000_0001 << 32 | 0x1000_0000 | 5 << 22 | 32 << 11 | 719]),
    ] {
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        let (events, _) = decode(Format::Evt21 { legacy_halves }, &bytes);
        assert_eq!(events, [event(133, 32, 719, true), event(133, 63, 719, true)]);
    }
}

#[test]
fn what_cannot_be_placed_is_dropped_and_counted() {
    let early = evt3(&[0x2001, 0x0001, 0x3001, 0x4003, 0xa001, 0x8000, 0x2002]);
    let (events, triggers) = decode(Format::Evt3, &early);
    assert_eq!((events, triggers.len()), (vec![event(0, 2, 1, false)], 0));
    assert_eq!(skipped(Format::Evt3, &early), Skipped { before_time: 4, ..Skipped::default() });
    let unplaced = evt3(&[0x8000, 0x2002, 0x4003, 0x0001, 0x5001, 0x1000, 0x9000]);
    let expected = Skipped { before_address: 4, unknown_words: 2, ..Skipped::default() };
    assert_eq!(skipped(Format::Evt3, &unplaced), expected);
    let beyond = evt3(&[&[0x8000, 0x0000, 0x37ff, 0x4001][..], &[0x4001; 9000]].concat());
    assert_eq!(decode(Format::Evt3, &beyond).0, [event(0, 2047, 0, false)]);
    assert_eq!(skipped(Format::Evt3, &beyond).outside_format, 9000);
}

#[test]
fn pending_bytes_tell_a_cut_stream() {
    for format in super::FORMATS {
        let mut decoder = Decoder::new(format);
        for length in 1..=3 * format.word_bytes() {
            decoder.decode(&[0x80], &mut Vec::new(), &mut Vec::new());
            assert_eq!(decoder.pending_bytes(), length % format.word_bytes());
        }
    }
}

#[test]
fn resync_after_a_gap_finds_the_wrap_and_drops_stale_state() {
    let packet = |t_us| {
        let mut bytes = Vec::new();
        Encoder::new(Format::Evt3).encode(&[event(t_us, 1, 2, true)], &[], &mut bytes).unwrap();
        bytes
    };
    let mut decoder = Decoder::new(Format::Evt3);
    let (mut events, mut triggers) = (Vec::new(), Vec::new());
    for (t_us, epoch_us) in [(5_000, 0), (3_217_400_123, 3_220_000_000), (3_300_000_000, 3_292_000_000)] {
        decoder.set_epoch_us(epoch_us);
        // Half a word lost in the gap, and an event whose row and time went with it.
        decoder.decode(&[&evt3(&[0x2123])[..], &packet(t_us), &[0x77]].concat(), &mut events, &mut triggers);
    }
    let times: Vec<i64> = events.iter().map(|event| event.t_us).collect();
    assert_eq!(times, [5_000, 3_217_400_123, 3_300_000_000]);
    assert_eq!(decoder.skipped().before_time, 3);
}

#[test]
fn events_between_takes_the_start_and_not_the_end() {
    let events: Vec<Event> = [1, 2, 2, 3, 5].map(|t_us| event(t_us, 0, 0, true)).to_vec();
    for (start_us, end_us, count) in [(2, 3, 2), (0, 9, 5), (4, 5, 0), (5, 6, 1), (6, 9, 0), (3, 1, 0)] {
        assert_eq!(events_between(&events, start_us, end_us).len(), count, "{start_us}..{end_us}");
    }
}
