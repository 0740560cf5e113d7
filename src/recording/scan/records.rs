//! The records of an MCAP file, taken apart: nothing is believed that the bytes do not hold.
//!
//! The library's own parser asks for memory by lengths that it has not compared with the bytes, and takes the checksum
//! of an attachment from behind its header without looking whether it is there.

use std::collections::BTreeMap;

use mcap::records::op;

/// A record, as far as anything here needs it.
#[derive(Debug)]
pub(super) enum Record<'a> {
    /// The beginning of a file.
    Header {
        /// The library that wrote it.
        library: String,
    },
    /// What messages look like.
    Schema {
        /// Its number.
        id: u16,
        /// Its name.
        name: String,
    },
    /// A topic.
    Channel {
        /// Its number.
        id: u16,
        /// The schema of its messages.
        schema: u16,
        /// The topic.
        topic: String,
        /// How its messages are encoded.
        encoding: String,
    },
    /// A message.
    Message {
        /// Its channel.
        channel: u16,
        /// Time of logging, nanoseconds.
        log_time: u64,
        /// Its bytes.
        data: &'a [u8],
    },
    /// Records that were compressed together.
    Chunk(Chunk<'a>),
    /// A file.
    Attachment {
        /// Its name.
        name: String,
        /// Its bytes.
        data: &'a [u8],
    },
    /// Names and values.
    Metadata {
        /// Their name.
        name: String,
        /// The values by name.
        entries: BTreeMap<String, String>,
    },
    /// Anything else: indexes, statistics, extensions.
    Other,
}

/// Records that were compressed together.
#[derive(Debug)]
pub(super) struct Chunk<'a> {
    /// Time of its first message, nanoseconds.
    pub(super) start_ns: u64,
    /// Name of the compression; empty for none.
    pub(super) compression: &'a [u8],
    /// The compressed records.
    pub(super) data: &'a [u8],
    /// Everything up to the end of the data, as it stands in the file.
    pub(super) body: &'a [u8],
}

/// Takes the body of a record apart; `None` where it is shorter than it says or holds no text where text must be.
pub(super) fn parse(opcode: u8, body: &[u8]) -> Option<Record<'_>> {
    let mut fields = Fields { rest: body };
    Some(match opcode {
        op::HEADER => {
            fields.text()?;
            Record::Header { library: fields.text()? }
        }
        op::SCHEMA => Record::Schema { id: fields.u16()?, name: fields.text()? },
        op::CHANNEL => {
            let (id, schema) = (fields.u16()?, fields.u16()?);
            Record::Channel { id, schema, topic: fields.text()?, encoding: fields.text()? }
        }
        op::MESSAGE => {
            let (channel, _sequence, log_time) = (fields.u16()?, fields.u32()?, fields.u64()?);
            let _published = fields.u64()?;
            Record::Message { channel, log_time, data: fields.rest }
        }
        op::CHUNK => Record::Chunk(chunk(body, fields)?),
        op::ATTACHMENT => attachment(body, fields)?,
        op::METADATA => {
            let name = fields.text()?;
            let length = fields.u32()? as usize;
            let mut inner = Fields { rest: fields.take(length)? };
            let mut entries = BTreeMap::new();
            while !inner.rest.is_empty() {
                entries.insert(inner.text()?, inner.text()?);
            }
            Record::Metadata { name, entries }
        }
        _ => Record::Other,
    })
}

fn chunk<'a>(body: &'a [u8], mut fields: Fields<'a>) -> Option<Chunk<'a>> {
    let start_ns = fields.u64()?;
    let (_end_ns, _uncompressed_bytes, _checksum) = (fields.u64()?, fields.u64()?, fields.u32()?);
    let length = fields.u32()? as usize;
    let compression = fields.take(length)?;
    let length = usize::try_from(fields.u64()?).ok()?;
    let data = fields.take(length)?;
    // Bytes may follow that mean nothing.
    let body = &body[..body.len() - fields.rest.len()];
    Some(Chunk { start_ns, compression, data, body })
}

fn attachment<'a>(body: &'a [u8], mut fields: Fields<'a>) -> Option<Record<'a>> {
    let (_logged, _made) = (fields.u64()?, fields.u64()?);
    let (name, _media_type) = (fields.text()?, fields.text()?);
    let length = usize::try_from(fields.u64()?).ok()?;
    let data = fields.take(length)?;
    let summed = &body[..body.len() - fields.rest.len()];
    let checksum = fields.u32()?;
    (checksum == 0 || checksum == crc32(summed)).then_some(Record::Attachment { name, data })
}

/// The checksum of ISO 3309, as in PNG and zip.
fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32, _| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 };
    !bytes.iter().fold(u32::MAX, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), step))
}

/// The beginning of an uncompressed chunk that is cut off: its data, as far as they go; `None` where it is compressed.
pub(super) fn cut_data(body: &[u8]) -> Option<&[u8]> {
    let mut fields = Fields { rest: body };
    fields.take(28)?;
    let compression = fields.u32()?;
    fields.u64()?;
    (compression == 0).then_some(fields.rest)
}

/// The records at the start of the data of an uncompressed chunk, as long as they are whole.
pub(super) fn whole_records(data: &[u8]) -> Vec<Record<'_>> {
    let mut fields = Fields { rest: data };
    let mut next = || {
        let (opcode, length) = (fields.take(1)?[0], usize::try_from(fields.u64()?).ok()?);
        let body = fields.take(length)?;
        // Schemas, channels and messages: the only records of a chunk.
        if (op::SCHEMA..=op::MESSAGE).contains(&opcode) { parse(opcode, body) } else { None }
    };
    std::iter::from_fn(&mut next).collect()
}

/// Little-endian fields of a record.
struct Fields<'a> {
    rest: &'a [u8],
}

impl<'a> Fields<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.rest.split_at_checked(count)?;
        self.rest = rest;
        Some(taken)
    }

    fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    fn u16(&mut self) -> Option<u16> {
        self.number().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.number().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.number().map(u64::from_le_bytes)
    }

    fn text(&mut self) -> Option<String> {
        let length = self.u32()? as usize;
        String::from_utf8(self.take(length)?.to_vec()).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_the_one_of_the_standard() {
        assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
    }
}
