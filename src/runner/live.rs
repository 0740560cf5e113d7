//! The world of a live session: devices on one side, the recording on the other.
//!
//! Inputs are logged before they are judged, commands before they are carried out. The heartbeat that
//! keeps the arm moving is sent only when the loop comes back for the next input, so a hung loop stops it.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::World;
use super::capture::Cameras;
use crate::config::{DisplayCell, EventRecord};
use crate::cv::codec;
use crate::devices::{Clock, EventCamera, FrameCamera, Robot, RobotError};
use crate::events::blink::ExpectedBlink;
use crate::recording::{Background, RecordingError, Writer};
use crate::session::{Command, Input, Stamp};

/// Why a live session cannot go on; what the robot or the cameras do is an input, not an error.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The log cannot be written: nothing may happen that is not logged.
    #[error("the session cannot be logged: {0}")]
    Recording(RecordingError),
}

/// Its words are in ours: it is no further cause.
impl From<RecordingError> for LiveError {
    fn from(error: RecordingError) -> Self {
        Self::Recording(error)
    }
}

/// Whoever can answer a question while the arm is held.
pub trait Operator {
    /// Asks; the answer comes later.
    fn ask(&mut self, question: &str);
    /// The answer, once there is one.
    fn answer(&mut self) -> Option<bool>;
}

/// Nobody is there: every question is answered with no.
#[derive(Debug, Default)]
pub struct Nobody;

impl Operator for Nobody {
    fn ask(&mut self, _question: &str) {}

    fn answer(&mut self) -> Option<bool> {
        Some(false)
    }
}

/// What a session tells while it runs.
#[derive(Debug)]
pub enum Told<'a> {
    /// A command that is carried out.
    Command(&'a Command),
    /// Something that went wrong at the end, and does not change what was captured.
    Note(String),
}

/// The devices of a cell.
pub struct Devices {
    /// The arm.
    pub robot: Box<dyn Robot>,
    /// The frame camera, if the cell has one.
    pub frame: Option<Box<dyn FrameCamera>>,
    /// The event camera, if the cell has one.
    pub event: Option<Box<dyn EventCamera>>,
    /// The session's clock.
    pub clock: Arc<dyn Clock>,
}

/// Live devices as a world.
pub struct Live<'a> {
    robot: Box<dyn Robot>,
    cameras: Cameras,
    clock: Arc<dyn Clock>,
    writer: Background,
    operator: &'a mut dyn Operator,
    asking: bool,
    interrupted: &'a AtomicBool,
    progress: &'a mut dyn FnMut(Told<'_>),
    /// Stamped when they were made, handed out one by one.
    pending: VecDeque<(Stamp, Input)>,
    heartbeat_due: bool,
}

impl<'a> Live<'a> {
    /// Drives `devices` and logs to `writer`; `operator` answers questions, `progress` hears what happens.
    pub fn new(
        devices: Devices,
        writer: Writer,
        timing: (u32, f64),
        interrupted: &'a AtomicBool,
        operator: &'a mut dyn Operator,
        progress: &'a mut dyn FnMut(Told<'_>),
    ) -> Result<Self, LiveError> {
        let writer = Background::new(writer, |image| codec::encode_png(image).map_err(|e| e.to_string()))?;
        let Devices { robot, frame, event, clock } = devices;
        let facts = Input::Connected(Box::new(robot.facts()));
        let pending = VecDeque::from([(clock.now(), facts)]);
        let cameras = Cameras::new(frame, event, Arc::clone(&clock), timing);
        let asking = false;
        let heartbeat_due = false;
        Ok(Self { robot, cameras, clock, writer, operator, asking, interrupted, progress, pending, heartbeat_due })
    }

    /// What the display should do when it is watched.
    pub fn expecting(self, display: &DisplayCell) -> Self {
        let &DisplayCell { cycle_hz, refresh_hz, .. } = display;
        let cameras = self.cameras.expecting(ExpectedBlink { cycle_hz, refresh_hz });
        Self { cameras, ..self }
    }

    /// Records events as the cell says.
    pub fn recording(self, record: EventRecord) -> Self {
        match record {
            EventRecord::Captures => self,
            EventRecord::Always => Self { cameras: self.cameras.always(), ..self },
        }
    }

    /// Goes on with a session whose past is in the recording already.
    pub fn resumed(mut self) -> Self {
        let at = self.pending.front().map_or_else(|| self.clock.now(), |(at, _)| *at);
        self.pending.push_front((at, Input::Resumed));
        self
    }

    /// Stops the arm after an error; what was logged stays in the `.partial` file that is returned.
    pub fn abandon(&mut self) -> (std::path::PathBuf, Result<(), RobotError>) {
        // Where the stop of our script does not get through, the heartbeats have ended and the controller stops it.
        let stopped = self.robot.stop();
        (self.writer.abandon(), stopped)
    }

    /// Closes the recording and gives it its final name.
    pub fn into_recording(self) -> Result<std::path::PathBuf, RecordingError> {
        self.writer.finish()
    }

    /// Asks the cameras; makes an input when the capture is complete or has failed.
    fn poll_capture(&mut self) -> Result<(), LiveError> {
        let robot = &mut self.robot;
        let mut pulse = || robot.pulse().map_err(|why| why.to_string());
        let input = self.cameras.poll(&mut self.writer, &mut pulse)?;
        self.pending.extend(input);
        self.pending.extend(self.cameras.poll_watch(&mut self.writer)?);
        // What ends a capture must be logged right after it.
        if self.pending.is_empty() { self.cameras.log_between(&mut self.writer, false) } else { Ok(()) }
    }

    fn wait_for_robot(&mut self) -> (Stamp, Input) {
        if self.interrupted.swap(false, Ordering::Relaxed) {
            return (self.clock.now(), Input::Interrupted);
        }
        if self.asking
            && let Some(yes) = self.operator.answer()
        {
            self.asking = false;
            return (self.clock.now(), if yes { Input::Confirmed } else { Input::Declined });
        }
        match self.robot.next_sample() {
            Ok((at, sample)) => {
                self.heartbeat_due = true;
                (at, Input::Robot(Box::new(sample)))
            }
            Err(error) => (self.clock.now(), Input::RobotLost { why: error.to_string() }),
        }
    }
}

impl World for Live<'_> {
    type Error = LiveError;

    fn execute(&mut self, command: &Command) -> Result<(), LiveError> {
        self.writer.command(self.clock.now(), command)?;
        if matches!(command, Command::Start | Command::Move { .. } | Command::Travel { .. }) {
            // What has been asked of the arm must be known to whoever resumes.
            self.writer.sync()?;
        }
        (self.progress)(Told::Command(command));
        let robot = &mut self.robot;
        let begun = match command {
            Command::Start => robot.start_program(),
            Command::Move { target, .. } | Command::Travel { target, .. } => robot.start_move(target).map(drop),
            Command::Confirm { question } => {
                self.operator.ask(question);
                self.asking = true;
                Ok(())
            }
            Command::Capture { pose, attempt } => {
                self.pending.extend(self.cameras.begin(*pose, *attempt));
                Ok(())
            }
            Command::Watch => {
                self.pending.extend(self.cameras.begin_watch());
                Ok(())
            }
            Command::Wait { .. } | Command::Guide { .. } => Ok(()),
            // The session is over: what fails now is told, and changes nothing that was captured.
            Command::Stop { .. } => {
                if let Err(error) = robot.stop() {
                    (self.progress)(Told::Note(format!(
                        "the stop did not get through whole: {error}; look at the arm"
                    )));
                }
                Ok(())
            }
            Command::Finish { load } => {
                if let Err(error) = robot.finish(load.as_deref()) {
                    (self.progress)(Told::Note(error.to_string()));
                }
                Ok(())
            }
        };
        if let Err(error) = begun {
            self.pending.push_back((self.clock.now(), Input::RobotLost { why: error.to_string() }));
        }
        Ok(())
    }

    fn next_input(&mut self) -> Result<Option<(Stamp, Input)>, LiveError> {
        if self.heartbeat_due {
            self.heartbeat_due = false;
            if let Err(error) = self.robot.heartbeat() {
                let why = error.to_string();
                self.pending.push_back((self.clock.now(), Input::RobotLost { why }));
            }
        }
        self.poll_capture()?;
        let (at, input) = match self.pending.pop_front() {
            Some(input) => input,
            None => self.wait_for_robot(),
        };
        self.writer.input(at, &input)?;
        if matches!(input, Input::Captured(_)) {
            self.writer.sync()?;
        }
        Ok(Some((at, input)))
    }

    fn goes_on(&self) -> bool {
        matches!(self.pending.front(), Some((_, Input::Resumed)))
    }

    fn finish(&mut self) -> Result<(), LiveError> {
        self.cameras.log_between(&mut self.writer, true)?;
        Ok(self.writer.sync()?)
    }
}
