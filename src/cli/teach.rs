//! `cellcal teach`: a trajectory, shown with the arm itself.
//!
//! The operator moves the arm (freedrive, or the pendant); the program only receives and never moves it. Every
//! pose is on the disk as soon as it is taken.

mod file;

use std::collections::BTreeMap;
use std::io::{BufRead as _, IsTerminal as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};

use super::exit::UsageError;
use super::progress::say;
use super::robot::{Address, load_cell, pose_words, preflight_findings, wall_clock};
use super::run::Run;
use super::session::interrupts;
use super::{Exit, read_text};
use crate::calibration::observability::{self, MAX_CONDITION, MIN_POSES, MIN_SECOND_EIGENVALUE};
use crate::calibration::settings::Carried;
use crate::config::Cell;
use crate::devices::ur::UrMonitor;
use crate::geometry::kinematics::{Arm, Joints};
use crate::geometry::{Base, Flange, Tcp, Transform};
use crate::plan::{Clearance, Refusal};
use crate::session::{Advice, Light, RobotSample, Stamp, Taken, TeachError, Teacher};

pub(super) use file::put;
use file::{Mode, TaughtFile};

/// Without a terminal, the longest wait for stillness, s.
const PATIENCE_S: f64 = 10.0;
/// Time between two looks of the status line, s.
const SHOW_S: f64 = 0.2;
/// What of pre-flight tells that poses are being taught on another arm or with another tool.
const WRONG_ROBOT: [&str; 4] = ["model", "serial", "tcp_offset", "kinematics_checksum"];

const KEYS: &str = "\
Enter or `t`  takes a pose, `t NAME` with a name    `l`  lists the poses    `w`  writes the file again
`u`           undoes the last pose                  `?`  shows this         `q`  writes and ends";

const HELP: &str = "\
Move the arm by hand: hold the freedrive button on the back of the pendant, or use its Freedrive. This program
never moves the arm and holds nothing. It shows `still` when a pose can be taken; type a line and press Enter:

  Enter or `t`  takes a pose, `t NAME` with a name
  `u`           undoes the last pose
  `l`           lists the poses
  `w`           writes the file again (it is written after every pose)
  `q`           writes and ends
  `?`           shows this

Where stdin is no terminal the same lines are read one by one: `t` waits up to 10 s until the arm is still, and
the first thing that goes wrong ends the program.
Exit codes: 0 done, 2 usage, 3 poses with warnings, 8 the arm cannot be taken as it stands, 130 interrupted.";

/// Teaches a trajectory: the operator moves the arm, the program takes poses.
#[derive(Debug, Args)]
#[command(after_help = HELP)]
pub(super) struct Teach {
    /// The cell file: its robot, limits, stillness and keep-out boxes.
    cell: PathBuf,
    /// The trajectory file to write.
    #[arg(short, long)]
    output: PathBuf,
    /// Name of the trajectory. Default: that of the file.
    #[arg(long)]
    name: Option<String>,
    /// Adds the poses to the file, in a segment of their own.
    #[arg(long, conflicts_with = "force")]
    append: bool,
    /// Replaces the file.
    #[arg(long)]
    force: bool,
    /// Takes nothing: drives slowly to the poses of the file, one by one, and asks before every move.
    #[arg(long, conflicts_with_all = ["append", "force", "name", "address", "rtde_port", "primary_port", "dashboard_port"])]
    verify: bool,
    #[command(flatten)]
    at: Address,
}

impl Teach {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        if self.verify {
            return Run::verify(self.cell, self.output).execute();
        }
        let cell = load_cell(&self.cell)?;
        let arm = arm_of(&self.cell, &cell)?;
        let mode = match (self.append, self.force) {
            (true, _) => Mode::Append,
            (false, true) => Mode::Replace,
            (false, false) => Mode::New,
        };
        let file = TaughtFile::open(&self.output, self.name.as_deref(), mode)?;
        let config = self.at.config(Some(&cell))?;
        let monitor = UrMonitor::connect(&config, wall_clock())?;
        let now = jiff::Timestamp::now().strftime("%Y-%m-%d %H:%M UTC").to_string();
        let scripted = !std::io::stdin().is_terminal();
        if !scripted {
            say("move the arm by hand: freedrive button or pendant; this program never moves it");
            say(KEYS);
        }
        Session::new(monitor, file, &cell, &arm, now, scripted).run(&lines_of_stdin(), interrupts()?)
    }
}

/// The model of the arm: the cell's URDF, or the nominal UR5e.
fn arm_of(file: &Path, cell: &Cell) -> anyhow::Result<Arm> {
    let Some(urdf) = &cell.robot.urdf else { return Ok(Arm::ur5e()) };
    let path = file.parent().unwrap_or(Path::new(".")).join(urdf);
    let arm = Arm::from_urdf(&read_text(&path)?);
    Ok(arm.map_err(|why| UsageError(format!("{}: {why}", path.display())))?)
}

/// Lines as they are typed; the channel closes where stdin ends.
fn lines_of_stdin() -> Receiver<String> {
    let (sender, lines) = channel();
    std::thread::spawn(move || {
        let mut stdin = std::io::stdin().lock();
        let mut line = Vec::new();
        while matches!(stdin.read_until(b'\n', &mut line), Ok(count) if count > 0) {
            if sender.send(String::from_utf8_lossy(&line).into_owned()).is_err() {
                return;
            }
            line.clear();
        }
    });
    lines
}

/// What a line asks for.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Order {
    Take(Option<String>),
    Undo,
    List,
    Write,
    Quit,
    Help,
}

impl Order {
    fn from_line(line: &str) -> Result<Self, String> {
        let words: Vec<_> = line.split_whitespace().collect();
        match words[..] {
            [] | ["t"] => Ok(Self::Take(None)),
            ["t", name] => Ok(Self::Take(Some(name.to_owned()))),
            ["t", ..] => Err("a name has no spaces: use letters, digits, - and _".into()),
            ["u"] => Ok(Self::Undo),
            ["l"] => Ok(Self::List),
            ["w"] => Ok(Self::Write),
            ["q"] => Ok(Self::Quit),
            ["?"] => Ok(Self::Help),
            _ => Err(format!("{:?} is no order: t, u, l, w, q or ?", line.trim())),
        }
    }
}

/// A pose that is wanted as soon as the arm is still.
#[derive(Debug)]
struct Waiting {
    name: Option<String>,
    since: Stamp,
}

/// One sitting at the robot.
struct Session<'a> {
    monitor: UrMonitor,
    teacher: Teacher,
    file: TaughtFile,
    cell: &'a Cell,
    clearance: Clearance,
    /// When, for the file.
    began: String,
    /// Nobody is there to try again: `t` waits, and the first mistake is the end.
    scripted: bool,
    /// Longest wait for stillness, s.
    patience_s: f64,
    waiting: Option<Waiting>,
    /// What was said against poses, by name.
    doubts: BTreeMap<String, Vec<String>>,
    /// The file is not what was taught: it could not be written.
    unwritten: bool,
    status: ProgressBar,
    shown: Option<Stamp>,
}

impl<'a> Session<'a> {
    fn new(monitor: UrMonitor, file: TaughtFile, cell: &'a Cell, arm: &'a Arm, began: String, scripted: bool) -> Self {
        let of_arm = || std::array::from_fn(|i| arm.joints[i].limits_rad);
        let limits_rad = cell.robot.limits.joints_rad.unwrap_or_else(of_arm);
        let teacher = Teacher::new(cell.robot.stillness.clone(), limits_rad, file.ids());
        let status = if scripted { ProgressBar::hidden() } else { ProgressBar::new_spinner() };
        if let Ok(style) = ProgressStyle::with_template("{wide_msg}") {
            status.set_style(style);
        }
        let clearance = Clearance::of(cell, arm);
        let (waiting, doubts, patience_s) = (None, BTreeMap::new(), PATIENCE_S);
        let (unwritten, shown) = (false, None);
        Self {
            monitor,
            teacher,
            file,
            cell,
            clearance,
            began,
            scripted,
            patience_s,
            waiting,
            doubts,
            unwritten,
            status,
            shown,
        }
    }

    /// Until `q`, the end of the lines, a signal, or something that cannot be mended.
    fn run(mut self, lines: &Receiver<String>, interrupted: &AtomicBool) -> anyhow::Result<Exit> {
        let ended = self.listen(lines, interrupted);
        self.status.finish_and_clear();
        let taken = self.teacher.poses().len();
        let path = self.file.path().display();
        match (taken, self.unwritten) {
            (0, false) => say("no pose was taken, no file written"),
            (1, false) => say(&format!("the pose is in {path}")),
            (_, false) => say(&format!("the {taken} poses are in {path}")),
            (_, true) => say(&format!("warning: {path} is not up to date")),
        }
        ended
    }

    fn listen(&mut self, lines: &Receiver<String>, interrupted: &AtomicBool) -> anyhow::Result<Exit> {
        let mut first = true;
        while !interrupted.load(Ordering::Relaxed) {
            let (at, sample) = self.monitor.next_sample()?;
            if std::mem::take(&mut first) {
                self.warn_of_wrong_robot(&sample);
            }
            self.teacher.sample(at, &sample);
            self.show(at, &sample);
            let ended = match self.waiting.take() {
                Some(waiting) => self.wait(at, &sample, waiting)?,
                None => match lines.try_recv() {
                    Ok(line) => self.order(at, &sample, &line)?,
                    Err(TryRecvError::Empty) => None,
                    Err(TryRecvError::Disconnected) => Some(self.quit()?),
                },
            };
            if let Some(exit) = ended {
                return Ok(exit);
            }
        }
        Ok(Exit::Interrupted)
    }

    fn order(&mut self, at: Stamp, sample: &RobotSample, line: &str) -> anyhow::Result<Option<Exit>> {
        match Order::from_line(line) {
            Ok(Order::Take(name)) if self.scripted => self.waiting = Some(Waiting { name, since: at }),
            Ok(Order::Take(name)) => return self.take(sample, name.as_deref()),
            Ok(Order::Undo) => self.undo()?,
            Ok(Order::List) => self.list(),
            Ok(Order::Write) => {
                self.write()?;
                self.say(&format!("written: {}", self.file.path().display()));
            }
            Ok(Order::Quit) => return self.quit().map(Some),
            Ok(Order::Help) => self.say(KEYS),
            Err(why) if self.scripted => return Err(UsageError(why).into()),
            Err(why) => self.say(&why),
        }
        Ok(None)
    }

    /// Takes the pose that is waited for, once the arm is still.
    fn wait(&mut self, at: Stamp, sample: &RobotSample, waiting: Waiting) -> anyhow::Result<Option<Exit>> {
        let late = at.seconds() - waiting.since.seconds() > self.patience_s;
        if late || self.teacher.light() == Light::Still {
            return self.take(sample, waiting.name.as_deref());
        }
        self.waiting = Some(waiting);
        Ok(None)
    }

    fn take(&mut self, sample: &RobotSample, name: Option<&str>) -> anyhow::Result<Option<Exit>> {
        let (carried, clearance) = (self.cell.carried, &self.clearance);
        let is_clear = |joints: &Joints| is_clear(clearance, joints);
        let hint = |poses: &[Transform<Base, Tcp>]| Some(hint(carried, poses));
        match self.teacher.take(name, Advice { is_clear: &is_clear, hint: &hint }) {
            Ok(taken) => self.keep(sample, taken).map(|()| None),
            Err(error @ (TeachError::Name { .. } | TeachError::Doubled { .. })) if self.scripted => {
                Err(UsageError(error.to_string()).into())
            }
            Err(error) => {
                self.say(&format!("not taken: {error}"));
                Ok(self.scripted.then_some(Exit::OperatorNeeded))
            }
        }
    }

    fn keep(&mut self, sample: &RobotSample, taken: Taken) -> anyhow::Result<()> {
        let Taken { pose, warnings, hint } = taken;
        self.file.describe(self.header(sample));
        self.write()?;
        self.say(&format!(
            "{}: `{}`, TCP at {}",
            self.teacher.poses().len(),
            pose.name,
            pose_words(&pose.base_from_tcp)
        ));
        warnings.iter().for_each(|w| self.say(&format!("  warning: {w}")));
        hint.iter().for_each(|h| self.say(&format!("  hint: {h}")));
        if !warnings.is_empty() {
            self.doubts.insert(pose.name, warnings);
        }
        Ok(())
    }

    fn header(&self, sample: &RobotSample) -> Vec<String> {
        let facts = self.monitor.facts(None);
        let version = facts.controller_version.map(|n| n.to_string()).join(".");
        let serial = facts.serial.as_deref().unwrap_or("not told");
        let tcp_offset = Transform::<Flange, Tcp>::from_pose_vector(sample.tcp_offset);
        vec![
            format!("Taught by hand in the cell {} on {}.", self.cell.name, self.began),
            format!("Controller {version}, serial {serial}; TCP at {} in the flange.", pose_words(&tcp_offset)),
        ]
    }

    /// Puts what has been taught onto the disk. With somebody there, a disk that is full is no end.
    fn write(&mut self) -> anyhow::Result<()> {
        let written = self.file.write(self.teacher.poses());
        self.unwritten = written.is_err();
        match written {
            Err(error) if !self.scripted => {
                self.say(&format!("error: {error:#}; the poses are kept in memory, `w` tries again"));
                Ok(())
            }
            other => other,
        }
    }

    fn undo(&mut self) -> anyhow::Result<()> {
        let Some(pose) = self.teacher.undo() else {
            self.say("there is no pose to undo");
            return Ok(());
        };
        self.doubts.remove(&pose.name);
        self.write()?;
        self.say(&format!("forgotten: `{}`", pose.name));
        Ok(())
    }

    fn list(&self) {
        for (i, pose) in self.teacher.poses().iter().enumerate() {
            let degrees = pose.joints_rad.map(|q| format!("{:.3}", q.to_degrees())).join(", ");
            self.say(&format!("{}: `{}`, joints ({degrees}) deg", i + 1, pose.name));
            let doubts = self.doubts.get(&pose.name).into_iter().flatten();
            doubts.for_each(|w| self.say(&format!("  warning: {w}")));
        }
        if self.teacher.poses().is_empty() {
            self.say("no pose yet");
        }
    }

    fn quit(&mut self) -> anyhow::Result<Exit> {
        if self.unwritten {
            self.file.write(self.teacher.poses())?;
            self.unwritten = false;
        }
        Ok(if self.doubts.is_empty() { Exit::Ok } else { Exit::Warnings })
    }

    fn warn_of_wrong_robot(&self, sample: &RobotSample) {
        let found = preflight_findings(self.cell, &self.monitor.facts(None), sample);
        // The kinematics are not read here.
        let told = |id: &str| WRONG_ROBOT.contains(&id) && id != "kinematics_checksum";
        found.iter().filter(|f| told(&f.id)).for_each(|f| self.say(&format!("warning: {f}")));
    }

    fn show(&mut self, at: Stamp, sample: &RobotSample) {
        let due = self.shown.is_none_or(|last| at.seconds() - last.seconds() >= SHOW_S);
        if due && !self.status.is_hidden() {
            self.shown = Some(at);
            self.status.set_message(status_line(&self.teacher.light(), sample, self.teacher.poses().len()));
        }
    }

    /// Says a line above the status line.
    fn say(&self, line: &str) {
        self.status.suspend(|| say(line));
    }
}

/// `still, 3 poses | joints ... deg | TCP ... mm ... deg`, the most important first: what does not fit is cut.
fn status_line(light: &Light, sample: &RobotSample, poses: usize) -> String {
    let light = match light {
        Light::Moving { .. } => "moving".to_owned(),
        Light::Settling { still_s, of_s, .. } => format!("settling {still_s:.2} of {of_s:.2} s"),
        Light::Still => "STILL".to_owned(),
    };
    // Adding 0 turns -0 into 0.
    let tenth = |v: f64| format!("{:.1}", (v * 10.0).round() / 10.0 + 0.0);
    let joints = sample.joints_rad.map(|q| tenth(q.to_degrees())).join(" ");
    let pose = sample.base_from_tcp();
    let xyz = pose.translation_m().map(|v| tenth(v * 1e3)).join(" ");
    let turn = pose.rotation_vector_rad().map(|v| tenth(v.to_degrees())).join(" ");
    format!("{light:<22} {poses} poses | joints {joints} deg | TCP {xyz} mm, {turn} deg")
}

/// What the poses so far can tell about the camera, and what to add.
fn hint(carried: Carried, poses: &[Transform<Base, Tcp>]) -> String {
    if poses.len() < MIN_POSES {
        return format!("hand-eye needs at least {MIN_POSES} poses, better 10 or more");
    }
    let found = match carried {
        Carried::Target => observability::carried_target(poses),
        Carried::Cameras => observability::carried_cameras(poses),
    };
    match found.and_then(|o| o.check().map(|()| o)) {
        Err(why) => why.to_string(),
        Ok(o) => format!(
            "enough for hand-eye: second eigenvalue {:.3} (at least {MIN_SECOND_EIGENVALUE}), condition {:.1} (at most {MAX_CONDITION})",
            o.second_eigenvalue, o.condition
        ),
    }
}

/// Whether arm, tool and load keep off the keep-out boxes; joint limits are the [`Teacher`]'s to tell.
fn is_clear(clearance: &Clearance, joints: &Joints) -> Result<(), String> {
    match clearance.at(joints) {
        Ok(()) | Err(Refusal::JointLimit { .. }) => Ok(()),
        Err(Refusal::KeepOut { name, part, gap_m, .. }) if gap_m > 0.0 => {
            Err(format!("the {part} is only {:.1} mm from the keep-out box `{name}`; it will be refused", gap_m * 1e3))
        }
        Err(Refusal::KeepOut { name, part, .. }) => {
            Err(format!("the {part} is inside the keep-out box `{name}`; it will be refused"))
        }
        Err(other) => Err(format!("it {other}")),
    }
}

#[cfg(test)]
mod tests;
