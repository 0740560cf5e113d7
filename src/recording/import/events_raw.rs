//! The RAW file of layout A: surveyed once, before anything is written, then copied packet by packet.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::PathBuf;

use sha2::{Digest as _, Sha256};

use super::error::{ImportError, Place};
use super::session_json::EventCamera;
use super::source::{Source, io_error};
use crate::events::{Decoder, Event, Format, Header, Sink, Trigger};
use crate::recording::EventPacket;

/// Bytes of a packet; a multiple of every word. Also enough for every header.
const PACKET_BYTES: usize = 1 << 16;

/// A RAW file that has been surveyed.
#[derive(Debug)]
pub(super) struct RawFile {
    path: PathBuf,
    name: String,
    /// The header as it is in the file.
    pub(super) header: Vec<u8>,
    format: Format,
    width: u32,
    height: u32,
    /// Sensor time at the start of each packet, microseconds.
    packet_times_us: Vec<i64>,
    /// Bytes behind the header.
    pub(super) event_bytes: u64,
    /// Rising edges on each channel.
    pub(super) rising_edges: BTreeMap<u8, usize>,
}

/// Reads a RAW file from start to end, holds it against what `session.json` declares, and notes what looks odd.
pub(super) fn survey(source: &mut Source, camera: &EventCamera) -> Result<RawFile, ImportError> {
    let (name, path) = (camera.raw.clone(), source.path(&camera.raw));
    let io = |why: std::io::Error| io_error(&name, &why);
    let mut file = File::open(&path).map_err(io)?;
    let mut start = Vec::new();
    read_piece(&mut file, &mut start).map_err(io)?;
    let header = Header::parse(&start).map_err(|why| Place::file(&name).wrong(format!("cannot be read: {why}")))?;
    check_size(&header, camera)?;
    start.truncate(header.len_bytes);
    let mut sha = Sha256::new();
    sha.update(&start);
    file.seek(SeekFrom::Start(header.len_bytes as u64)).map_err(io)?;
    let mut decoder = Decoder::new(header.format);
    let mut watch = Watch::new(camera);
    let (mut packet_times_us, mut event_bytes, mut piece) = (Vec::new(), 0, Vec::new());
    while read_piece(&mut file, &mut piece).map_err(io)? {
        sha.update(&piece);
        event_bytes += piece.len() as u64;
        let before_us = watch.start_packet();
        decoder.decode_into(&piece, &mut watch);
        packet_times_us.push(watch.first_us.or(before_us).unwrap_or(0));
    }
    source.set_sha256(&name, &sha.finalize());
    note_damage(source, &name, &decoder, &watch);
    Ok(RawFile {
        path,
        name,
        header: start,
        format: header.format,
        width: camera.width,
        height: camera.height,
        packet_times_us,
        event_bytes,
        rising_edges: watch.rising_edges,
    })
}

/// Reads up to a packet; false at the end of the file.
fn read_piece(file: &mut File, piece: &mut Vec<u8>) -> std::io::Result<bool> {
    piece.clear();
    file.take(PACKET_BYTES as u64).read_to_end(piece).map(|bytes| bytes > 0)
}

fn check_size(header: &Header, camera: &EventCamera) -> Result<(), ImportError> {
    let (Some(width), Some(height)) = (header.width, header.height) else { return Ok(()) };
    if (u32::from(width), u32::from(height)) == (camera.width, camera.height) {
        return Ok(());
    }
    let (declared, raw) = (format!("{}x{}", camera.width, camera.height), &camera.raw);
    let what = format!("is of a {width}x{height} sensor by its header, but session.json says {declared}; correct one");
    Err(Place::file(raw).wrong(what))
}

fn note_damage(source: &mut Source, name: &str, decoder: &Decoder, watch: &Watch) {
    let (cut, unknown) = (decoder.pending_bytes(), decoder.skipped().unknown_words);
    if cut > 0 {
        source.note(format!("{name} ends {cut} bytes into a word: its recording was cut off"));
    }
    if unknown > 0 {
        source.note(format!("{name} has {unknown} words that no {} camera sends: it is damaged", decoder.format()));
    }
    if watch.outside > 0 {
        let Watch { outside, width, height, .. } = watch;
        source.note(format!("{name} has {outside} events outside {width} x {height} pixels"));
    }
}

/// Watches the time, the triggers and the size while a file is decoded.
struct Watch {
    width: u32,
    height: u32,
    /// Time of the first event or trigger of the packet.
    first_us: Option<i64>,
    last_us: Option<i64>,
    outside: u64,
    rising_edges: BTreeMap<u8, usize>,
}

impl Watch {
    fn new(camera: &EventCamera) -> Self {
        let (width, height) = (camera.width, camera.height);
        Self { width, height, first_us: None, last_us: None, outside: 0, rising_edges: BTreeMap::new() }
    }

    /// Starts the next packet; returns the last time before it.
    fn start_packet(&mut self) -> Option<i64> {
        self.first_us = None;
        self.last_us
    }

    #[inline]
    fn at(&mut self, t_us: i64) {
        self.first_us = self.first_us.or(Some(t_us));
        self.last_us = Some(t_us);
    }
}

impl Sink for Watch {
    #[inline]
    fn event(&mut self, event: Event) {
        self.at(event.t_us);
        self.outside += u64::from(u32::from(event.x) >= self.width || u32::from(event.y) >= self.height);
    }

    fn trigger(&mut self, trigger: Trigger) {
        self.at(trigger.t_us);
        if trigger.rising {
            *self.rising_edges.entry(trigger.channel).or_default() += 1;
        }
    }
}

impl RawFile {
    /// Number of packets.
    pub(super) fn packets(&self) -> usize {
        self.packet_times_us.len()
    }

    /// Name of the format as in `EventPacket.encoding`.
    fn encoding(&self) -> &'static str {
        match self.format {
            Format::Evt21 { legacy_halves: true } => "evt21_legacy",
            Format::Evt2 | Format::Evt21 { .. } | Format::Evt3 => self.format.name(),
        }
    }

    /// Gives every packet in stream order; their bytes together are the file without its header.
    ///
    /// Nobody knows when a packet arrived, so its stamp is its sensor time since the first packet.
    pub(super) fn copy(
        &self,
        mut take: impl FnMut(&EventPacket) -> Result<(), ImportError>,
    ) -> Result<(), ImportError> {
        let io = |why: std::io::Error| io_error(&self.name, &why);
        let mut file = File::open(&self.path).map_err(io)?;
        file.seek(SeekFrom::Start(self.header.len() as u64)).map_err(io)?;
        let first_us = self.packet_times_us.first().copied().unwrap_or(0);
        let mut piece = Vec::new();
        let mut copied = 0;
        for (sequence, &time_us) in (0..).zip(&self.packet_times_us) {
            read_piece(&mut file, &mut piece).map_err(io)?;
            copied += piece.len() as u64;
            take(&EventPacket {
                stamp_ns: nanoseconds(time_us.saturating_sub(first_us)),
                height: self.height,
                width: self.width,
                sequence,
                time_base_ns: nanoseconds(time_us),
                encoding: self.encoding().into(),
                events: std::mem::take(&mut piece),
            })?;
        }
        if copied == self.event_bytes {
            return Ok(());
        }
        Err(Place::file(&self.name).wrong("changed while it was imported; import it when its recording has ended"))
    }
}

/// Microseconds as nanoseconds; a time before 0, which only damage makes, becomes 0.
fn nanoseconds(t_us: i64) -> u64 {
    u64::try_from(t_us).unwrap_or(0).saturating_mul(1000)
}
