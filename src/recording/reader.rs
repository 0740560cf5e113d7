//! Reads a session back, in the order in which it happened.

use std::fs;
use std::path::{Path, PathBuf};

use foxglove::Decode as _;
use foxglove::messages::CompressedImage;

use super::RecordingError;
use super::cdr::EventPacket;
use super::scan::{self, Scan};
use super::setup::{About, FORMAT_VERSION, ImportSetup, Kind};
use crate::session::{Command, Input, Stamp};

/// Topics of a session.
pub(super) mod topics {
    pub(in super::super) const INPUTS: &str = "/session/inputs";
    pub(in super::super) const COMMANDS: &str = "/session/commands";
    pub(in super::super) const IMAGES: &str = "/camera/rgb/image/compressed";
    pub(in super::super) const EVENTS: &str = "/event_camera/events";
}

/// One thing that was logged.
#[derive(Debug, Clone)]
pub enum Entry {
    /// Something that happened.
    Input(Stamp, Input),
    /// Something that was asked.
    Command(Command),
    /// An encoded image of the frame camera, stamped with the start of its exposure.
    Image(Stamp, Vec<u8>),
    /// Raw words of the event camera.
    Events(EventPacket),
}

/// A session, read back.
#[derive(Debug, Clone)]
pub struct Recording {
    /// Where it was read from.
    pub path: PathBuf,
    /// What it says about itself.
    pub about: About,
    /// Everything in order.
    pub entries: Vec<Entry>,
    /// What was lost, in words; empty for a whole file.
    pub damage: Vec<String>,
    attachments: Vec<(String, Vec<u8>)>,
}

impl Recording {
    /// Reads a session; a damaged one as far as it goes, with the damage named.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let bytes = fs::read(path).map_err(|why| RecordingError::Io { path: path.into(), why })?;
        Self::from_bytes(path, &bytes)
    }

    /// Reads a session from the bytes of its file.
    pub fn from_bytes(path: &Path, bytes: &[u8]) -> Result<Self, RecordingError> {
        if !scan::is_mcap(bytes) {
            let start: String = String::from_utf8_lossy(&bytes[..bytes.len().min(12)]).escape_debug().collect();
            let found = if bytes.is_empty() { "nothing (the file is empty)".into() } else { format!("\"{start}\"") };
            return Err(RecordingError::NotMcap { path: path.into(), found });
        }
        let Scan { library, messages, attachments, metadata, damage } = scan::scan(bytes);
        let Some(about) = About::from_metadata(&metadata) else {
            if library.starts_with("cellcal") {
                let what = format!("cut before its description ({}); nothing can be recovered", damage.join("; "));
                return Err(RecordingError::Broken { path: path.into(), what });
            }
            return Err(RecordingError::Foreign { path: path.into(), library, messages: messages.len() });
        };
        if about.format_version > FORMAT_VERSION {
            let (found, known) = (about.format_version, FORMAT_VERSION);
            return Err(RecordingError::Newer { path: path.into(), found, known });
        }
        if about.format_version < 2 && about.kind == Kind::Live {
            return Err(RecordingError::Older { path: path.into(), found: about.format_version });
        }
        let mut entries = Vec::with_capacity(messages.len());
        for (number, message) in messages.into_iter().enumerate() {
            let broken = |what: String| RecordingError::Broken {
                path: path.into(),
                what: format!("message {number} on {}: {what}", message.channel.topic),
            };
            entries.extend(entry(&message).map_err(broken)?);
        }
        Ok(Self { path: path.into(), about, entries, damage, attachments })
    }

    /// The text of an attachment.
    pub fn text(&self, name: &str) -> Result<&str, RecordingError> {
        let broken = |what: String| RecordingError::Broken { path: self.path.clone(), what };
        let found = self.attachments.iter().find(|(n, _)| n == name);
        let (_, data) = found.ok_or_else(|| broken(format!("the attachment `{name}` is missing")))?;
        std::str::from_utf8(data).map_err(|e| broken(format!("the attachment `{name}` is no text: {e}")))
    }

    /// The setup of an imported session.
    pub fn import_setup(&self) -> Result<ImportSetup, RecordingError> {
        let broken = |e: serde_json::Error| RecordingError::Broken {
            path: self.path.clone(),
            what: format!("the attachment `import.json` is unreadable: {e}"),
        };
        let setup: ImportSetup = serde_json::from_str(self.text("import.json")?).map_err(broken)?;
        setup.board.check().map_err(|e| RecordingError::Broken { path: self.path.clone(), what: e.to_string() })?;
        Ok(setup)
    }

    /// Names of all attachments, in order.
    pub fn attachment_names(&self) -> impl Iterator<Item = &str> {
        self.attachments.iter().map(|(name, _)| name.as_str())
    }
}

fn entry(message: &scan::Message) -> Result<Option<Entry>, String> {
    let at = Stamp(message.log_time);
    match message.channel.topic.as_str() {
        topics::INPUTS => {
            let input = serde_json::from_slice(&message.data).map_err(|e| e.to_string())?;
            Ok(Some(Entry::Input(at, input)))
        }
        topics::COMMANDS => {
            serde_json::from_slice(&message.data).map(|c| Some(Entry::Command(c))).map_err(|e| e.to_string())
        }
        topics::IMAGES => {
            let image = CompressedImage::decode(message.data.as_slice()).map_err(|e| e.to_string())?;
            Ok(Some(Entry::Image(at, image.data.to_vec())))
        }
        topics::EVENTS => {
            let packet = EventPacket::from_cdr(&message.data).ok_or("not an EventPacket in little-endian CDR")?;
            Ok(Some(Entry::Events(packet)))
        }
        // Topics that others added to our file are theirs.
        _ => Ok(None),
    }
}
