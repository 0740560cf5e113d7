//! `cellcal run`: a session, from the cell file to the verdict.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Args;

use super::exit::{self, UsageError};
use super::progress::{Bar, say};
use super::{Exit, cell, replay};
use crate::config::{Cell, EventDriver, FrameDriver, RobotDriver};
use crate::devices::sim::cell::SimCell;
use crate::plan::Plan;
use crate::recording::{About, FORMAT_VERSION, Kind, Writer};
use crate::runner::setup::{CellTexts, Planned};
use crate::runner::solve::{sha256, solve_recording};
use crate::runner::{Devices, Live};
use crate::session::{Command, End};

/// Runs a session: moves the arm, captures, solves, judges.
#[derive(Debug, Args)]
pub(super) struct Run {
    /// The cell file.
    cell: PathBuf,
    /// Simulated seconds a real second, or `max`; only for a simulated robot.
    #[arg(long, value_parser = time_scale, default_value = "1")]
    time_scale: f64,
    /// Seed of the simulated cell, instead of the cell file's.
    #[arg(long)]
    seed: Option<u64>,
    /// Folder of the sessions.
    #[arg(short, long, default_value = "sessions")]
    output: PathBuf,
    /// Prints exactly the bytes of result.json.
    #[arg(long)]
    json: bool,
}

fn time_scale(text: &str) -> Result<f64, String> {
    let scale = if text == "max" { Ok(f64::INFINITY) } else { text.parse::<f64>() };
    match scale {
        Ok(scale) if scale >= 0.01 => Ok(scale),
        _ => Err(format!("`{text}` is no time scale; expected a number from 0.01, or `max`")),
    }
}

impl Run {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        let texts = cell::load(&self.cell)?;
        let Planned { cell, plan, setup } = texts.plan()?;
        self.refuse_what_has_no_driver(&cell)?;
        if let (_, Some(why)) = cell::observability_of(&cell, &plan) {
            return Err(UsageError(format!("{}: no motion: {why}", self.cell.display())).into());
        }
        for warning in &plan.warnings {
            say(&format!("warning: {warning}"));
        }
        let sim = SimCell::start(&cell, self.seed, self.time_scale)?;
        let (session_id, path) = self.name(&cell, &texts)?;
        let about = about(session_id, &texts);
        let devices =
            Devices { robot: sim.robot()?, frame: sim.frame(), event: sim.event(), clock: Arc::new(sim.clock.clone()) };
        let writer = Writer::create(&path, &about, &texts.attachments())?;
        let interrupted = interrupts()?;
        let timing = (cell.images_per_pose, setup.image_period_s);
        let mut steps = Steps::new(&plan);
        let mut hear = |command: &Command| steps.hear(command);
        let mut live = Live::new(devices, writer, timing, interrupted, &mut hear);
        let outcome = match setup.machine.clone().run(&mut live) {
            Ok(outcome) => outcome,
            Err(error) => {
                say(&format!("the arm is stopped; what was logged is in {}", live.abandon().display()));
                return Err(error.into());
            }
        };
        SOLVING.store(true, Ordering::Relaxed);
        let path = live.into_recording()?;
        drop(sim);
        tell(&outcome.end);
        say(&format!("recorded: {}", path.display()));
        let bar = Bar::new("looking at images");
        let solved = solve_recording(&path, &mut |_| Ok(Vec::new()), None, &|done, total| bar.show(done, total))?;
        replay::finish(&solved, Some(&replay::folder_of(&path)), self.json)?;
        Ok(exit::of_session(&solved, true))
    }

    /// The name of the session and of its file; two sessions within a second are told apart.
    fn name(&self, cell: &Cell, texts: &CellTexts) -> anyhow::Result<(String, PathBuf)> {
        let now = jiff::Timestamp::now();
        let folder = self.output.join(&cell.name);
        let base = now.strftime("%Y%m%dT%H%M%SZ").to_string();
        let path_of = |suffix: &str| folder.join(format!("{base}{suffix}.mcap"));
        let free = |path: &PathBuf| !path.exists() && !path.with_extension("mcap.partial").exists();
        let mut candidates = std::iter::once(path_of("")).chain((2..1000).map(|n| path_of(&format!("-{n}"))));
        let path = candidates.find(free).ok_or_else(|| anyhow::anyhow!("no free name in {}", folder.display()))?;
        let seed = format!("{}{}{}", texts.cell.1, now.as_nanosecond(), std::process::id());
        Ok((sha256(seed.as_bytes())[..16].to_owned(), path))
    }

    fn refuse_what_has_no_driver(&self, cell: &Cell) -> Result<(), UsageError> {
        if cell.robot.driver != RobotDriver::Sim {
            let scale = if self.time_scale == 1.0 { "" } else { "; and --time-scale is for the simulated robot only" };
            return Err(UsageError(format!(
                "{}: robot.driver `ur` needs the drivers of real cameras, which this version does not have yet; use `sim`{scale}",
                self.cell.display()
            )));
        }
        let frame = cell.rgb.as_ref().is_none_or(|c| c.driver == FrameDriver::Sim);
        let event = cell.event.as_ref().is_none_or(|c| c.driver == EventDriver::Sim);
        if frame && event {
            return Ok(());
        }
        Err(UsageError(format!(
            "{}: this version has no driver for real cameras yet; use `driver: sim`",
            self.cell.display()
        )))
    }
}

fn about(session_id: String, texts: &CellTexts) -> About {
    let mut facts = std::collections::BTreeMap::new();
    facts.insert("cell_sha256".into(), sha256(texts.cell.1.as_bytes()));
    facts.insert("robot".into(), "simulated UR5e over RTDE and URScript".into());
    let program_version = env!("CARGO_PKG_VERSION").into();
    About { format_version: FORMAT_VERSION, kind: Kind::Live, session_id, program_version, facts }
}

/// Nothing moves any more and the recording is closed: a signal may end the program at once.
static SOLVING: AtomicBool = AtomicBool::new(false);

/// A flag that Ctrl-C and SIGTERM raise: the session stops the arm and ends.
fn interrupts() -> anyhow::Result<&'static AtomicBool> {
    static RAISED: AtomicBool = AtomicBool::new(false);
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
    std::thread::spawn(move || {
        runtime.block_on(async {
            let Ok(mut terminate) = tokio::signal::unix::signal(tokio::signal::unix::SignalKind::terminate()) else {
                return;
            };
            let Ok(mut hang_up) = tokio::signal::unix::signal(tokio::signal::unix::SignalKind::hangup()) else {
                return;
            };
            loop {
                tokio::select! {
                    _ = tokio::signal::ctrl_c() => {}
                    _ = terminate.recv() => {}
                    // A lost connection of the operator must not leave the arm moving.
                    _ = hang_up.recv() => {}
                }
                if SOLVING.load(Ordering::Relaxed) {
                    std::process::exit(130);
                }
                RAISED.store(true, Ordering::Relaxed);
            }
        });
    });
    Ok(&RAISED)
}

fn tell(end: &End) {
    match end {
        End::Complete => {}
        End::PreflightFailed(findings) => {
            say("pre-flight failed; the arm has not been moved:");
            findings.iter().for_each(|f| say(&format!("  {f}")));
        }
        End::OperatorNeeded(why) => say(&format!("stopped, an operator is needed: {why}")),
        End::Aborted(why) => say(&format!("aborted: {why}")),
        End::Interrupted => say("interrupted; what was captured is kept"),
        End::Cut => say("the session ended early"),
    }
}

/// Says what the arm does, pose by pose.
struct Steps<'a> {
    plan: &'a Plan,
}

impl<'a> Steps<'a> {
    fn new(plan: &'a Plan) -> Self {
        say(&format!("{} poses, about {:.0} s of robot time", plan.poses.len(), plan.duration_s));
        Self { plan }
    }

    fn hear(&mut self, command: &Command) {
        let total = self.plan.poses.len();
        let id = |pose: usize| self.plan.poses.get(pose).map_or("?", |p| p.id.as_str());
        match command {
            Command::Move { .. } => {}
            Command::Capture { pose, attempt: 0 } => {
                say(&format!("[{:>3}/{total}] {} still, capturing", pose + 1, id(*pose)))
            }
            Command::Capture { pose, attempt } => {
                say(&format!("[{:>3}/{total}] {} still again, capture {}", pose + 1, id(*pose), attempt + 1));
            }
            Command::Wait { pose, .. } => say(&format!("[{:>3}/{total}] {} disturbed, waiting", pose + 1, id(*pose))),
            Command::Stop { why } => say(&format!("stop: {why}")),
            Command::Finish => {}
        }
    }
}
