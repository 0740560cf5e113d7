//! What `run` and `resume` share: the devices of a cell, signals, the operator at the terminal, and how a
//! session is told.

use std::io::{BufRead as _, IsTerminal as _};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use super::cameras;
use super::exit::{ConnectError, UsageError};
use super::progress::say;
use crate::config::{Cell, EventDriver, FrameDriver, RobotDriver};
use crate::devices::sim::cell::{SimCell, SimStart};
use crate::devices::ur::{UrConfig, UrRobot};
use crate::devices::{Clock, WallClock};
use crate::plan::Plan;
use crate::runner::{Devices, Operator, RunOptions, Told};
use crate::session::{Command, End};

/// The devices of a cell, ready to be driven.
pub(super) struct Bench {
    pub(super) devices: Devices,
    /// What they are, for the log.
    pub(super) robot: String,
    /// Runs as long as this lives.
    _sim: Option<SimCell>,
}

/// Opens the devices that the cell names.
pub(super) fn open(
    file: &Path,
    cell: &Cell,
    run: &RunOptions,
    seed: Option<u64>,
    time_scale: Option<f64>,
    start: SimStart,
) -> anyhow::Result<Bench> {
    refuse_what_has_no_driver(file, cell, run)?;
    cameras::refuse_other_times(file, cell.rgb.as_ref().filter(|_| !run.rehearsal), time_scale)?;
    match cell.robot.driver {
        RobotDriver::Sim => {
            let sim = SimCell::start_at(cell, seed, time_scale.unwrap_or(1.0), start)?;
            let clock: Arc<dyn Clock> = Arc::new(sim.clock.clone());
            let frame = match &cell.rgb {
                Some(rgb) if rgb.driver != FrameDriver::Sim && !run.rehearsal => {
                    Some(sim.wire(cameras::open_frame(file, rgb, Arc::clone(&clock))?))
                }
                Some(_) | None => sim.frame().filter(|_| !run.rehearsal),
            };
            let event = match &cell.event {
                Some(event) if event.driver != EventDriver::Sim && !run.rehearsal => {
                    Some(cameras::open_event(file, event, Arc::clone(&clock))?)
                }
                Some(_) | None => sim.event().filter(|_| !run.rehearsal),
            };
            let devices = Devices { robot: sim.robot().map_err(ConnectError::of_sim)?, frame, event, clock };
            Ok(Bench { devices, robot: "simulated UR5e over RTDE and URScript".into(), _sim: Some(sim) })
        }
        RobotDriver::None => {
            Err(UsageError(format!("{}: it has `robot: none`, so nothing can move", file.display())).into())
        }
        RobotDriver::Ur => {
            if time_scale.is_some() {
                let why = "--time-scale is for the simulated robot; this cell has `driver: ur`";
                return Err(UsageError(format!("{}: {why}", file.display())).into());
            }
            let address = cell.robot.address.clone().unwrap_or_default();
            let clock: Arc<dyn Clock> = Arc::new(WallClock::starting_at(start.first));
            let config = UrConfig::of_cell(cell, &address);
            let rgb = cell.rgb.as_ref().filter(|_| !run.rehearsal);
            let frame = rgb.map(|rgb| cameras::open_frame(file, rgb, Arc::clone(&clock))).transpose()?;
            let event = cell.event.as_ref().filter(|_| !run.rehearsal);
            let event = event.map(|event| cameras::open_event(file, event, Arc::clone(&clock))).transpose()?;
            let robot = UrRobot::connect(&config, Arc::clone(&clock)).map_err(ConnectError)?;
            let devices = Devices { robot: Box::new(robot), frame, event, clock };
            Ok(Bench { devices, robot: "UR controller over RTDE and URScript".into(), _sim: None })
        }
    }
}

fn refuse_what_has_no_driver(file: &Path, cell: &Cell, run: &RunOptions) -> Result<(), UsageError> {
    if run.rehearsal {
        return Ok(());
    }
    let event = cell.event.as_ref().map(|c| c.driver);
    let simulated = cell.rgb.as_ref().is_some_and(|c| c.driver == FrameDriver::Sim) || event == Some(EventDriver::Sim);
    let why = if simulated && cell.robot.driver != RobotDriver::Sim {
        "a simulated camera sees the simulated arm only; give the driver of the real camera, or `--rehearse` to walk the poses without cameras"
    } else {
        return Ok(());
    };
    Err(UsageError(format!("{}: {why}", file.display())))
}

/// Nothing moves any more and the recording is closed: a signal may end the program at once.
pub(super) static SOLVING: AtomicBool = AtomicBool::new(false);

/// A flag that Ctrl-C and SIGTERM raise: the session stops the arm and ends.
pub(super) fn interrupts() -> anyhow::Result<&'static AtomicBool> {
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

/// Whoever sits at the terminal; without one every question is answered with no.
///
/// There is no option that answers for them: a schedule or a script cannot confirm motion.
#[derive(Default)]
pub(super) struct AtTerminal {
    answers: Option<Receiver<String>>,
    unattended: bool,
}

impl AtTerminal {
    pub(super) fn new(unattended: bool) -> Self {
        Self { answers: None, unattended }
    }

    fn nobody(&self) -> bool {
        self.unattended || !std::io::stdin().is_terminal()
    }
}

impl Operator for AtTerminal {
    fn ask(&mut self, question: &str) {
        if self.nobody() {
            return say(&format!("{question}? nobody can be asked: no"));
        }
        say(&format!("{question}? type `yes` to go on, anything else to end:"));
        if self.answers.is_none() {
            let (sender, answers) = channel();
            std::thread::spawn(move || {
                for line in std::io::stdin().lock().lines().map_while(Result::ok) {
                    if sender.send(line).is_err() {
                        return;
                    }
                }
            });
            self.answers = Some(answers);
        }
        // What was typed before the question is no answer to it.
        while self.answers.as_ref().is_some_and(|answers| answers.try_recv().is_ok()) {}
    }

    fn answer(&mut self) -> Option<bool> {
        if self.nobody() {
            return Some(false);
        }
        match self.answers.as_ref()?.try_recv() {
            Ok(line) => Some(line.trim() == "yes"),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(false),
        }
    }
}

/// Says how a session ended; `cell` is the file that a resumption must name.
pub(super) fn tell(end: &End, recording: &Path, cell: Option<&Path>) {
    match end {
        End::Complete => {}
        End::PreflightFailed(findings) => {
            say("pre-flight failed; the arm has not been moved:");
            findings.iter().for_each(|f| say(&format!("  {f}")));
        }
        End::OperatorNeeded(why) => {
            say(&format!("stopped, an operator is needed: {why}"));
            say("when the robot is safe and may move again:");
            let cell = cell.map(|cell| format!(" --cell {}", cell.display())).unwrap_or_default();
            say(&format!("  cellcal resume {}{cell}", recording.display()));
        }
        End::Aborted(why) => say(&format!("aborted: {why}")),
        End::Interrupted => say("interrupted; what was captured is kept"),
        End::Cut => say("the session ended early"),
    }
}

/// Says what the arm does, pose by pose.
pub(super) struct Steps<'a> {
    plan: &'a Plan,
    /// What went wrong at the end.
    pub(super) notes: Vec<String>,
}

impl<'a> Steps<'a> {
    pub(super) fn new(plan: &'a Plan) -> Self {
        say(&format!("{} poses, about {:.0} s of robot time", plan.poses.len(), plan.duration_s));
        Self { plan, notes: Vec::new() }
    }

    pub(super) fn hear(&mut self, told: Told<'_>) {
        let command = match told {
            Told::Command(command) => command,
            Told::Note(note) => {
                say(&format!("warning: {note}"));
                return self.notes.push(note);
            }
        };
        let total = self.plan.poses.len();
        let id = |pose: usize| self.plan.poses.get(pose).map_or("?", |p| p.id.as_str());
        match command {
            Command::Start => say("pre-flight passed"),
            Command::Watch => say("watching the display"),
            Command::Travel { why, .. } => say(&format!("moving {why}")),
            Command::Capture { pose, attempt: 0 } => {
                say(&format!("[{:>3}/{total}] {} still, capturing", pose + 1, id(*pose)));
            }
            Command::Capture { pose, attempt } => {
                say(&format!("[{:>3}/{total}] {} still again, capture {}", pose + 1, id(*pose), attempt + 1));
            }
            Command::Wait { pose, .. } => say(&format!("[{:>3}/{total}] {} disturbed, waiting", pose + 1, id(*pose))),
            Command::Stop { why } => say(&format!("stop: {why}")),
            Command::Move { .. } | Command::Confirm { .. } | Command::Finish { .. } | Command::Guide { .. } => {}
        }
    }
}
