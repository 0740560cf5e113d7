//! A session as one MCAP file: schemas, writer, reader, damage, and foreign data sets turned into it.
//!
//! One file is one session: inputs, commands, images and raw event packets in the order in which they
//! happened, the cell and trajectory text, versions and hashes. A replay needs nothing else. Uses
//! `session`, `events`, `calibration`, `board`, `geometry`. Start at [`Writer`] and [`Recording`].

mod background;
mod cdr;
pub mod import;
mod reader;
pub mod scan;
mod setup;
mod writer;

pub use background::Background;
pub use cdr::EventPacket;
pub use reader::{Entry, Recording};
pub use setup::{About, Attachment, FORMAT_VERSION, ImportSetup, Kind};
pub use writer::Writer;

use std::path::PathBuf;

/// What the library said; an error of the system as such, so that a full disk is called one.
fn of_mcap(path: &std::path::Path, why: mcap::McapError) -> RecordingError {
    match why {
        mcap::McapError::Io(why) => RecordingError::Io { path: path.into(), why },
        why => RecordingError::Mcap { path: path.into(), why },
    }
}

/// What can go wrong with a recording.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The system refused.
    #[error("{path}: {why}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The reason of the system.
        why: std::io::Error,
    },
    /// The MCAP library refused.
    #[error("{path}: {why}")]
    Mcap {
        /// The file.
        path: PathBuf,
        /// What the library said.
        why: mcap::McapError,
    },
    /// Not an MCAP file.
    #[error(
        "{path} is not an MCAP file: it begins with {found}; give a session written by `cellcal run` or `cellcal import`"
    )]
    NotMcap {
        /// The file.
        path: PathBuf,
        /// Its first bytes.
        found: String,
    },
    /// An MCAP file of something else.
    #[error(
        "{path} is an MCAP file, but not a cellcal session (library `{library}`, {messages} messages); `cellcal import --map topics.yaml` turns a bag into one"
    )]
    Foreign {
        /// The file.
        path: PathBuf,
        /// The library that wrote it.
        library: String,
        /// Messages in it.
        messages: usize,
    },
    /// Written by a newer program.
    #[error("{path} has session format {found}, this program reads up to {known}; use a newer cellcal")]
    Newer {
        /// The file.
        path: PathBuf,
        /// Version found.
        found: u32,
        /// Version known.
        known: u32,
    },
    /// A live session written before a controller described itself in it.
    #[error("{path} has session format {found}, written by an older cellcal; replay it with that version")]
    Older {
        /// The file.
        path: PathBuf,
        /// Version found.
        found: u32,
    },
    /// A part that every session has is missing or unreadable.
    #[error("{path}: {what}")]
    Broken {
        /// The file.
        path: PathBuf,
        /// What is wrong and what it means.
        what: String,
    },
}
