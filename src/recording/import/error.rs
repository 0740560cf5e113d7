//! Why a folder cannot be imported: always the file, and the line and column where there is one.

use std::fmt;
use std::path::PathBuf;

use super::super::RecordingError;
use crate::config::ConfigError;

/// Why a folder cannot be imported; nothing has been written then.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The folder cannot be listed.
    #[error("cannot read the folder {path}: {why}; give the folder that holds the data set")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The reason of the system.
        why: std::io::Error,
    },
    /// A file where a folder is expected.
    #[error(
        "{path} is a file, but neither an MCAP bag nor the JSON of a layout C (with `board` and `views`); give the folder \
         that holds the data set"
    )]
    NotAFolder {
        /// What was given.
        path: PathBuf,
    },
    /// None of the layouts.
    #[error(
        "{path} holds no data set that can be imported; looked for session.json (layout A: session folder), \
         cal_data.yaml (layout B: image and pose files) and a JSON file with `board` and `views` (layout C: corners only), \
         found {found}"
    )]
    UnknownLayout {
        /// The folder.
        path: PathBuf,
        /// What is in it.
        found: String,
    },
    /// Two layouts at once.
    #[error(
        "{path} holds both session.json (layout A) and cal_data.yaml (layout B); remove the one that does not count"
    )]
    TwoLayouts {
        /// The folder.
        path: PathBuf,
    },
    /// An option that this layout has no use for.
    #[error(
        "--image-size is for corners without images (layout C); {path} has images, whose size is known: leave it out"
    )]
    NoSizeNeeded {
        /// What was given.
        path: PathBuf,
    },
    /// A file of the data set is wrong.
    #[error("{place}{}{what}", place.separator())]
    Wrong {
        /// Where.
        place: Place,
        /// What was found, what is allowed and what to do.
        what: String,
    },
    /// The map of a bag is wrong.
    #[error(transparent)]
    Map(#[from] ConfigError),
    /// A bag without a map.
    #[error(
        "{path} is an MCAP bag; say with --map topics.yaml what its topics mean (README, Imports): it has {topics}"
    )]
    NoMap {
        /// The bag.
        path: PathBuf,
        /// Its topics and what is on them.
        topics: String,
    },
    /// The session file cannot be written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

/// Where in a data set something is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// Name of the file, relative to the folder.
    pub file: String,
    /// Line, from 1.
    pub line: Option<u64>,
    /// Column, from 1; tables name the column in the text instead.
    pub column: Option<u64>,
}

impl Place {
    /// A whole file.
    pub(super) fn file(file: impl Into<String>) -> Self {
        Self { file: file.into(), line: None, column: None }
    }

    /// A line of a file.
    pub(super) fn line(file: impl Into<String>, line: u64) -> Self {
        Self { line: Some(line), ..Self::file(file) }
    }

    /// The error that something is wrong here.
    pub(super) fn wrong(&self, what: impl Into<String>) -> ImportError {
        ImportError::Wrong { place: self.clone(), what: what.into() }
    }

    /// `frames.csv is missing` reads better without a colon, `frames.csv:17: ...` with one.
    fn separator(&self) -> &'static str {
        if self.line.is_some() { ": " } else { " " }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.file)?;
        self.line.map_or(Ok(()), |line| write!(f, ":{line}"))?;
        self.column.map_or(Ok(()), |column| write!(f, ":{column}"))
    }
}
