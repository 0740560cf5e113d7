//! Reads whatever an MCAP file still holds: whole, cut, or damaged in the middle.

use std::collections::BTreeMap;
use std::sync::Arc;

use mcap::records::Record;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

/// One message, decompressed.
#[derive(Debug, Clone)]
pub struct Message {
    /// Its topic.
    pub topic: Arc<str>,
    /// Time of logging, nanoseconds.
    pub log_time: u64,
    /// Its bytes.
    pub data: Vec<u8>,
}

/// What an MCAP file holds.
#[derive(Debug, Clone, Default)]
pub struct Scan {
    /// The library that wrote it.
    pub library: String,
    /// Messages in order of the file.
    pub messages: Vec<Message>,
    /// Attachments: name and bytes, in order of the file.
    pub attachments: Vec<(String, Vec<u8>)>,
    /// Metadata records by name.
    pub metadata: BTreeMap<String, BTreeMap<String, String>>,
    /// What was lost, in words; empty for a whole file.
    pub damage: Vec<String>,
}

/// Whether the bytes begin as an MCAP file does.
pub fn is_mcap(bytes: &[u8]) -> bool {
    bytes.starts_with(mcap::MAGIC)
}

/// Scans a file from start to end; never fails, says what was lost.
///
/// A damaged chunk loses that chunk only; past the first broken record nothing is read.
pub fn scan(bytes: &[u8]) -> Scan {
    let mut scan = Scan::default();
    let mut topics = BTreeMap::new();
    let mut ended = false;
    let options = mcap::read::Options::IgnoreEndMagic;
    let reader = match mcap::read::LinearReader::new_with_options(bytes, options.into()) {
        Ok(reader) => reader,
        Err(error) => {
            scan.damage.push(format!("not readable from the start: {error}"));
            return scan;
        }
    };
    for record in reader {
        match record {
            Ok(Record::Chunk { header, data }) => scan.chunk(&header, &data, &mut topics),
            Ok(Record::DataEnd(_)) => ended = true,
            Ok(Record::Unknown { opcode: 0, .. }) => break,
            Ok(record) => scan.take(record, &mut topics),
            Err(error) => {
                if !ended {
                    scan.damage.push(format!("broken off: {error}"));
                }
                break;
            }
        }
    }
    if !ended && scan.damage.is_empty() {
        scan.damage.push("the end of the data is missing".into());
    }
    scan
}

/// Decompresses a chunk and takes it apart; nothing is believed before its checksum is right.
///
/// The library's own reader of chunks believes the lengths inside before it knows the checksum, and asks for
/// memory accordingly.
fn records_of(header: &mcap::records::ChunkHeader, data: &[u8]) -> mcap::McapResult<Vec<Record<'static>>> {
    // What lz4 can make of these bytes at the most.
    let limit = data.len().saturating_mul(256).clamp(1 << 20, 1 << 30);
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(limit);
    let mut reader = LinearReader::new_with_options(options);
    let whole = as_record(header, data);
    let (mut rest, mut records) = (whole.as_slice(), Vec::new());
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(need) => {
                let (now, later) = rest.split_at(need.min(rest.len()));
                reader.insert(now.len()).copy_from_slice(now);
                reader.notify_read(now.len());
                rest = later;
            }
            LinearReadEvent::Record { data, opcode } => records.push(mcap::parse_record(opcode, data)?.into_owned()),
        }
    }
    Ok(records)
}

/// The chunk as it stands in a file.
fn as_record(header: &mcap::records::ChunkHeader, data: &[u8]) -> Vec<u8> {
    let name = header.compression.as_bytes();
    let mut body = Vec::with_capacity(data.len() + name.len() + 64);
    body.extend(header.message_start_time.to_le_bytes());
    body.extend(header.message_end_time.to_le_bytes());
    body.extend(header.uncompressed_size.to_le_bytes());
    body.extend(header.uncompressed_crc.to_le_bytes());
    body.extend((name.len() as u32).to_le_bytes());
    body.extend(name);
    body.extend((data.len() as u64).to_le_bytes());
    body.extend(data);
    let mut record = vec![mcap::records::op::CHUNK];
    record.extend((body.len() as u64).to_le_bytes());
    record.append(&mut body);
    record
}

impl Scan {
    fn chunk(&mut self, header: &mcap::records::ChunkHeader, data: &[u8], topics: &mut BTreeMap<u16, Arc<str>>) {
        let from_s = header.message_start_time as f64 * 1e-9;
        // Power loss leaves zeros behind what was written; before them an uncompressed chunk is as it was.
        let zero_tail = header.compression.is_empty() && data.ends_with(&[0; 64]);
        match records_of(header, data) {
            Ok(records) => records.into_iter().for_each(|record| self.take(record, topics)),
            Err(error) => {
                let kept = if zero_tail { self.before_zeros(data, topics) } else { 0 };
                let but = if kept > 0 { format!(" but for {kept} records") } else { String::new() };
                self.damage.push(format!("the chunk at {from_s:.3} s is lost{but}: {error}"));
            }
        }
    }

    /// Takes the whole records of an uncompressed chunk up to the zeros at its end; returns how many.
    fn before_zeros(&mut self, mut data: &[u8], topics: &mut BTreeMap<u16, Arc<str>>) -> usize {
        let written = data.iter().rposition(|b| *b != 0).map_or(0, |last| last + 1);
        data = &data[..written];
        let mut kept = 0;
        while let Some((head, rest)) = data.split_at_checked(9) {
            let length = head[1..].iter().rev().fold(0_u64, |sum, b| sum << 8 | u64::from(*b));
            let Some((body, after)) = usize::try_from(length).ok().and_then(|n| rest.split_at_checked(n)) else {
                break;
            };
            // Schemas, channels and messages: the only records of a chunk.
            if !(3..=5).contains(&head[0]) {
                break;
            }
            let Ok(record) = mcap::parse_record(head[0], body) else { break };
            self.take(record, topics);
            (data, kept) = (after, kept + 1);
        }
        kept
    }

    fn take(&mut self, record: Record<'_>, topics: &mut BTreeMap<u16, Arc<str>>) {
        match record {
            Record::Header(header) => self.library = header.library,
            Record::Channel(channel) => {
                topics.insert(channel.id, channel.topic.into());
            }
            Record::Message { header, data } => {
                if let Some(topic) = topics.get(&header.channel_id) {
                    let message =
                        Message { topic: Arc::clone(topic), log_time: header.log_time, data: data.into_owned() };
                    self.messages.push(message);
                }
            }
            Record::Attachment { header, data, .. } => self.attachments.push((header.name, data.into_owned())),
            Record::Metadata(metadata) => {
                self.metadata.insert(metadata.name, metadata.metadata);
            }
            // Schemas, indexes and statistics carry nothing that a session needs.
            _ => {}
        }
    }
}
