//! What is wrong with a file, each problem with its line and column.

use std::collections::BTreeSet;
use std::fmt;

use super::source::{At, Index};

/// A cell or trajectory file that cannot be used, with everything that is wrong with it.
///
/// Displayed as `FILE:LINE:COLUMN: key.path what is wrong: what to do`, one line a problem; every line after the
/// first begins with `error: `, so that a program which prints `error: {this}` prints them all alike.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub struct ConfigError {
    /// The file as the caller named it.
    pub file: String,
    /// The problems, in the order of the file; at least one.
    pub problems: Vec<Problem>,
}

/// One thing that is wrong.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Problem {
    /// Line, from 1.
    pub line: u64,
    /// Column, from 1.
    pub column: u64,
    /// The key, what was found, what is allowed, what to do.
    pub message: String,
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, Problem { line, column, message }) in self.problems.iter().enumerate() {
            let lead = if i == 0 { "" } else { "\nerror: " };
            write!(f, "{lead}{}:{line}:{column}: {message}", self.file)?;
        }
        Ok(())
    }
}

impl ConfigError {
    pub(super) fn one(file: &str, at: At, message: String) -> Self {
        let problem = Problem { line: at.line.max(1), column: at.column.max(1), message };
        Self { file: file.into(), problems: vec![problem] }
    }
}

/// Collects the problems of one file.
pub(super) struct Findings<'a> {
    file: &'a str,
    pub(super) index: Index,
    problems: Vec<Problem>,
    told: BTreeSet<String>,
}

impl<'a> Findings<'a> {
    pub(super) fn new(file: &'a str, index: Index) -> Self {
        Self { file, index, problems: Vec::new(), told: BTreeSet::new() }
    }

    /// `path` is where and what it is called, `rest` continues the sentence: `is 3, ...`. Of several problems of one
    /// value the first is told: the others may follow from it.
    pub(super) fn add(&mut self, path: &str, rest: impl fmt::Display) {
        if self.told.insert(path.to_owned()) {
            self.push(path, rest);
        }
    }

    fn push(&mut self, path: &str, rest: impl fmt::Display) {
        let at = self.index.find(path).map_or(At::default(), |e| e.at);
        let message = if path.is_empty() { rest.to_string() } else { format!("{path} {rest}") };
        self.problems.push(Problem { line: at.line.max(1), column: at.column.max(1), message });
    }

    /// A key that must be there: `parent` names the mapping, empty the file itself.
    pub(super) fn missing(&mut self, parent: &str, key: &str, fix: &str) {
        self.push(parent, missing(parent, key, fix));
    }

    /// The value where nothing is wrong.
    pub(super) fn finish<T>(self, value: T) -> Result<T, ConfigError> {
        let Self { file, mut problems, .. } = self;
        problems.sort();
        if problems.is_empty() { Ok(value) } else { Err(ConfigError { file: file.into(), problems }) }
    }
}

/// How a missing key is said; follows the path of its mapping.
pub(super) fn missing(parent: &str, key: &str, fix: &str) -> String {
    let fix = if fix.is_empty() { String::new() } else { format!(": {fix}") };
    if parent.is_empty() { format!("key `{key}` is missing{fix}") } else { format!("has no key `{key}`{fix}") }
}
