//! The folder of a data set: its texts and their hashes, and what was passed over in them.

use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};

use serde_json::Value;
use sha2::{Digest as _, Sha256};

use super::error::{ImportError, Place};

/// A folder that is being imported.
#[derive(Debug)]
pub(super) struct Source {
    root: PathBuf,
    /// Facts for the recording: `sha256:<file>` and others.
    pub(super) facts: BTreeMap<String, String>,
    unknown_keys: Vec<String>,
    unknown_columns: Vec<String>,
    notices: Vec<String>,
}

impl Source {
    pub(super) fn new(root: &Path) -> Self {
        let (facts, notices) = (BTreeMap::new(), Vec::new());
        Self { root: root.into(), facts, unknown_keys: Vec::new(), unknown_columns: Vec::new(), notices }
    }

    /// The name of the folder.
    pub(super) fn name(&self) -> String {
        let whole = self.root.canonicalize().unwrap_or_else(|_| self.root.clone());
        whole.file_name().map_or_else(|| "imported".into(), |name| name.to_string_lossy().into_owned())
    }

    /// Whether the folder holds a file of this name.
    pub(super) fn has(&self, file: &str) -> bool {
        self.root.join(file).is_file()
    }

    /// Where a file of the folder is on the disk.
    pub(super) fn path(&self, file: &str) -> PathBuf {
        self.root.join(file)
    }

    /// The text of a file, without a byte order mark; its hash becomes a fact.
    pub(super) fn text(&mut self, file: &str) -> Result<String, ImportError> {
        let bytes = fs::read(self.path(file)).map_err(|why| io_error(file, &why))?;
        self.set_sha256(file, &Sha256::digest(&bytes));
        let text = String::from_utf8(bytes).map_err(|error| {
            let good = error.utf8_error().valid_up_to();
            let line = 1 + error.as_bytes().iter().take(good).filter(|b| **b == b'\n').count() as u64;
            Place::line(file, line).wrong("not UTF-8 text; save the file as UTF-8")
        })?;
        Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
    }

    /// Records the hash of a file.
    pub(super) fn set_sha256(&mut self, file: &str, digest: &[u8]) {
        let hex = digest.iter().map(|byte| format!("{byte:02x}")).collect();
        self.facts.insert(format!("sha256:{file}"), hex);
    }

    /// Checks that a path in a data set names an existing file inside the folder; `key` is where it was read.
    pub(super) fn check_file(&self, place: &Place, key: &str, file: &str) -> Result<(), ImportError> {
        let inside = Path::new(file).components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
        if !inside {
            return Err(
                place.wrong(format!("{key} is `{file}`, outside the folder; give a path relative to the folder"))
            );
        }
        if !self.has(file) {
            return Err(place.wrong(format!("{key} is `{file}`, but there is no such file")));
        }
        Ok(())
    }

    /// Says something about the data set that is no error.
    pub(super) fn note(&mut self, notice: impl Into<String>) {
        self.notices.push(notice.into());
    }

    /// Notes the columns of a table that nothing reads.
    pub(super) fn note_columns(&mut self, file: &str, columns: &[String]) {
        self.unknown_columns.extend(columns.iter().map(|column| format!("{file}: {column}")));
    }

    /// Notes the keys of a file that nothing reads. `known` has the keys of each object; "" is the file itself.
    pub(super) fn note_keys(&mut self, file: &str, value: &Value, known: &[(&str, &[&str])]) {
        for (object, keys) in known {
            let inner = if object.is_empty() { Some(value) } else { value.get(object) };
            let Some(map) = inner.and_then(Value::as_object) else { continue };
            let dot = if object.is_empty() { "" } else { "." };
            let unknown = map.keys().filter(|key| !keys.contains(&key.as_str()));
            self.unknown_keys.extend(unknown.map(|key| format!("{file}: {object}{dot}{key}")));
        }
    }

    /// All notices, those about unknown keys and columns summed up in one each.
    pub(super) fn notices(&self) -> Vec<String> {
        let sum = |what: &str, names: &[String]| {
            (!names.is_empty()).then(|| format!("ignored unknown {what}: {}", super::some_of(names)))
        };
        let unknown = [sum("keys", &self.unknown_keys), sum("columns", &self.unknown_columns)];
        unknown.into_iter().flatten().chain(self.notices.iter().cloned()).collect()
    }
}

/// The error that a file cannot be read.
pub(super) fn io_error(file: &str, why: &std::io::Error) -> ImportError {
    match why.kind() {
        ErrorKind::NotFound => Place::file(file).wrong("is missing"),
        _ => Place::file(file).wrong(format!("cannot be read: {why}")),
    }
}

/// Where a key is in a text: each of `keys` is searched after the one before, as written in the file.
pub(super) fn place_of<S: AsRef<str>>(file: &str, text: &str, keys: &[S]) -> Place {
    let mut at = 0;
    for key in keys.iter().map(AsRef::as_ref) {
        let Some(found) = text.get(at..).and_then(|rest| rest.find(key)) else { return Place::file(file) };
        at += found + key.len();
    }
    let start = at - keys.last().map_or(0, |key| key.as_ref().len());
    let before = text.get(..start).unwrap_or_default();
    let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
    let column = 1 + before.get(line_start..).unwrap_or_default().chars().count() as u64;
    Place { column: Some(column), ..Place::line(file, 1 + before.matches('\n').count() as u64) }
}
