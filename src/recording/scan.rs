//! Reads whatever an MCAP file still holds: whole, cut, or damaged in the middle.
//!
//! Records are taken apart here, not by the library: no bytes make it panic or ask for memory that the file cannot
//! fill. Of the library only the decompression of a chunk is used.

mod records;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::io::Read;
use std::ops::ControlFlow;
use std::sync::Arc;

use mcap::records::op;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

use records::{Chunk, Record, cut_data, parse, whole_records};

/// What the messages of a topic are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    /// The topic.
    pub topic: String,
    /// Name of the schema; empty where there is none.
    pub schema: String,
    /// How the messages are encoded: `cdr`, `protobuf`, `json`, ...
    pub encoding: String,
}

/// One message, decompressed.
#[derive(Debug, Clone)]
pub struct Message {
    /// Its topic and what it is.
    pub channel: Arc<Channel>,
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

/// One thing that an MCAP file holds.
#[derive(Debug, Clone)]
pub enum Found {
    /// Its beginning, with the library that wrote it.
    Library(String),
    /// A message.
    Message(Message),
    /// An attachment: name and bytes.
    Attachment(String, Vec<u8>),
    /// A metadata record: name and entries.
    Metadata(String, BTreeMap<String, String>),
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
    let mut rest = bytes;
    scan.damage = walk(&mut rest, bytes.len() as u64, &mut |found| {
        match found {
            Found::Library(library) => scan.library = library,
            Found::Message(message) => scan.messages.push(message),
            Found::Attachment(name, data) => scan.attachments.push((name, data)),
            Found::Metadata(name, entries) => {
                scan.metadata.insert(name, entries);
            }
        }
        ControlFlow::Continue(())
    });
    scan
}

/// Reads a file of `length` bytes from start to end, holding no more than one record or chunk; says what was lost.
///
/// Ends early, without damage, where `take` breaks.
pub fn walk(from: &mut dyn Read, length: u64, take: &mut dyn FnMut(Found) -> ControlFlow<()>) -> Vec<String> {
    let mut walk = Walk { left: length, schemas: BTreeMap::new(), channels: BTreeMap::new(), damage: Vec::new(), take };
    match walk.file(from) {
        Ok(()) | Err(Stop::Asked) => {}
        Err(Stop::Broken(why)) => walk.damage.push(why),
    }
    walk.damage
}

/// Why nothing more is read.
enum Stop {
    /// Whoever takes what is found has enough.
    Asked,
    /// The file ends or makes no sense here.
    Broken(String),
}

/// How far a file has been read.
struct Walk<'a> {
    /// Bytes that follow.
    left: u64,
    /// Names of schemas by id.
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, Arc<Channel>>,
    damage: Vec<String>,
    take: &'a mut dyn FnMut(Found) -> ControlFlow<()>,
}

impl Walk<'_> {
    fn file(&mut self, from: &mut dyn Read) -> Result<(), Stop> {
        if self.bytes(from, mcap::MAGIC.len() as u64)? != mcap::MAGIC {
            return Err(Stop::Broken("not readable from the start: it does not begin as an MCAP file".into()));
        }
        loop {
            let head = self.bytes(from, 9)?;
            let length = head[1..].iter().rev().fold(0, |sum, b| sum << 8 | u64::from(*b));
            let opcode = head[0];
            match opcode {
                // What power loss leaves behind.
                0 => return Err(Stop::Broken("the end of the data is missing".into())),
                // Behind it lie only indexes.
                op::DATA_END => return Ok(()),
                op::CHUNK if length > self.left => {
                    let rest = self.bytes(from, self.left)?;
                    return Err(self.cut_chunk(&rest));
                }
                _ => {
                    let body = self.bytes(from, length)?;
                    self.record(opcode, &body)?;
                }
            }
        }
    }

    /// The next bytes of the file; broken where it has fewer.
    fn bytes(&mut self, from: &mut dyn Read, count: u64) -> Result<Vec<u8>, Stop> {
        if count > self.left {
            return Err(Stop::Broken("broken off: the file ends inside a record".into()));
        }
        let mut bytes = Vec::new();
        let read =
            from.take(count).read_to_end(&mut bytes).map_err(|why| Stop::Broken(format!("unreadable: {why}")))?;
        self.left -= count;
        // Shorter than its own length: it is being changed.
        if read as u64 == count { Ok(bytes) } else { Err(Stop::Broken("broken off: the file shrank".into())) }
    }

    /// A record of the file itself; one that makes no sense ends the reading.
    fn record(&mut self, opcode: u8, body: &[u8]) -> Result<(), Stop> {
        match parse(opcode, body) {
            None => Err(Stop::Broken(format!("broken off: a record of kind {opcode} is not what it should be"))),
            Some(Record::Chunk(chunk)) => self.chunk(&chunk),
            Some(record) => self.take(record),
        }
    }

    fn chunk(&mut self, chunk: &Chunk<'_>) -> Result<(), Stop> {
        let error = match decompressed(chunk) {
            Ok(records) => {
                let mut parsed = records.iter().filter_map(|(opcode, body)| parse(*opcode, body));
                return parsed.try_for_each(|record| self.take(record));
            }
            Err(error) => error,
        };
        let from_s = chunk.start_ns as f64 * 1e-9;
        // Power loss leaves zeros behind what was written; before them an uncompressed chunk is as it was.
        let zero_tail = chunk.compression.is_empty() && chunk.data.ends_with(&[0; 64]);
        let written = chunk.data.iter().rposition(|b| *b != 0).map_or(0, |last| last + 1);
        let whole = if zero_tail { whole_records(&chunk.data[..written]) } else { Vec::new() };
        let but = if whole.is_empty() { String::new() } else { format!(" but for {} records", whole.len()) };
        self.damage.push(format!("the chunk at {from_s:.3} s is lost{but}: {error}"));
        whole.into_iter().try_for_each(|record| self.take(record))
    }

    /// The last chunk of a file that was cut off inside it: an uncompressed one still holds whole records.
    fn cut_chunk(&mut self, body: &[u8]) -> Stop {
        let whole = cut_data(body).map(whole_records).unwrap_or_default();
        let said = format!("broken off in a chunk, of which {} records are whole", whole.len());
        match whole.into_iter().try_for_each(|record| self.take(record)) {
            Ok(()) => Stop::Broken(said),
            Err(stop) => stop,
        }
    }

    fn take(&mut self, record: Record<'_>) -> Result<(), Stop> {
        let found = match record {
            Record::Header { library } => Found::Library(library),
            Record::Schema { id, name } => {
                self.schemas.insert(id, name);
                return Ok(());
            }
            Record::Channel { id, schema, topic, encoding } => {
                let schema = self.schemas.get(&schema).cloned().unwrap_or_default();
                self.channels.insert(id, Arc::new(Channel { topic, schema, encoding }));
                return Ok(());
            }
            Record::Message { channel, log_time, data } => {
                let Some(channel) = self.channels.get(&channel) else { return Ok(()) };
                Found::Message(Message { channel: Arc::clone(channel), log_time, data: data.to_vec() })
            }
            Record::Attachment { name, data } => Found::Attachment(name, data.to_vec()),
            Record::Metadata { name, entries } => Found::Metadata(name, entries),
            // A chunk has no chunks in it.
            Record::Chunk(_) | Record::Other => return Ok(()),
        };
        match (self.take)(found) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(Stop::Asked),
        }
    }
}

/// Decompresses a chunk into its records, kind and body; nothing is believed before its checksum is right.
///
/// The library's own reader of chunks believes the lengths inside before it knows the checksum, and asks for
/// memory accordingly.
fn decompressed(chunk: &Chunk<'_>) -> mcap::McapResult<Vec<(u8, Vec<u8>)>> {
    // What lz4 can make of these bytes at the most; zstd makes far more of an image that is all black.
    let limit = chunk.data.len().saturating_mul(256).clamp(1 << 28, 1 << 30);
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(limit);
    let mut reader = LinearReader::new_with_options(options);
    let mut whole = vec![op::CHUNK];
    whole.extend((chunk.body.len() as u64).to_le_bytes());
    whole.extend(chunk.body);
    let (mut rest, mut records) = (whole.as_slice(), Vec::new());
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(need) => {
                let (now, later) = rest.split_at(need.min(rest.len()));
                reader.insert(now.len()).copy_from_slice(now);
                reader.notify_read(now.len());
                rest = later;
            }
            LinearReadEvent::Record { data, opcode } => records.push((opcode, data.to_vec())),
        }
    }
    Ok(records)
}
