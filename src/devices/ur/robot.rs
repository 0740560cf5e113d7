//! The driver itself.

use std::sync::Arc;
use std::time::Duration;

use tokio::runtime::Runtime;

use super::config::UrConfig;
use super::connection::{Connection, Field, event_loop};
use super::dashboard::RobotInfo;
use super::external::Handshake;
use super::fields::{INPUTS, Order};
use super::lines::Lines;
use super::primary;
use super::samples::{Fresh, Freshness, next_sample};
use super::script::{MOTION_SCRIPT, STOP_SCRIPT, ScriptPort};
use super::supervisor::Supervisor;
use crate::config::{Line, MotionBy};
use crate::devices::rtde::{ControllerVersion, DataType, TextMessage, Value};
use crate::devices::{Clock, Robot, RobotError};
use crate::session::{ExecutorState, Kinematics, MoveTarget, RobotFacts, RobotSample, Stamp};

const STOPPED: u32 = 1;
const PLAYING: u32 = 2;

/// How often a controller that is still busy is tried, and the real time in between. An executor whose
/// client died is stopped by its watchdog within 0.15 s.
const TRIES: usize = 5;
const BETWEEN_TRIES: Duration = Duration::from_millis(200);

/// Our script says within this time that it has read a heartbeat, but while it moves, s.
const ECHO_WITHIN_S: f64 = 0.25;

/// A trigger pulse lasts this long, s.
const PULSE_S: f64 = 0.02;

/// Session time in which a program of the plant leaves its last pose.
const LEAVE_WITHIN_S: f64 = 5.0;

/// A Universal Robots arm, moved by our script or by a program of the plant.
///
/// Owns an event loop: must not be used from async code. [`Robot::start_move`] only prepares the
/// command; it leaves with the next [`Robot::heartbeat`], in the same package.
pub struct UrRobot {
    config: UrConfig,
    clock: Arc<dyn Clock>,
    runtime: Runtime,
    connection: Connection,
    supervisor: Supervisor,
    info: RobotInfo,
    kinematics: Option<Kinematics>,
    freshness: Freshness,
    lines: Lines,
    pulse_since: Option<Stamp>,
    heartbeat: i32,
    /// The last sample showed a program that is not ours.
    foreign_program: bool,
    last_sequence: i32,
    last_runtime: u32,
    motion: Motion,
}

/// Who moves the arm.
enum Motion {
    Script(Script),
    External { handshake: Handshake, captured: Line },
}

struct Script {
    port: ScriptPort,
    order: Order,
    phase: Phase,
    /// Exceptions that the controller had told of before the upload.
    exceptions: usize,
}

/// How far the script has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// It is not on the controller.
    Absent,
    /// Its first sequence number leaves with the next heartbeat.
    Announced,
    /// The number is in place before the script reads it; the script leaves with the next heartbeat.
    Placed,
    /// It has been sent, and has not answered yet.
    Sent,
    /// It has answered.
    Running,
    /// Another program runs in its place: not ours to feed, nor to stop.
    Replaced,
    /// No heartbeats any more: the stop could not be delivered, the watchdog has to stop the arm.
    Withheld,
}

impl std::fmt::Debug for UrRobot {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("UrRobot").field("config", &self.config).field("info", &self.info).finish_non_exhaustive()
    }
}

impl UrRobot {
    /// Connects, and asks the controller to describe itself. Nothing is started, nothing moves.
    pub fn connect(config: &UrConfig, clock: Arc<dyn Clock>) -> Result<Self, RobotError> {
        let runtime = event_loop(config)?;
        let (extra, lines) = (extra_outputs(config), lines(config));
        let mut inputs: Vec<Field> = Vec::new();
        if config.motion == MotionBy::Script {
            inputs.extend(INPUTS.iter().map(|(name, t)| ((*name).to_owned(), *t)));
        }
        inputs.extend(lines.fields());
        // Everything that may take its time comes before the first sample.
        let version = runtime.block_on(Connection::open(config, &[], &[]))?.version();
        let supervisor = Supervisor::of(version);
        let info = runtime.block_on(supervisor.info(config));
        let kinematics = runtime.block_on(primary::kinematics(config)).ok();
        let motion = match &config.motion {
            MotionBy::Script => {
                let port = runtime.block_on(ScriptPort::open(config))?;
                Motion::Script(Script { port, order: Order::none(0), phase: Phase::Absent, exceptions: 0 })
            }
            MotionBy::External(external) => {
                Motion::External { handshake: Handshake::new(external), captured: external.captured }
            }
        };
        let opened = runtime.block_on(open_when_free(config, &*clock, &extra, &inputs))?;
        let Opened { connection, freshness, sample } = opened;
        let mut robot = Self {
            config: config.clone(),
            clock,
            runtime,
            connection,
            supervisor,
            info,
            kinematics,
            freshness,
            lines,
            heartbeat: 0,
            pulse_since: None,
            foreign_program: sample.runtime_state == PLAYING && config.motion == MotionBy::Script,
            last_sequence: sample.executor_sequence,
            last_runtime: sample.runtime_state,
            motion,
        };
        // The first sample has been judged here.
        robot.heartbeat()?;
        Ok(robot)
    }

    /// Version of the controller, by RTDE.
    pub fn controller_version(&self) -> ControllerVersion {
        self.connection.version()
    }

    /// The robot as its dashboard described it at the start.
    pub fn robot_info(&self) -> &RobotInfo {
        &self.info
    }

    /// What the controller has said in words since the last call, at most the last 50.
    pub fn take_texts(&mut self) -> Vec<TextMessage> {
        self.connection.take_texts()
    }

    /// Runs until a sample shows what is waited for, at most `within_s` of session time.
    fn wait_for(&mut self, what: &str, within_s: f64, done: impl Fn(&RobotSample) -> bool) -> Result<(), RobotError> {
        let began = self.clock.now();
        loop {
            self.heartbeat()?;
            let (at, sample) = self.next_sample()?;
            if done(&sample) {
                return self.heartbeat();
            }
            let waited_s = at.seconds() - began.seconds();
            let patient = waited_s < within_s;
            if !patient {
                let why = format!("not there after {waited_s:.1} s, runtime state {}", sample.runtime_state);
                return Err(self.connection.refused(what, &why));
            }
        }
    }

    /// Ends a trigger pulse that has been on for long enough.
    fn advance_pulse(&mut self) {
        let Some(since) = self.pulse_since else { return };
        let lasted_s = self.clock.now().seconds() - since.seconds();
        let short = lasted_s < PULSE_S;
        if !short {
            self.end_pulse();
        }
    }

    fn end_pulse(&mut self) {
        self.pulse_since = None;
        if let Some(line) = self.config.trigger {
            self.lines.set(line, false);
        }
    }

    fn set_calibrating(&mut self, on: bool) {
        if let Some(line) = self.config.calibrating {
            self.lines.set(line, on);
        }
    }

    /// Brings the script to the controller in two steps, one a heartbeat.
    fn advance_upload(&mut self) -> Result<(), RobotError> {
        let Motion::Script(script) = &mut self.motion else { return Ok(()) };
        match script.phase {
            Phase::Announced => script.phase = Phase::Placed,
            Phase::Placed => {
                (script.phase, script.exceptions) = (Phase::Sent, self.connection.exceptions());
                self.runtime.block_on(script.port.upload(MOTION_SCRIPT, &self.config))?;
            }
            Phase::Absent | Phase::Sent | Phase::Running | Phase::Replaced | Phase::Withheld => {}
        }
        Ok(())
    }

    /// Puts into a sample what is known about the program that moves the arm.
    fn judge(&mut self, sample: &mut RobotSample, echo: i32, extra: &[Value]) -> Result<(), RobotError> {
        (self.last_sequence, self.last_runtime) = (sample.executor_sequence, sample.runtime_state);
        self.foreign_program = false;
        match &mut self.motion {
            Motion::External { handshake, captured } => {
                handshake.judge(sample, extra);
                self.lines.set(*captured, handshake.captured());
            }
            Motion::Script(script) => {
                let playing = sample.runtime_state == PLAYING;
                match script.phase {
                    Phase::Absent | Phase::Announced | Phase::Placed => self.foreign_program = playing,
                    Phase::Sent if self.connection.exceptions() > script.exceptions => {
                        return Err(self.connection.refused("the motion script", "it does not run"));
                    }
                    Phase::Sent => {
                        let ours = sample.executor_sequence == script.order.sequence;
                        if playing && ours && sample.executor_state == ExecutorState::Idle {
                            script.phase = Phase::Running;
                        }
                    }
                    Phase::Running => {
                        // While it moves it reads nothing; the session's deadline watches the move.
                        let waits = !matches!(sample.executor_state, ExecutorState::Moving | ExecutorState::Absent);
                        let age_s = f64::from(self.heartbeat.wrapping_sub(echo)) / self.config.frequency_hz;
                        let answers = (0.0..=ECHO_WITHIN_S).contains(&age_s);
                        if playing && waits && !answers {
                            script.phase = Phase::Replaced;
                            let why = "another program runs in its place, or it hangs".into();
                            return Err(RobotError::Refused { what: "the motion script".into(), why });
                        }
                    }
                    Phase::Replaced | Phase::Withheld => {}
                }
                if !matches!(script.phase, Phase::Running | Phase::Withheld) {
                    // What the registers hold now is not from this session.
                    sample.executor_state = ExecutorState::Absent;
                }
            }
        }
        Ok(())
    }

    fn finish_script(&mut self) -> Result<(), RobotError> {
        let what = "the end of the motion script";
        let within_s = self.config.program_within.as_secs_f64();
        let Motion::Script(script) = &mut self.motion else { return Ok(()) };
        match script.phase {
            // Nothing has been sent: what runs, if anything, is not ours.
            Phase::Absent | Phase::Announced | Phase::Placed | Phase::Replaced | Phase::Withheld => return Ok(()),
            // It may be on its way: nothing less than a stop is sure.
            Phase::Sent => return self.stop(),
            Phase::Running => {}
        }
        script.order = Order::end(next_sequence(script.order.sequence));
        if self.wait_for(what, within_s, |s| s.runtime_state == STOPPED).is_ok() {
            return Ok(());
        }
        self.stop()?;
        self.wait_for(what, within_s, |s| s.runtime_state == STOPPED)
    }

    fn finish_external(&mut self) -> Result<(), RobotError> {
        let Motion::External { handshake, .. } = &mut self.motion else { return Ok(()) };
        if !handshake.has_begun() {
            return Ok(());
        }
        handshake.next();
        let began = self.clock.now();
        loop {
            self.heartbeat()?;
            let (at, _) = self.next_sample()?;
            if matches!(&self.motion, Motion::External { handshake, .. } if !handshake.captured()) {
                // It has left: one more package takes `captured` back.
                return self.heartbeat();
            }
            let patient = at.seconds() - began.seconds() < LEAVE_WITHIN_S;
            if !patient {
                let why = format!("it has not left the last pose within {LEAVE_WITHIN_S} s");
                return Err(RobotError::Refused { what: "the end of the program of the plant".into(), why });
            }
        }
    }
}

impl Robot for UrRobot {
    fn facts(&self) -> RobotFacts {
        let ControllerVersion { major, minor, bugfix, build } = self.connection.version();
        let (motion, script_sha256) = match self.motion {
            Motion::Script(_) => ("cellcal motion script".to_owned(), super::script_sha256()),
            Motion::External { .. } => ("a program of the plant".to_owned(), String::new()),
        };
        RobotFacts {
            controller_version: [major, minor, bugfix, build],
            model: self.info.model.clone(),
            serial: self.info.serial.clone(),
            remote_control: self.info.remote_control,
            kinematics: self.kinematics.clone(),
            motion,
            script_sha256,
        }
    }

    fn next_sample(&mut self) -> Result<(Stamp, RobotSample), RobotError> {
        let Self { runtime, connection, freshness, clock, config, .. } = self;
        let fresh = runtime.block_on(next_sample(connection, freshness, &**clock, config))?;
        let Fresh { at, mut sample, echo, extra } = fresh;
        self.judge(&mut sample, echo, &extra)?;
        Ok((at, sample))
    }

    fn start_program(&mut self) -> Result<(), RobotError> {
        if let Motion::Script(script) = &mut self.motion {
            script.order = Order::none(next_sequence(self.last_sequence));
            script.phase = Phase::Announced;
        }
        Ok(())
    }

    fn start_move(&mut self, target: &MoveTarget) -> Result<i32, RobotError> {
        self.set_calibrating(true);
        match &mut self.motion {
            Motion::External { handshake, .. } => Ok(handshake.next()),
            Motion::Script(script) => {
                self.config.caps.check(target)?;
                script.order = Order::move_to(next_sequence(script.order.sequence), target);
                Ok(script.order.sequence)
            }
        }
    }

    fn heartbeat(&mut self) -> Result<(), RobotError> {
        if self.foreign_program {
            // It may be an executor whose client died: its watchdog must not be fed.
            return Ok(());
        }
        self.advance_upload()?;
        self.advance_pulse();
        let lines = self.lines.values();
        let values = match &self.motion {
            Motion::Script(script) if matches!(script.phase, Phase::Replaced | Phase::Withheld) => return Ok(()),
            Motion::Script(script) => {
                self.heartbeat = self.heartbeat.wrapping_add(1);
                [script.order.values(self.heartbeat), lines].concat()
            }
            Motion::External { .. } => lines,
        };
        self.runtime.block_on(self.connection.send_inputs(&values, self.config.stale_after))
    }

    fn pulse(&mut self) -> Result<(), RobotError> {
        let Some(line) = self.config.trigger else {
            let why = "the cell names no output for it (rgb.trigger)".into();
            return Err(RobotError::Refused { what: "a trigger pulse".into(), why });
        };
        self.lines.set(line, true);
        self.pulse_since = Some(self.clock.now());
        Ok(())
    }

    /// Uploads a program that stops the arm: it replaces whatever runs, also in the middle of a move.
    ///
    /// Where it cannot be delivered, heartbeats cease as well, and the controller's watchdog stops the arm.
    fn stop(&mut self) -> Result<(), RobotError> {
        self.set_calibrating(false);
        self.end_pulse();
        let Self { runtime, motion, config, supervisor, connection, lines, .. } = self;
        let Motion::Script(script) = motion else {
            let stopped = runtime.block_on(supervisor.stop_program(config));
            // Outputs keep their values: the last package takes ours back.
            let told = runtime.block_on(connection.send_inputs(&lines.values(), config.stale_after));
            return stopped.and(told);
        };
        if matches!(script.phase, Phase::Absent | Phase::Announced | Phase::Placed) {
            return Ok(());
        }
        script.order = Order::none(script.order.sequence);
        let ours = script.phase != Phase::Replaced;
        let stopped = runtime.block_on(async {
            if ours && script.port.upload(STOP_SCRIPT, config).await.is_err() {
                script.port = ScriptPort::open(config).await?;
                script.port.upload(STOP_SCRIPT, config).await?;
            }
            Ok(())
        });
        if stopped.is_err() {
            script.phase = Phase::Withheld;
            return stopped;
        }
        // The same heartbeat again: it takes the outputs back and feeds nobody anew.
        let values = [script.order.values(self.heartbeat), lines.values()].concat();
        let told = runtime.block_on(connection.send_inputs(&values, config.stale_after));
        // A paused program takes no script and would go on with its move when somebody presses play.
        let paused = ours && ![STOPPED, PLAYING].contains(&self.last_runtime);
        let ended = if paused { runtime.block_on(supervisor.stop_program(config)) } else { Ok(()) };
        ended.and(told)
    }

    /// Asks the program to end, and stops it where it does not within `program_within`; then loads the next.
    fn finish(&mut self, load: Option<&str>) -> Result<(), RobotError> {
        self.set_calibrating(false);
        self.end_pulse();
        match self.motion {
            Motion::Script(_) => self.finish_script()?,
            Motion::External { .. } => self.finish_external()?,
        }
        let Self { runtime, supervisor, config, .. } = self;
        load.map_or(Ok(()), |program| runtime.block_on(supervisor.load(config, program)))
    }
}

/// Sequence numbers are positive and wrap; 0 is what registers hold after power-on.
fn next_sequence(last: i32) -> i32 {
    last.checked_add(1).filter(|next| *next > 0).unwrap_or(1)
}

/// What is asked of the controller beside the usual fields.
fn extra_outputs(config: &UrConfig) -> Vec<Field> {
    match &config.motion {
        MotionBy::External(external) => match external.at_pose {
            Line::BitRegister(number) => vec![(format!("output_bit_register_{number}"), DataType::Bool)],
            Line::DigitalOutput(_) => Vec::new(),
        },
        MotionBy::Script => Vec::new(),
    }
}

/// The bits that we set.
fn lines(config: &UrConfig) -> Lines {
    let captured = match &config.motion {
        MotionBy::External(external) => Some(external.captured),
        MotionBy::Script => None,
    };
    Lines::new(config.calibrating.into_iter().chain(captured).chain(config.trigger))
}

/// A started connection and its first sample.
struct Opened {
    connection: Connection,
    freshness: Freshness,
    sample: RobotSample,
}

/// Connects, and tries again while a program runs: perhaps an executor whose client has just died.
async fn open_when_free(
    config: &UrConfig,
    clock: &dyn Clock,
    extra: &[Field],
    inputs: &[Field],
) -> Result<Opened, RobotError> {
    let mut tries = 1;
    loop {
        let mut connection = Connection::open(config, extra, inputs).await?;
        connection.start().await?;
        let mut freshness = Freshness::default();
        let Fresh { sample, .. } = next_sample(&mut connection, &mut freshness, clock, config).await?;
        let busy = sample.runtime_state == PLAYING && config.motion == MotionBy::Script;
        // Pre-flight names a program that stays.
        if !busy || tries >= TRIES {
            return Ok(Opened { connection, freshness, sample });
        }
        tries += 1;
        // Without a connection nothing feeds the watchdog of that program.
        drop(connection);
        tokio::time::sleep(BETWEEN_TRIES).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sequence_numbers_stay_positive() {
        assert_eq!(next_sequence(0), 1);
        assert_eq!(next_sequence(i32::MAX), 1);
        assert_eq!(next_sequence(-7), 1);
    }
}
