//! The trajectory file that is being taught, as it lies on the disk.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::Write as _;
use std::path::{Path, PathBuf};

use crate::cli::exit::UsageError;
use crate::cli::read_text;
use crate::config::{self, Pattern, TaughtPose, Trajectory};

/// What may happen to a file that is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mode {
    /// Nothing: there must be none.
    New,
    /// Poses are added at its end.
    Append,
    /// It is replaced.
    Replace,
}

/// The file; every write replaces it in one step.
#[derive(Debug)]
pub(super) struct TaughtFile {
    path: PathBuf,
    mode: Mode,
    name: String,
    /// Its text before the first pose; comes back when every pose is undone.
    before: Option<String>,
    /// Ids in that text, if it is to be extended.
    ids: BTreeSet<String>,
    header: Vec<String>,
    touched: bool,
}

impl TaughtFile {
    /// Looks at what is there; writes nothing. Without a name it is that of the file.
    pub(super) fn open(path: &Path, name: Option<&str>, mode: Mode) -> anyhow::Result<Self> {
        let shown = path.display();
        let exists = path.try_exists().map_err(|why| UsageError(format!("{shown}: {why}")))?;
        if exists && mode == Mode::New {
            let why = "exists already; --append adds poses to it, --force replaces it";
            return Err(UsageError(format!("{shown} {why}")).into());
        }
        let before = if exists { Some(read_text(path)?) } else { None };
        // The file behind a link is replaced, not the link.
        let path = if exists { fs::canonicalize(path)? } else { path.to_owned() };
        if !folder_of(&path).is_dir() {
            return Err(UsageError(format!("{shown}: there is no folder {}", folder_of(&path).display())).into());
        }
        let stem = path.file_stem().and_then(OsStr::to_str).unwrap_or_default();
        let (mut ids, mut own) = (BTreeSet::new(), name.unwrap_or(stem).to_owned());
        if let (Mode::Append, Some(text)) = (mode, &before) {
            let trajectory = config::parse_trajectory(text, &shown.to_string())?;
            if let Some(other) = name.filter(|name| *name != trajectory.name) {
                let has = &trajectory.name;
                return Err(
                    UsageError(format!("{shown}: its name is `{has}`, not `{other}`; leave --name away")).into()
                );
            }
            ids = ids_of(&trajectory);
            own = trajectory.name;
        }
        if !config::is_name(&own) {
            let why = "cannot be the name of a trajectory: give one with --name, 1 to 64 letters, digits, - and _";
            return Err(UsageError(format!("{own:?} {why}")).into());
        }
        Ok(Self { path, mode, name: own, before, ids, header: Vec::new(), touched: false })
    }

    /// Where it is.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Ids that the file has already.
    pub(super) fn ids(&self) -> BTreeSet<String> {
        self.ids.clone()
    }

    /// What stands above the poses.
    pub(super) fn describe(&mut self, header: Vec<String>) {
        self.header = header;
    }

    /// Replaces the file by one with these poses; without any, what was there before comes back.
    pub(super) fn write(&mut self, poses: &[TaughtPose]) -> anyhow::Result<()> {
        let shown = self.path.display().to_string();
        if self.mode == Mode::New && !self.touched && self.path.exists() {
            return Err(UsageError(format!("{shown} has come into being meanwhile; nothing is overwritten")).into());
        }
        if poses.is_empty() && !self.touched {
            return Ok(());
        }
        match self.text(poses, &shown)? {
            Some(text) => put(&self.path, &text)?,
            None => fs::remove_file(&self.path).map_err(|why| anyhow::anyhow!("{shown}: {why}"))?,
        }
        // Where every pose is undone, all is as before the first.
        self.touched = !poses.is_empty();
        Ok(())
    }

    fn text(&self, poses: &[TaughtPose], shown: &str) -> anyhow::Result<Option<String>> {
        if poses.is_empty() {
            return Ok(self.before.clone());
        }
        let text = match (self.mode, &self.before) {
            (Mode::Append, Some(before)) => config::append_yaml(before, shown, poses, &self.header)?,
            (Mode::Append, None) | (Mode::New | Mode::Replace, _) => {
                config::trajectory_yaml(&self.name, poses, &self.header)
            }
        };
        // Nothing that cannot be read again takes the place of anything.
        config::parse_trajectory(&text, shown)?;
        Ok(Some(text))
    }
}

/// The ids that the file itself gives.
fn ids_of(trajectory: &Trajectory) -> BTreeSet<String> {
    let mut ids = BTreeSet::new();
    for segment in &trajectory.segments {
        match &segment.pattern {
            Pattern::Joints(stops) => ids.extend(stops.iter().filter_map(|s| s.id.clone())),
            Pattern::Tcp(stops) => ids.extend(stops.iter().filter_map(|s| s.id.clone())),
            Pattern::Views(stops) => ids.extend(stops.iter().filter_map(|s| s.id.clone())),
            Pattern::Translate(pairs) => ids.extend(pairs.iter().map(|p| p.name.clone())),
            Pattern::Grid { .. }
            | Pattern::Depth { .. }
            | Pattern::Roll { .. }
            | Pattern::Sweep { .. }
            | Pattern::Orbit { .. } => {}
        }
    }
    ids
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Replaces a file in one step: after a crash or a power cut it is the old or the new one, whole.
pub(in crate::cli) fn put(path: &Path, text: &str) -> anyhow::Result<()> {
    // A link stays a link, and a device is nothing to replace.
    let path = &fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    if path.exists() && !path.is_file() {
        return Err(UsageError(format!("{}: is no regular file; give another name", path.display())).into());
    }
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".partial");
    let fresh = path.with_file_name(name);
    let write = || {
        let mut file = File::create(&fresh)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        fs::rename(&fresh, path)?;
        File::open(folder_of(path))?.sync_all()
    };
    write().map_err(|why| anyhow::anyhow!("{}: {why}", path.display()))
}
