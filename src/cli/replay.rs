//! `cellcal replay`: repeats a recorded session without devices.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use super::exit::{self, UsageError};
use super::progress::{Bar, say};
use super::{Exit, print, read_text};
use crate::config;
use crate::report;
use crate::runner::setup::{Setup, SetupError};
use crate::runner::solve::{Solved, StoredViews, solve_recording};

/// Repeats a recorded session without devices, with identical results.
#[derive(Debug, Args)]
pub(super) struct Replay {
    /// A session written by `run` or `import`.
    session: PathBuf,
    /// Where to start.
    #[arg(long, value_enum, default_value = "pixels")]
    from: From,
    /// Takes cameras and stereo over from this result.json.
    #[arg(long)]
    intrinsics: Option<PathBuf>,
    /// Takes gates and solver settings from this cell file.
    #[arg(long)]
    cell: Option<PathBuf>,
    /// Changes one setting or gate for a what-if: settings.NAME=VALUE or gates.NAME=VALUE.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Folder for result.json and report; default: beside the session, unless something is changed.
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Prints exactly the bytes of result.json.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum From {
    /// The images and raw events.
    Pixels,
    /// The corners that an earlier run or replay found.
    Views,
}

impl Replay {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        let stored = match self.from {
            From::Pixels => None,
            From::Views => Some(stored_views(&self.session)?),
        };
        let bar = Bar::new("looking at images");
        let mut adjust = |setup: &mut Setup| self.adjust(setup);
        let solved = solve_recording(&self.session, &mut adjust, stored, &|done, total| bar.show(done, total))?;
        let changed = !solved.result.overrides.is_empty();
        let folder = match &self.output {
            Some(folder) => Some(folder.clone()),
            None => (!changed).then(|| folder_of(&self.session)),
        };
        finish(&solved, folder.as_deref(), self.json)?;
        Ok(exit::of_session(&solved, false))
    }

    /// What the user wants changed, said in words.
    fn adjust(&self, setup: &mut Setup) -> Result<Vec<String>, SetupError> {
        let mut overrides = Vec::new();
        if let Some(path) = &self.cell {
            let name = path.display().to_string();
            let read = |why: std::io::Error| SetupError::Cell { name: name.clone(), why: why.to_string() };
            let cell = config::parse_cell(&std::fs::read_to_string(path).map_err(read)?, &name)?;
            (setup.settings, setup.gates) = (cell.settings, Some(cell.gates));
            overrides.push(format!("gates and settings of the cell `{}`", cell.name));
        }
        if let Some(path) = &self.intrinsics {
            let name = path.display().to_string();
            let read = |why: std::io::Error| SetupError::Intrinsics { source_name: name.clone(), why: why.to_string() };
            setup.take_intrinsics(&name, &std::fs::read_to_string(path).map_err(read)?)?;
            let source = setup.known.as_ref().map(|k| k.source_sha256.clone()).unwrap_or_default();
            overrides.push(format!("intrinsics of the result with SHA-256 {source}"));
        }
        for given in &self.set {
            setup.set(given)?;
            overrides.push(given.clone());
        }
        Ok(overrides)
    }
}

/// Where the results of a session lie: a folder beside it, named as the session.
pub(super) fn folder_of(session: &Path) -> PathBuf {
    let name = session.file_name().and_then(|n| n.to_str()).unwrap_or_default();
    match name.split_once(".mcap") {
        // The session that was cut off before it had its final name keeps a folder apart.
        Some((stem, ".partial")) => session.with_file_name(format!("{stem}.partial-results")),
        Some((stem, _)) if !stem.is_empty() => session.with_file_name(stem),
        _ => session.with_file_name(format!("{name}.results")),
    }
}

fn stored_views(session: &Path) -> anyhow::Result<StoredViews> {
    let path = folder_of(session).join("views.json");
    let hint = |why| UsageError(format!("--from views: {why}; replay from pixels once to make it"));
    let text = read_text(&path).map_err(hint)?;
    Ok(serde_json::from_str(&text).map_err(|e| UsageError(format!("{}: {e}; replay from pixels", path.display())))?)
}

/// Prints the summary or the JSON, then writes result, views and report.
pub(super) fn finish(solved: &Solved, folder: Option<&Path>, json: bool) -> anyhow::Result<()> {
    let text = solved.result.to_json()?;
    // Printed first: what took minutes to solve is not lost to a folder that cannot be written.
    let printed = print(&if json { text.clone() } else { report::terminal(&solved.result) });
    if json {
        solved.result.warnings.iter().for_each(|w| say(&format!("warning: {w}")));
    }
    if let Some(folder) = folder {
        write_results(solved, &text, folder)?;
        say(&format!("result and report: {}", folder.display()));
    }
    printed
}

fn write_results(solved: &Solved, json: &str, folder: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder).map_err(|why| anyhow::anyhow!("{}: {why}", folder.display()))?;
    let result = folder.join("result.json");
    if let Ok(before) = std::fs::read_to_string(&result) {
        let same = before == json;
        say(if same {
            "identical to the earlier result"
        } else {
            "note: differs from the earlier result, which is replaced"
        });
    }
    replace(&result, json.as_bytes())?;
    replace(&folder.join("views.json"), serde_json::to_string(&solved.views)?.as_bytes())?;
    replace(&folder.join("report.html"), report::html(&solved.result).as_bytes())
}

/// Replaces a file in one step: a reader sees the old or the new one, whole.
pub(super) fn replace(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    let fresh = path.with_extension("new");
    let written = std::fs::write(&fresh, bytes).and_then(|()| std::fs::rename(&fresh, path));
    written.map_err(|why| anyhow::anyhow!("{}: {why}", path.display()))
}
