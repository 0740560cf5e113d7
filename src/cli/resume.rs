//! `cellcal resume`: goes on with a session that ended early.

use std::path::{Path, PathBuf};

use clap::Args;

use super::exit::UsageError;
use super::progress::say;
use super::run::{close, free_name, record, refuse_unanswered, refuse_unwatched, solve, time_scale};
use super::session::{AtTerminal, Steps, interrupts, open, tell};
use super::{Exit, cameras, cell, rehearsal};
use crate::config::{Cell, MotionBy};
use crate::devices::sim::cell::SimStart;
use crate::recording::{Attachment, Entry, Kind, Recording, Writer};
use crate::runner::setup::{CellTexts, Planned};
use crate::runner::{self, Live, Past, RunOptions, Told};
use crate::session::{Input, Machine as _, Stamp};

/// From the last input of the old part to the first of the new one, ns.
const PAUSE_NS: u64 = 1_000_000_000;

/// Goes on with a session that ended early: pre-flight again, back along the way at slow speed, then the
/// missing poses only. Writes a new file that holds both parts.
#[derive(Debug, Args)]
pub(super) struct Resume {
    /// A session written by `run`, also one that was cut (`.partial`).
    session: PathBuf,
    /// Refuses to go on if this cell file is not the one that the session was begun with. Needed where a camera of it
    /// is a folder or a file beside it.
    #[arg(long)]
    cell: Option<PathBuf>,
    /// Nobody is there: no question is asked.
    #[arg(long)]
    unattended: bool,
    /// Simulated seconds a real second, or `max`; only for a simulated robot. Default: 1.
    #[arg(long, value_parser = time_scale)]
    time_scale: Option<f64>,
    /// Prints exactly the bytes of result.json.
    #[arg(long)]
    json: bool,
}

impl Resume {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        let recording = Recording::open(&self.session)?;
        let refuse = |why: &str| UsageError(format!("{}: {why}", self.session.display()));
        if recording.about.kind != Kind::Live {
            return Err(refuse("an imported session cannot be resumed").into());
        }
        recording.damage.iter().for_each(|damage| say(&format!("warning: {damage}")));
        let texts = CellTexts::of_recording(&recording)?;
        self.refuse_other_cell(&texts)?;
        let options = RunOptions::of_facts(&recording.about.facts);
        let Planned { cell, plan, setup } = texts.plan_with(&options)?;
        let about = recording.about.clone();
        let seed = about.facts.get("sim_seed").and_then(|s| s.parse().ok());
        self.refuse(&cell, &options)?;
        let machine = setup.machine.clone().into_live();
        let mut machine =
            machine.ok_or_else(|| refuse("a session without a robot cannot be resumed; begin a new one"))?;
        let stood = last_joints(&recording);
        let path = self.new_name()?;
        let mut writer = Writer::create(&path, &about, &attachments(&recording))?;
        let mut fresh = Fresh { path: &path, keep: false };
        let mut past = Past::new(recording, &mut writer);
        runner::drive(&mut machine, &mut past)?;
        let first = Stamp(past.last().0.saturating_add(PAUSE_NS));
        let missing = machine.missing();
        if missing == 0 {
            return Err(refuse("no pose is missing; `cellcal replay` solves it").into());
        }
        say(&format!("{missing} of {} poses are missing", plan.poses.len()));
        let start = SimStart { first, joints_rad: stood, ..SimStart::default() };
        let bench = open(self.cell.as_deref().unwrap_or(&self.session), &cell, &options, seed, self.time_scale, start)?;
        fresh.keep = true;
        let mut operator = AtTerminal::new(self.unattended);
        let mut steps = Steps::new(&plan);
        let mut hear = |told: Told<'_>| steps.hear(told);
        let timing = (cell.images_per_pose, setup.image_period_s);
        let live = Live::new(bench.devices, writer, timing, interrupts()?, &mut operator, &mut hear)?;
        let mut live = live.expecting(&cell.display).recording(record(&cell)).resumed();
        let driven = runner::drive(&mut machine, &mut live).map(|()| machine.into_outcome());
        let (outcome, path) = close(driven, live)?;
        tell(&outcome.end, &path, self.cell.as_deref());
        say(&format!("recorded: {}", path.display()));
        if options.rehearsal {
            return rehearsal::finish(&outcome, &plan, self.json, &steps.notes);
        }
        solve(&path, self.json, &steps.notes)
    }

    fn refuse(&self, cell: &Cell, run: &RunOptions) -> Result<(), UsageError> {
        refuse_unanswered(&self.session, run, self.unattended)?;
        refuse_unwatched(&self.session, cell, self.unattended)?;
        if let (None, false, Some((key, source))) = (&self.cell, run.rehearsal, cameras::beside_the_cell(cell)) {
            let why = format!("{key} is `{source}`, relative to the cell file; name that file with --cell");
            return Err(UsageError(format!("{}: {why}", self.session.display())));
        }
        if matches!(cell.robot.motion, MotionBy::External(_)) {
            let why = "a program of the plant moved the arm, and it cannot be told where to go on; begin a new session";
            return Err(UsageError(format!("{}: {why}", self.session.display())));
        }
        Ok(())
    }

    fn refuse_other_cell(&self, texts: &CellTexts) -> anyhow::Result<()> {
        let Some(path) = &self.cell else { return Ok(()) };
        let now = cell::load(path)?;
        if now.sha256() == texts.sha256() {
            return Ok(());
        }
        let why = "it or a file that it names has changed since the session began; begin a new session";
        Err(UsageError(format!("{}: {why}", path.display())).into())
    }

    /// Beside the old one, which is kept.
    fn new_name(&self) -> anyhow::Result<PathBuf> {
        let name = self.session.file_name().and_then(|n| n.to_str()).unwrap_or("session");
        let stem = name.split_once(".mcap").map_or(name, |(stem, _)| stem);
        let folder = self.session.parent().unwrap_or(Path::new(""));
        free_name(folder, &format!("{stem}-resumed"))
    }
}

/// The session goes on under its own name: everything that belonged to it still does.
fn attachments(recording: &Recording) -> Vec<Attachment> {
    let names: Vec<String> = recording.attachment_names().map(str::to_owned).collect();
    let text = |name: &String| recording.text(name).ok().map(|t| t.as_bytes().to_vec());
    names.iter().filter_map(|name| Some(Attachment { name: name.clone(), data: text(name)? })).collect()
}

/// Where the arm stood last.
fn last_joints(recording: &Recording) -> Option<[f64; 6]> {
    recording.entries.iter().rev().find_map(|entry| match entry {
        Entry::Input(_, Input::Robot(sample)) => Some(sample.target_joints_rad),
        _ => None,
    })
}

/// A new file that goes again where the session does not go on: it holds nothing that the old one does not hold.
struct Fresh<'a> {
    path: &'a Path,
    keep: bool,
}

impl Drop for Fresh<'_> {
    fn drop(&mut self) {
        if !self.keep {
            let _ = std::fs::remove_file(self.path.with_extension("mcap.partial"));
        }
    }
}
