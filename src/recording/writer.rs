//! Writes a session as it happens: what was captured survives a crash.
//!
//! The file is called `.partial` until it is complete; everything is on the disk at each [`Writer::sync`].

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use foxglove::Encode as _;
use foxglove::messages::{CompressedImage, Timestamp};
use mcap::records::MessageHeader;

use super::cdr::{EVENT_PACKET_SCHEMA, EventPacket};
use super::setup::{About, Attachment};
use super::{RecordingError, reader::topics};
use crate::session::{Command, Input, Stamp};

/// A recording that is being written.
pub struct Writer {
    mcap: mcap::Writer<BufWriter<File>>,
    file: File,
    partial: PathBuf,
    path: PathBuf,
    channels: Channels,
    sequence: u32,
}

#[derive(Clone, Copy)]
struct Channels {
    inputs: u16,
    commands: u16,
    images: u16,
    events: u16,
}

impl Writer {
    /// Starts the recording `path`; refuses to overwrite one.
    pub fn create(path: &Path, about: &About, attachments: &[Attachment]) -> Result<Self, RecordingError> {
        let partial = path.with_extension("mcap.partial");
        let io = |why| RecordingError::Io { path: partial.clone(), why };
        if path.exists() {
            let why = std::io::Error::new(
                std::io::ErrorKind::AlreadyExists,
                "exists already; choose another name (import: or --force)",
            );
            return Err(RecordingError::Io { path: path.into(), why });
        }
        if let Some(folder) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
            fs::create_dir_all(folder).map_err(io)?;
        }
        // Never over the remains of another session.
        let file = File::create_new(&partial).map_err(io)?;
        let buffered = BufWriter::new(file.try_clone().map_err(io)?);
        let of_mcap = |why| super::of_mcap(&partial, why);
        let options = mcap::WriteOptions::new()
            .compression(Some(mcap::Compression::Lz4))
            .chunk_size(Some(1 << 20))
            .library(format!("cellcal {}", env!("CARGO_PKG_VERSION")));
        let mut mcap = options.create(buffered).map_err(of_mcap)?;
        let channels = add_channels(&mut mcap).map_err(of_mcap)?;
        let (name, metadata) = about.to_metadata();
        mcap.write_metadata(&mcap::records::Metadata { name, metadata }).map_err(of_mcap)?;
        for Attachment { name, data } in attachments {
            let (name, media_type) = (name.clone(), "text/plain".to_owned());
            let attachment = mcap::Attachment { log_time: 0, create_time: 0, name, media_type, data: data.into() };
            mcap.attach(&attachment).map_err(of_mcap)?;
        }
        let mut writer = Self { mcap, file, partial, path: path.into(), channels, sequence: 0 };
        writer.sync()?;
        Ok(writer)
    }

    /// Logs an input.
    pub fn input(&mut self, at: Stamp, input: &Input) -> Result<(), RecordingError> {
        self.json(self.channels.inputs, at, &serde_json::to_vec(input))
    }

    /// Logs a command, before it is carried out.
    pub fn command(&mut self, at: Stamp, command: &Command) -> Result<(), RecordingError> {
        self.json(self.channels.commands, at, &serde_json::to_vec(command))
    }

    /// Logs the image of an exposure that began at `at`, as a losslessly encoded file.
    pub fn image(&mut self, at: Stamp, encoded: &[u8], format: &str) -> Result<(), RecordingError> {
        let message = CompressedImage {
            timestamp: Some(Timestamp::new((at.0 / 1_000_000_000) as u32, (at.0 % 1_000_000_000) as u32)),
            frame_id: "rgb".into(),
            data: encoded.to_vec().into(),
            format: format.into(),
        };
        let mut bytes = Vec::new();
        if let Err(error) = message.encode(&mut bytes) {
            return Err(self.broken(error.to_string()));
        }
        self.message(self.channels.images, at, &bytes)
    }

    /// Logs raw words of the event camera.
    pub fn events(&mut self, at: Stamp, packet: &EventPacket) -> Result<(), RecordingError> {
        self.message(self.channels.events, at, &packet.to_cdr())
    }

    /// Puts everything logged so far on the disk.
    pub fn sync(&mut self) -> Result<(), RecordingError> {
        self.mcap.flush().map_err(|why| super::of_mcap(&self.partial, why))?;
        self.file.sync_data().map_err(|why| RecordingError::Io { path: self.partial.clone(), why })
    }

    /// Where the recording is until it is complete.
    pub fn partial(&self) -> PathBuf {
        self.partial.clone()
    }

    /// Closes the file, syncs it and gives it its final name.
    pub fn finish(mut self) -> Result<PathBuf, RecordingError> {
        self.mcap.finish().map_err(|why| super::of_mcap(&self.partial, why))?;
        let io = |why| RecordingError::Io { path: self.path.clone(), why };
        self.file.sync_all().map_err(io)?;
        fs::rename(&self.partial, &self.path).map_err(io)?;
        if let Some(folder) = self.path.parent().filter(|p| !p.as_os_str().is_empty()) {
            File::open(folder).and_then(|f| f.sync_all()).map_err(io)?;
        }
        Ok(self.path)
    }

    fn json(&mut self, channel: u16, at: Stamp, json: &serde_json::Result<Vec<u8>>) -> Result<(), RecordingError> {
        match json {
            Ok(bytes) => self.message(channel, at, bytes),
            Err(error) => Err(self.broken(error.to_string())),
        }
    }

    fn message(&mut self, channel_id: u16, at: Stamp, bytes: &[u8]) -> Result<(), RecordingError> {
        self.sequence = self.sequence.wrapping_add(1);
        let header = MessageHeader { channel_id, sequence: self.sequence, log_time: at.0, publish_time: at.0 };
        self.mcap.write_to_known_channel(&header, bytes).map_err(|why| super::of_mcap(&self.partial, why))
    }

    fn broken(&self, what: String) -> RecordingError {
        RecordingError::Broken { path: self.partial.clone(), what }
    }
}

fn add_channels(mcap: &mut mcap::Writer<BufWriter<File>>) -> Result<Channels, mcap::McapError> {
    let none = BTreeMap::new();
    let json = |name: &str| format!("{{\"title\":\"{name}\",\"type\":\"object\"}}");
    let input = mcap.add_schema("cellcal.Input", "jsonschema", json("cellcal.Input").as_bytes())?;
    let command = mcap.add_schema("cellcal.Command", "jsonschema", json("cellcal.Command").as_bytes())?;
    let image = CompressedImage::get_schema().map(|s| s.data.into_owned()).unwrap_or_default();
    let image = mcap.add_schema("foxglove.CompressedImage", "protobuf", &image)?;
    let packet = mcap.add_schema("event_camera_msgs/msg/EventPacket", "ros2msg", EVENT_PACKET_SCHEMA.as_bytes())?;
    Ok(Channels {
        inputs: mcap.add_channel(input, topics::INPUTS, "json", &none)?,
        commands: mcap.add_channel(command, topics::COMMANDS, "json", &none)?,
        images: mcap.add_channel(image, topics::IMAGES, "protobuf", &none)?,
        events: mcap.add_channel(packet, topics::EVENTS, "cdr", &none)?,
    })
}
