//! GenICam cameras (GigE Vision and USB3 Vision) through Aravis.
//!
//! [`open`] finds a camera, sets it as the cell says, reads everything back and starts a thread that takes images in.
//! All objects of Aravis live in that thread. Discovery sends broadcasts on every network interface.

mod clock;
mod find;
mod pixels;
mod settings;
mod stream;

use std::sync::Arc;
use std::sync::mpsc::channel;

pub use find::{Found, list};

use super::streaming::{Intake, Streaming, Timing};
use super::{CameraFacts, Clock, FrameCamera};
use crate::config::FrameCameraCell;

/// Why a camera cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum GenicamError {
    /// Nothing answers, or not the one.
    #[error("no GenICam camera {wanted}; {found}")]
    Missing {
        /// Which was asked for, in words.
        wanted: String,
        /// What answers, in words.
        found: String,
    },
    /// More than one, and none was named.
    #[error("{count} GenICam cameras answer; give rgb.serial of one: {found}")]
    Several {
        /// How many.
        count: usize,
        /// What answers, in words.
        found: String,
    },
    /// It answers, but another program has it.
    #[error("the camera {serial} is controlled by another program; end that one first")]
    Busy {
        /// Its serial number.
        serial: String,
    },
    /// It cannot be set as the cell says.
    #[error("rgb.{key} is {wanted}, but the camera {found}")]
    Setting {
        /// The key in the cell file.
        key: &'static str,
        /// What the cell says.
        wanted: String,
        /// What the camera can.
        found: String,
    },
    /// It sends nothing that can be used.
    #[error("the camera has no pixel format that can be used: it has {found}; wanted are {wanted}")]
    Format {
        /// Its formats.
        found: String,
        /// Ours.
        wanted: String,
    },
    /// A feature that every camera has, refused.
    #[error("the camera refused {what}: {why}")]
    Refused {
        /// What was asked.
        what: String,
        /// The words of Aravis.
        why: String,
    },
    /// The system gave no thread.
    #[error("no thread for the camera: {0}")]
    Thread(String),
}

/// A camera that has been set, as it describes itself.
struct Opened {
    facts: CameraFacts,
    size: [u32; 2],
    timing: Timing,
}

/// Opens the camera that the cell names, or the only one; images begin to arrive at once.
pub fn open(cell: &FrameCameraCell, clock: Arc<dyn Clock>) -> Result<Box<dyn FrameCamera>, GenicamError> {
    let intake = Intake::new(clock);
    let (tell, told) = channel();
    let (cell, fed) = (cell.clone(), Arc::clone(&intake));
    let body = move || match stream::Stream::open(&cell) {
        Ok((stream, opened)) => {
            if tell.send(Ok(opened)).is_ok() {
                stream.run(&fed);
            }
        }
        // Whoever asked has gone: nobody is left to be told.
        Err(error) => drop(tell.send(Err(error))),
    };
    let thread = std::thread::Builder::new().name("genicam".into()).spawn(body);
    let thread = thread.map_err(|error| GenicamError::Thread(error.to_string()))?;
    let ended = |_| Err(GenicamError::Thread("it ended before the camera was open".into()));
    let Opened { facts, size, timing } = told.recv().unwrap_or_else(ended)?;
    Ok(Box::new(Streaming::new(facts, size, timing, intake, thread)))
}
