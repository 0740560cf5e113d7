//! Real recordings, against published counts and a decoder that we did not write.

use std::path::PathBuf;

use super::decode;
use crate::events::{Encoder, Event, EventDigest, Format, Header, RawInfo, Trigger};

pub(super) fn event_from_foreign(event: &evt3::CdEvent) -> Event {
    Event { t_us: event.timestamp as i64, x: event.x, y: event.y, on: event.polarity == 1 }
}

/// The bytes of a recording, and what is known about it; `None` where no recordings were asked for.
fn recording(folder: &str, name: &str) -> Option<(Vec<u8>, serde_json::Value)> {
    let Some(root) = std::env::var_os("CELLCAL_DATA") else {
        eprintln!("skipped: CELLCAL_DATA does not name the folder of recordings");
        return None;
    };
    let folder = PathBuf::from(root).join(folder);
    let read = |name: &str| {
        let path = folder.join(name);
        std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    };
    Some((read(name), serde_json::from_slice(&read("expected.json")).unwrap()))
}

fn check_info(bytes: &[u8], expected: &serde_json::Value) -> serde_json::Value {
    let info = serde_json::to_value(RawInfo::from_bytes(bytes).unwrap()).unwrap();
    assert_eq!(info["format"], expected["encoding"]);
    for (ours, theirs) in [
        ("events", "n"),
        ("on", "n_on"),
        ("off", "n_off"),
        ("first_us", "t_first"),
        ("last_us", "t_last"),
        ("backward_steps", "n_backward_steps"),
        ("sha256", "sha256_packed_t_i64_x_u16_y_u16_p_u8"),
    ] {
        assert_eq!(info[ours], expected["expected"][theirs], "{ours}");
    }
    assert_eq!(info["skipped"]["before_time"], expected["expected"]["cd_before_first_time_high"]);
    assert_eq!(info["truncated_bytes"], 0);
    assert_eq!(info["outside"], 0);
    info
}

#[test]
fn evt2_recording_matches_its_published_checksums() {
    let Some((bytes, expected)) = recording("faery_evt2", "evt2.raw") else { return };
    let info = check_info(&bytes, &expected);
    assert_eq!((&info["width"], &info["height"]), (&640.into(), &480.into()));
    assert_eq!(info["header_bytes"], expected["header_bytes"]);
    assert_eq!(info["triggers"], serde_json::json!([]));
}

#[test]
fn evt3_recording_matches_its_published_checksums_and_triggers() {
    let Some((bytes, expected)) = recording("rosec_codecs_evt3_trigger", "stream_as_evt3.raw") else { return };
    let info = check_info(&bytes, &expected);
    assert_eq!((&info["width"], &info["height"]), (&1280.into(), &720.into()));
    let triggers = serde_json::json!([
        { "t_us": 14_547_491, "channel": 0, "edge": 0 },
        { "t_us": 14_549_491, "channel": 0, "edge": 1 },
    ]);
    assert_eq!(info["triggers"], triggers);
    let words = &expected["expected"]["word_type_histogram"];
    let vendor: u64 = ["0x7", "0xe", "0xf"].iter().map(|kind| words[kind].as_u64().unwrap()).sum();
    assert_eq!(info["skipped"]["vendor_words"], vendor);
    assert_eq!(info["skipped"]["unknown_words"], 0);
}

#[test]
fn evt3_recording_is_decoded_as_by_the_evt3_crate() {
    let Some((bytes, _)) = recording("rosec_codecs_evt3_trigger", "stream_as_evt3.raw") else { return };
    let data = &bytes[Header::parse(&bytes).unwrap().len_bytes..];
    let (events, triggers) = decode(Format::Evt3, data);
    let (mut theirs, mut their_edges) = (Vec::new(), Vec::new());
    evt3::Evt3Decoder::new().decode_bytes(data, &mut theirs, &mut their_edges).unwrap();
    assert!(events.iter().copied().eq(theirs.iter().map(event_from_foreign)));
    let edge =
        |edge: &evt3::TriggerEvent| Trigger { t_us: edge.timestamp as i64, channel: edge.id, rising: edge.value == 1 };
    assert!(triggers.iter().copied().eq(their_edges.iter().map(edge)));
}

#[test]
fn recordings_survive_every_format() {
    for (folder, name) in [("faery_evt2", "evt2.raw"), ("rosec_codecs_evt3_trigger", "stream_as_evt3.raw")] {
        let Some((bytes, expected)) = recording(folder, name) else { return };
        let header = Header::parse(&bytes).unwrap();
        let (events, triggers) = decode(header.format, &bytes[header.len_bytes..]);
        for format in super::FORMATS {
            let mut data = Vec::new();
            Encoder::new(format).encode(&events, &triggers, &mut data).unwrap();
            let mut decoder = crate::events::Decoder::new(format);
            // EVT3 counts modulo 16.78 s, the EVT2 recording begins at 914 s.
            decoder.set_epoch_us(events[0].t_us);
            let (again, edges) = super::decode_pieces(&mut decoder, &data, &[1, 1_001, 50_003]);
            let mut digest = EventDigest::default();
            again.iter().for_each(|event| digest.add(event));
            assert_eq!(digest.finish(), expected["expected"]["sha256_packed_t_i64_x_u16_y_u16_p_u8"]);
            assert_eq!(edges, triggers);
        }
    }
}
