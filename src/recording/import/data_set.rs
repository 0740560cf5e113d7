//! A data set of any layout, checked, before it is written as a session.

use std::path::PathBuf;

use super::error::{ImportError, Place};
use super::events_raw::RawFile;
use super::source::Source;
use crate::board::{Board, DICTIONARIES};
use crate::recording::ImportSetup;
use crate::session::{Declared, Exposure};

/// A data set, ready to be written.
#[derive(Debug)]
pub(super) struct DataSet {
    /// The layout, in words.
    pub(super) layout: &'static str,
    /// Facts and notices.
    pub(super) source: Source,
    /// Stands in for cell and trajectory.
    pub(super) setup: ImportSetup,
    /// Where the size of the images was said, in words.
    pub(super) size_declared_in: &'static str,
    /// Poses with exposures, in order of their last exposure.
    pub(super) captures: Vec<Capture>,
    /// The recording of the event camera.
    pub(super) events: Option<RawFile>,
}

/// What was captured at one pose.
#[derive(Debug)]
pub(super) struct Capture {
    /// Index of the pose.
    pub(super) pose: usize,
    /// Its exposures in order of time.
    pub(super) exposures: Vec<Shot>,
    /// What the source says about the pose.
    pub(super) declared: Declared,
}

impl Capture {
    /// End of its last exposure, seconds since the origin of the session.
    pub(super) fn end_s(&self) -> f64 {
        self.exposures.iter().map(|shot| shot.exposure.end_s).fold(0.0, f64::max)
    }
}

/// One exposure and its image.
#[derive(Debug)]
pub(super) struct Shot {
    /// When, seconds since the origin of the session.
    pub(super) exposure: Exposure,
    /// The image; absent where the source has none.
    pub(super) image: Option<ImageFile>,
}

/// An encoded image of the data set.
#[derive(Debug, Clone)]
pub(super) struct ImageFile {
    /// Where it is on the disk.
    pub(super) path: PathBuf,
    /// Its name, relative to the folder.
    pub(super) name: String,
    /// Where the source names it.
    pub(super) named_at: Place,
}

/// The board that the user gives, checked.
pub(super) fn given_board(board: &Board) -> Result<Board, ImportError> {
    check_board(board).map_err(|why| Place::file("--board").wrong(format!("cannot be: {why}")))?;
    Ok(board.clone())
}

/// Why a board cannot be, dictionary included.
pub(super) fn check_board(board: &Board) -> Result<(), String> {
    board.check().map_err(|why| why.to_string())?;
    if DICTIONARIES.contains(&board.dictionary.as_str()) {
        return Ok(());
    }
    Err(format!("dictionary `{}` is unknown; allowed are {}", board.dictionary, DICTIONARIES.join(", ")))
}
