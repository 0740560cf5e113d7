//! Files of the library, crafted and mutated: read or refused, never a panic.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::sync::OnceLock;

use proptest::prelude::*;

use super::*;

const MESSAGES: usize = 12;

/// A small file with everything that a file can have.
fn file(compression: Option<mcap::Compression>, chunked: bool) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let options = mcap::WriteOptions::new().compression(compression).chunk_size(Some(200)).use_chunks(chunked);
    let mut writer = options.library("somebody's recorder").create(&mut bytes).unwrap();
    let schema = writer.add_schema("pkg/msg/Thing", "ros2msg", b"int32 x").unwrap();
    let channel = writer.add_channel(schema, "/thing", "cdr", &BTreeMap::new()).unwrap();
    for i in 0..MESSAGES {
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence: i as u32,
            log_time: 1000 + i as u64,
            publish_time: 0,
        };
        writer.write_to_known_channel(&header, &[i as u8; 40]).unwrap();
    }
    let data = b"some text".as_slice().into();
    let (name, media_type) = ("notes.txt".to_owned(), "text/plain".to_owned());
    writer.attach(&mcap::Attachment { log_time: 1, create_time: 2, name, media_type, data }).unwrap();
    let metadata = BTreeMap::from([("a".to_owned(), "1".to_owned()), ("b".to_owned(), "2".to_owned())]);
    writer.write_metadata(&mcap::records::Metadata { name: "facts".into(), metadata }).unwrap();
    writer.finish().unwrap();
    drop(writer);
    bytes.into_inner()
}

fn files() -> &'static [Vec<u8>] {
    static FILES: OnceLock<Vec<Vec<u8>>> = OnceLock::new();
    let some =
        [(None, true), (None, false), (Some(mcap::Compression::Lz4), true), (Some(mcap::Compression::Zstd), true)];
    FILES.get_or_init(|| some.map(|(compression, chunked)| file(compression, chunked)).into())
}

#[test]
fn whole_files_are_read_whole() {
    for bytes in files() {
        let read = scan(bytes);
        assert_eq!(read.damage, Vec::<String>::new());
        assert_eq!(read.library, "somebody's recorder");
        assert_eq!(read.messages.len(), MESSAGES);
        for (i, message) in read.messages.iter().enumerate() {
            let Channel { topic, schema, encoding } = &*message.channel;
            assert_eq!((topic.as_str(), schema.as_str(), encoding.as_str()), ("/thing", "pkg/msg/Thing", "cdr"));
            assert_eq!((message.log_time, &message.data), (1000 + i as u64, &vec![i as u8; 40]));
        }
        assert_eq!(read.attachments, [("notes.txt".to_owned(), b"some text".to_vec())]);
        assert_eq!(read.metadata["facts"]["b"], "2");
    }
}

/// The library's parser panics on this one: it looks for the checksum behind a header that ends the record.
#[test]
fn an_attachment_without_its_checksum_ends_the_reading() {
    let whole = file(None, false);
    let attachment = |data_bytes: u64, behind: &[u8]| {
        let texts = [&4_u32.to_le_bytes()[..], b"name", &0_u32.to_le_bytes()].concat();
        let body = [&[0; 16][..], &texts, &data_bytes.to_le_bytes(), behind].concat();
        [&[op::ATTACHMENT][..], &(body.len() as u64).to_le_bytes(), &body].concat()
    };
    for (record, read_on) in [
        (attachment(0, b""), false),
        (attachment(0, b"123"), false),
        (attachment(2, b"ab123"), false),
        (attachment(u64::MAX, b"ab1234"), false),
        (attachment(u64::MAX - 3, b"ab1234"), false),
        // A wrong checksum, and none.
        (attachment(2, b"ab1234"), false),
        (attachment(2, b"ab\0\0\0\0"), true),
    ] {
        // Behind the header of the file.
        let header = 8 + 9 + u64::from_le_bytes(whole[9..17].try_into().unwrap()) as usize;
        let bytes = [&whole[..header], &record, &whole[header..]].concat();
        let read = scan(&bytes);
        assert_eq!(read.damage.is_empty(), read_on, "{:?}", read.damage);
        assert_eq!(read.messages.len(), if read_on { MESSAGES } else { 0 });
    }
}

#[test]
fn a_file_that_is_cut_anywhere_keeps_what_is_whole() {
    for bytes in [file(None, true), file(None, false)] {
        // Behind the head of the end of the data lie only its checksum and indexes: no loss.
        let end = bytes.len() - bytes.windows(9).rev().position(|w| w == [15, 4, 0, 0, 0, 0, 0, 0, 0]).unwrap() - 9;
        let mut kept = 0;
        for cut in 0..bytes.len() {
            let read = scan(&bytes[..cut]);
            assert_eq!(read.damage.is_empty(), cut >= end + 9, "{cut} of {end}: {:?}", read.damage);
            assert!(read.messages.len() >= kept, "{cut}: {} after {kept}", read.messages.len());
            kept = read.messages.len();
        }
        assert_eq!(kept, MESSAGES);
    }
}

#[test]
fn a_long_black_image_is_not_damage() {
    // 40 MB that zstd makes some kilobytes of.
    let black = vec![0; 40 << 20];
    let mut bytes = Cursor::new(Vec::new());
    let options = mcap::WriteOptions::new().compression(Some(mcap::Compression::Zstd));
    let mut writer = options.create(&mut bytes).unwrap();
    let channel = writer.add_channel(0, "/image", "cdr", &BTreeMap::new()).unwrap();
    let header = mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time: 1, publish_time: 1 };
    writer.write_to_known_channel(&header, &black).unwrap();
    writer.finish().unwrap();
    drop(writer);
    let bytes = bytes.into_inner();
    assert!(bytes.len() < 100_000);
    let read = scan(&bytes);
    assert!(read.damage.is_empty() && read.messages[0].data == black, "{:?}", read.damage);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_bytes_make_the_scan_panic(
        which in 0..4_usize,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12),
        cut in any::<prop::sample::Index>(),
        cuts in any::<bool>(),
    ) {
        let mut bytes = files()[which].clone();
        for (at, byte) in changes {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if cuts {
            bytes.truncate(cut.index(bytes.len()));
        }
        let read = scan(&bytes);
        // What was lost is said, unless it is in a part that nothing is read from.
        prop_assert!(read.messages.len() <= MESSAGES);
    }

    #[test]
    fn no_body_makes_the_parser_panic(opcode in 1..16_u8, body in prop::collection::vec(any::<u8>(), 0..80)) {
        let record = [&[opcode][..], &(body.len() as u64).to_le_bytes(), &body].concat();
        scan(&[mcap::MAGIC, &record].concat());
        // Small lengths let the parser go farther.
        let small: Vec<u8> = body.iter().enumerate().map(|(i, b)| if i % 4 == 0 { b % 16 } else { 0 }).collect();
        let record = [&[opcode][..], &(small.len() as u64).to_le_bytes(), &small].concat();
        scan(&[mcap::MAGIC, &record].concat());
    }
}
