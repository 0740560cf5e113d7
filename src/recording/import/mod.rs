//! Foreign data sets turned into sessions: the same inputs that a run of our own would have logged.
//!
//! [`import`] recognises the layout by its marker file, checks everything that can be checked without the
//! pixels, then copies images and event words unchanged. The file of a layout is read in one place
//! (`session_folder`, `image_pose`, `corners`); all end in a `DataSet`, which `write` turns into a recording.
//! [`import_bag`] does the same for an MCAP file of others, message by message (`bag`).
//! Uses the rest of `recording`, `config`, `events`, `session`, `board`, `geometry`.

mod bag;
mod corners;
mod data_set;
mod error;
mod events_raw;
mod frames;
mod image_file;
mod image_pose;
mod poses;
mod session_folder;
mod session_json;
mod source;
mod table;
mod write;

#[cfg(test)]
mod tests;

pub use bag::{BagOptions, Pictures, import_bag};
pub use error::{ImportError, Place};

use std::fs;
use std::path::{Path, PathBuf};

use crate::board::Board;
use data_set::DataSet;
use source::Source;

/// The file that marks layout A.
const MARKER_A: &str = "session.json";
/// The file that marks layout B.
const MARKER_B: &str = "cal_data.yaml";
/// Names that an error lists at most.
const NAMES_LISTED: usize = 10;

/// Says the width and height of an encoded image in pixels, or why it is unreadable.
pub type Probe<'a> = &'a dyn Fn(&[u8]) -> Result<(u32, u32), String>;

/// What the user may add to a data set.
#[derive(Debug, Clone, Default)]
pub struct ImportOptions {
    /// Name of the data set; absent: the name of its folder.
    pub name: Option<String>,
    /// The board; counts before the one in the data set.
    pub board: Option<Board>,
    /// Width and height of the images that corners were found in, pixels; for layout C only.
    pub image_size: Option<(u32, u32)>,
    /// Names the session; given by the caller, so that importing twice can give equal bytes.
    pub session_id: String,
}

/// What was imported.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ImportReport {
    /// The session file.
    pub path: PathBuf,
    /// The layout that was recognised, in words.
    pub layout: String,
    /// Poses, also those without an image.
    pub poses: usize,
    /// Images copied.
    pub images: usize,
    /// Raw event bytes copied, without the header.
    pub event_bytes: u64,
    /// What was ignored or looks odd, in words.
    pub notices: Vec<String>,
}

/// Imports the data set in `folder` into the new session file `output`.
///
/// `probe` says the size of an encoded image. `progress` is called with pieces done and in total. The output is
/// called `.partial` until it is complete; nothing is left of it after an error.
///
/// # Errors
/// [`ImportError`] where the folder fits no layout, a file is missing, contradicts another or holds a value that
/// cannot be, and where `output` exists or cannot be written.
pub fn import(
    folder: &Path,
    output: &Path,
    options: &ImportOptions,
    probe: Probe<'_>,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<ImportReport, ImportError> {
    write::check_output(output)?;
    let data_set = read(folder, options, probe)?;
    write::write(data_set, output, &options.session_id, probe, progress)
}

fn read(folder: &Path, options: &ImportOptions, probe: Probe<'_>) -> Result<DataSet, ImportError> {
    if folder.is_file() {
        return read_corners(folder, options);
    }
    let names = names_in(folder)?;
    let has = |name: &str| names.iter().any(|found| found == name);
    if options.image_size.is_some() && (has(MARKER_A) || has(MARKER_B)) {
        return Err(ImportError::NoSizeNeeded { path: folder.into() });
    }
    let source = Source::new(folder);
    match (has(MARKER_A), has(MARKER_B)) {
        (true, true) => Err(ImportError::TwoLayouts { path: folder.into() }),
        (true, false) => session_folder::read(source, options),
        (false, true) => image_pose::read(source, options, probe),
        (false, false) => match names.iter().find(|name| corners::is_of_corners(&folder.join(name))) {
            Some(file) => corners::read(source, file, options),
            None => Err(no_layout(folder, &names)),
        },
    }
}

/// Reads a file that is a whole data set.
fn read_corners(path: &Path, options: &ImportOptions) -> Result<DataSet, ImportError> {
    if bag::is_mcap(path) {
        return Err(ImportError::NoMap { path: path.into(), topics: bag::topics(path)? });
    }
    if !corners::is_of_corners(path) {
        return Err(ImportError::NotAFolder { path: path.into() });
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    let file = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    corners::read(Source::new(folder), &file, options)
}

/// Names of everything in the folder, sorted.
fn names_in(folder: &Path) -> Result<Vec<String>, ImportError> {
    let failed = |why| ImportError::Folder { path: folder.into(), why };
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        names.push(entry.map_err(failed)?.file_name().to_string_lossy().into_owned());
    }
    names.sort();
    Ok(names)
}

fn no_layout(folder: &Path, names: &[String]) -> ImportError {
    let found = if names.is_empty() { "nothing: it is empty".into() } else { some_of(names) };
    ImportError::UnknownLayout { path: folder.into(), found }
}

/// The first names, and how many more there are.
fn some_of<S: AsRef<str>>(names: &[S]) -> String {
    let listed: Vec<&str> = names.iter().take(NAMES_LISTED).map(AsRef::as_ref).collect();
    let more = names.len().saturating_sub(NAMES_LISTED);
    let listed = listed.join(", ");
    if more == 0 { listed } else { format!("{listed} and {more} more") }
}
