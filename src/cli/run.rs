//! `cellcal run`: a session, from the cell file to the verdict.

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use clap::Args;

use super::exit::{self, UsageError};
use super::progress::{Bar, say};
use super::session::{AtTerminal, SOLVING, Steps, interrupts, open, tell};
use super::{Exit, cameras, cell, handheld, rehearsal, replay};
use crate::config::{Cell, EventRecord, RobotDriver};
use crate::devices::sim::cell::SimStart;
use crate::devices::sim::ur::Planned as PlannedFault;
use crate::devices::ur::MOTION_SCRIPT;
use crate::recording::{About, Attachment, FORMAT_VERSION, Kind, Writer};
use crate::runner::setup::{CellTexts, Planned, Setup};
use crate::runner::solve::{sha256, solve_recording};
use crate::runner::{HandheldLive, Live, RunOptions, Told};
use crate::session::Outcome;

/// Share of the caps at which taught poses are driven to for the first time.
const VERIFY_SPEED: f64 = 0.2;

/// Runs a session: moves the arm, captures, solves, judges.
#[derive(Debug, Args)]
pub(super) struct Run {
    /// The cell file.
    cell: PathBuf,
    /// Walks the poses without cameras: pre-flight, every move, stillness; nothing is solved.
    #[arg(long)]
    rehearse: bool,
    /// Walks this trajectory instead of those of the cell.
    #[arg(long, requires = "rehearse")]
    trajectory: Option<PathBuf>,
    /// Asks before every move.
    #[arg(long)]
    step: bool,
    /// Share of the speed and acceleration caps of the cell, 0.01 to 1.
    #[arg(long, value_parser = share, default_value = "1")]
    speed: f64,
    /// Nobody is there: no question is asked, and a cell without an interlock is refused.
    #[arg(long)]
    unattended: bool,
    /// Simulated seconds a real second, or `max`; only for a simulated robot. Default: 1.
    #[arg(long, value_parser = time_scale)]
    time_scale: Option<f64>,
    /// Seed of the simulated cell, instead of the cell file's.
    #[arg(long)]
    seed: Option<u64>,
    /// Makes the simulated controller fail, such as `protective_stop@move:3`; may be repeated.
    #[arg(long = "sim-fault", value_name = "FAULT@WHEN")]
    sim_faults: Vec<PlannedFault>,
    /// Folder of the sessions.
    #[arg(short, long, default_value = "sessions")]
    output: PathBuf,
    /// Prints exactly the bytes of result.json.
    #[arg(long)]
    json: bool,
}

pub(super) fn time_scale(text: &str) -> Result<f64, String> {
    let scale = if text == "max" { Ok(f64::INFINITY) } else { text.parse::<f64>() };
    match scale {
        Ok(scale) if scale >= 0.01 => Ok(scale),
        _ => Err(format!("`{text}` is no time scale; expected a number from 0.01, or `max`")),
    }
}

fn share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(share) if (0.01..=1.0).contains(&share) => Ok(share),
        _ => Err(format!("`{text}` is no share; expected a number from 0.01 to 1")),
    }
}

impl Run {
    /// Drives slowly to the poses of a trajectory, one by one, asking before every move.
    pub(super) fn verify(cell: PathBuf, trajectory: PathBuf) -> Self {
        Self {
            cell,
            rehearse: true,
            trajectory: Some(trajectory),
            step: true,
            speed: VERIFY_SPEED,
            unattended: false,
            time_scale: None,
            seed: None,
            sim_faults: Vec::new(),
            output: "sessions".into(),
            json: false,
        }
    }

    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        let mut texts = cell::load(&self.cell)?;
        if let Some(path) = &self.trajectory {
            texts.folder = PathBuf::new();
            texts.trajectories = vec![(path.display().to_string(), super::read_text(path)?)];
        }
        let options = RunOptions { speed: self.speed, confirm_each: self.step, rehearsal: self.rehearse };
        let Planned { cell, plan, setup } = texts.plan_with(&options)?;
        self.refuse(&cell, &options)?;
        if let (_, Some(why)) = cell::observability_of(&cell, &plan)
            && !self.rehearse
        {
            return Err(UsageError(format!("{}: no motion: {why}", self.cell.display())).into());
        }
        for warning in &plan.warnings {
            say(&format!("warning: {warning}"));
        }
        if cell.robot.driver == RobotDriver::None {
            return self.by_hand(&cell, &texts, &options, &setup);
        }
        let start = SimStart { faults: self.sim_faults.clone(), ..SimStart::default() };
        let bench = open(&self.cell, &cell, &options, self.seed, self.time_scale, start)?;
        let (session_id, path) = self.name(&cell, &texts)?;
        let mut about = about(session_id, &texts, &bench.robot, &options, self.seed);
        about.facts.extend(cameras::facts(bench.devices.frame.as_deref(), bench.devices.event.as_deref()));
        let writer = Writer::create(&path, &about, &attachments(&texts))?;
        let mut operator = AtTerminal::new(self.unattended);
        let mut steps = Steps::new(&plan);
        let mut hear = |told: Told<'_>| steps.hear(told);
        let timing = (cell.images_per_pose, setup.image_period_s);
        let live = Live::new(bench.devices, writer, timing, interrupts()?, &mut operator, &mut hear)?;
        let mut live = live.expecting(&cell.display).recording(record(&cell));
        let outcome = setup.machine.clone().run(&mut live);
        let (outcome, path) = close(outcome, live)?;
        let needed = !self.rehearse && cameras::beside_the_cell(&cell).is_some();
        tell(&outcome.end, &path, needed.then_some(&*self.cell));
        say(&format!("recorded: {}", path.display()));
        if self.rehearse {
            return rehearsal::finish(&outcome, &plan, self.json, &steps.notes);
        }
        solve(&path, self.json, &steps.notes)
    }

    /// A session without a robot.
    fn by_hand(&self, cell: &Cell, texts: &CellTexts, run: &RunOptions, setup: &Setup) -> anyhow::Result<Exit> {
        let handheld::Held { frame, event, clock, rest } =
            handheld::open(&self.cell, cell, self.seed, self.time_scale)?;
        let (session_id, path) = self.name(cell, texts)?;
        let mut about = about(session_id, texts, "none: moved by hand", run, self.seed);
        about.facts.extend(cameras::facts(frame.as_deref(), event.as_deref()));
        let writer = Writer::create(&path, &about, &texts.attachments())?;
        let mut hear = |told: Told<'_>| handheld::hear(&told);
        let timing = (cell.images_per_pose, setup.image_period_s);
        let (devices, board) = ((frame, event, clock, rest), cell.board.clone());
        let mut live = HandheldLive::new(devices, board, writer, timing, interrupts()?, &mut hear)?;
        let outcome = setup.machine.clone().run(&mut live)?;
        let path = live.into_recording()?;
        SOLVING.store(true, Ordering::Relaxed);
        tell(&outcome.end, &path, None);
        say(&format!("recorded: {}", path.display()));
        solve(&path, self.json, &[])
    }

    fn refuse(&self, cell: &Cell, run: &RunOptions) -> Result<(), UsageError> {
        let armless = cell.robot.driver == RobotDriver::None;
        if armless && (self.rehearse || self.step || self.unattended || !self.sim_faults.is_empty()) {
            let why = "--rehearse, --step, --unattended and --sim-fault are for a cell with a robot";
            return Err(UsageError(format!("{}: {why}; this one has `robot: none`", self.cell.display())));
        }
        if !self.sim_faults.is_empty() && cell.robot.driver != RobotDriver::Sim {
            let why = "--sim-fault is for the simulated robot";
            return Err(UsageError(format!("{}: {why}", self.cell.display())));
        }
        refuse_unanswered(&self.cell, run, self.unattended)?;
        refuse_unwatched(&self.cell, cell, self.unattended)
    }

    /// The name of the session and of its file; two sessions within a second are told apart.
    fn name(&self, cell: &Cell, texts: &CellTexts) -> anyhow::Result<(String, PathBuf)> {
        let now = jiff::Timestamp::now();
        let folder = self.output.join(&cell.name);
        let what = if self.rehearse { "-rehearsal" } else { "" };
        let base = format!("{}{what}", now.strftime("%Y%m%dT%H%M%SZ"));
        let path = free_name(&folder, &base)?;
        let seed = format!("{}{}{}", texts.cell.1, now.as_nanosecond(), std::process::id());
        Ok((sha256(seed.as_bytes())[..16].to_owned(), path))
    }
}

/// Every move is to be confirmed, and nobody is there who could.
pub(super) fn refuse_unanswered(file: &Path, run: &RunOptions, unattended: bool) -> Result<(), UsageError> {
    if !run.confirm_each || (!unattended && std::io::stdin().is_terminal()) {
        return Ok(());
    }
    Err(UsageError(format!("{}: every move is to be confirmed, but stdin is no terminal", file.display())))
}

/// Nobody watches an unattended session, or a real arm without a terminal: then an input must release the cell.
pub(super) fn refuse_unwatched(file: &Path, cell: &Cell, unattended: bool) -> Result<(), UsageError> {
    let nobody = unattended || (cell.robot.driver == RobotDriver::Ur && !std::io::stdin().is_terminal());
    if !nobody || !cell.robot.interlocks.is_empty() {
        return Ok(());
    }
    let why =
        "robot.interlocks is missing: nobody watches this session, so an input must say that the cell is released";
    Err(UsageError(format!("{}: {why}", file.display())))
}

/// A name that no session in `folder` has.
pub(super) fn free_name(folder: &Path, base: &str) -> anyhow::Result<PathBuf> {
    let path_of = |suffix: &str| folder.join(format!("{base}{suffix}.mcap"));
    let free = |path: &PathBuf| !path.exists() && !path.with_extension("mcap.partial").exists();
    let mut candidates = std::iter::once(path_of("")).chain((2..1000).map(|n| path_of(&format!("-{n}"))));
    candidates.find(free).ok_or_else(|| anyhow::anyhow!("no free name in {}", folder.display()))
}

/// When the events of a cell are recorded.
pub(super) fn record(cell: &Cell) -> EventRecord {
    cell.event.as_ref().map(|event| event.record).unwrap_or_default()
}

/// Closes the recording; after an error the arm is stopped first.
pub(super) fn close(
    outcome: Result<Outcome, crate::runner::LiveError>,
    mut live: Live<'_>,
) -> anyhow::Result<(Outcome, PathBuf)> {
    match outcome {
        Ok(outcome) => {
            let path = live.into_recording()?;
            SOLVING.store(true, Ordering::Relaxed);
            Ok((outcome, path))
        }
        Err(error) => {
            let (path, stopped) = live.abandon();
            match stopped {
                Ok(()) => say("the arm is stopped"),
                Err(why) => say(&format!("the stop did not get through whole: {why}; look at the arm")),
            }
            say(&format!("what was logged is in {}; when the cause is mended: cellcal resume {0}", path.display()));
            Err(error.into())
        }
    }
}

/// Solves a closed recording, as a replay does.
pub(super) fn solve(path: &Path, json: bool, notes: &[String]) -> anyhow::Result<Exit> {
    let bar = Bar::new("looking at images");
    let solved = solve_recording(path, &mut |_| Ok(Vec::new()), None, &|done, total| bar.show(done, total))?;
    replay::finish(&solved, Some(&replay::folder_of(path)), json)?;
    let exit = exit::of_session(&solved, true);
    Ok(if !notes.is_empty() && exit == Exit::Ok { Exit::Warnings } else { exit })
}

fn attachments(texts: &CellTexts) -> Vec<Attachment> {
    let script = Attachment { name: "motion.script".into(), data: MOTION_SCRIPT.as_bytes().to_vec() };
    let mut all = texts.attachments();
    all.push(script);
    all
}

fn about(session_id: String, texts: &CellTexts, robot: &str, options: &RunOptions, seed: Option<u64>) -> About {
    let mut facts: std::collections::BTreeMap<_, _> = options.to_facts().collect();
    facts.insert("cell_sha256".into(), sha256(texts.cell.1.as_bytes()));
    facts.insert("texts_sha256".into(), texts.sha256());
    facts.insert("motion_script_sha256".into(), crate::devices::ur::script_sha256());
    facts.insert("robot".into(), robot.to_owned());
    facts.extend(seed.map(|seed| ("sim_seed".to_owned(), seed.to_string())));
    let program_version = env!("CARGO_PKG_VERSION").into();
    About { format_version: FORMAT_VERSION, kind: Kind::Live, session_id, program_version, facts }
}
