//! The world of a live session: devices on one side, the recording on the other.
//!
//! Inputs are logged before they are judged, commands before they are carried out. The heartbeat that
//! keeps the arm moving is sent only when the loop comes back for the next input, so a hung loop stops it.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::World;
use crate::cv::codec;
use crate::devices::{CameraError, Clock, EventCamera, FrameCamera, FrameImage, RawEvents, Robot, RobotError};
use crate::recording::{Background, EventPacket, RecordingError, Writer};
use crate::session::{Captured, Command, Input, Stamp};

/// A capture that takes longer has failed, s.
const CAPTURE_TIMEOUT_S: f64 = 10.0;

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
    devices: Devices,
    writer: Background,
    operator: &'a mut dyn Operator,
    asking: bool,
    images_per_pose: u32,
    image_period_s: f64,
    interrupted: &'a AtomicBool,
    progress: &'a mut dyn FnMut(Told<'_>),
    capture: Option<Capture>,
    /// Stamped when they were made, handed out one by one.
    pending: VecDeque<(Stamp, Input)>,
    heartbeat_due: bool,
    packets: u64,
}

/// Images and raw events of one capture.
type Delivered = (Vec<FrameImage>, Vec<RawEvents>);

struct Capture {
    pose: usize,
    attempt: u32,
    began: Stamp,
    frames: Option<Vec<FrameImage>>,
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
        let (images_per_pose, image_period_s) = timing;
        let writer = Background::new(writer, |image| codec::encode_png(image).map_err(|e| e.to_string()))?;
        let facts = Input::Connected(Box::new(devices.robot.facts()));
        let pending = VecDeque::from([(devices.clock.now(), facts)]);
        Ok(Self {
            devices,
            writer,
            operator,
            asking: false,
            images_per_pose,
            image_period_s,
            interrupted,
            progress,
            capture: None,
            pending,
            heartbeat_due: false,
            packets: 0,
        })
    }

    /// Goes on with a session whose past is in the recording already.
    pub fn resumed(mut self) -> Self {
        let at = self.pending.front().map_or_else(|| self.devices.clock.now(), |(at, _)| *at);
        self.pending.push_front((at, Input::Resumed));
        self
    }

    /// Stops the arm after an error; what was logged stays in the `.partial` file that is returned.
    pub fn abandon(&mut self) -> (std::path::PathBuf, Result<(), RobotError>) {
        // Where the stop of our script does not get through, the heartbeats have ended and the controller stops it.
        let stopped = self.devices.robot.stop();
        (self.writer.abandon(), stopped)
    }

    /// Closes the recording and gives it its final name.
    pub fn into_recording(self) -> Result<std::path::PathBuf, RecordingError> {
        self.writer.finish()
    }

    fn begin_capture(&mut self, pose: usize, attempt: u32) -> Result<(), CameraError> {
        if let Some(event) = &mut self.devices.event {
            event.begin()?;
        }
        if let Some(frame) = &mut self.devices.frame {
            frame.begin(self.images_per_pose)?;
        }
        self.capture = Some(Capture { pose, attempt, began: self.devices.clock.now(), frames: None });
        Ok(())
    }

    /// Asks the cameras; makes an input when the capture is complete or has failed.
    fn poll_capture(&mut self) -> Result<(), LiveError> {
        let Some(mut capture) = self.capture.take() else { return Ok(()) };
        match self.try_capture(&mut capture) {
            Ok(Some((frames, packets))) => self.deliver(&capture, frames, packets),
            Ok(None) => {
                self.capture = Some(capture);
                Ok(())
            }
            Err(error) => {
                let (pose, why) = (capture.pose, error.to_string());
                let at = self.devices.clock.now();
                self.pending.push_back((at, Input::CaptureFailed { pose, why }));
                Ok(())
            }
        }
    }

    fn try_capture(&mut self, capture: &mut Capture) -> Result<Option<Delivered>, CameraError> {
        let now = self.devices.clock.now();
        let waited_s = now.seconds() - capture.began.seconds();
        if let Some(frame) = &mut self.devices.frame {
            if capture.frames.is_none() {
                capture.frames = frame.poll()?;
            }
            if capture.frames.is_none() && frame.wants_pulse() {
                let camera = crate::geometry::Camera::Rgb;
                let failed = |why: RobotError| CameraError::Failed { camera, why: why.to_string() };
                self.devices.robot.pulse().map_err(failed)?;
            }
            if capture.frames.is_none() {
                let late = waited_s > CAPTURE_TIMEOUT_S;
                let camera = crate::geometry::Camera::Rgb;
                return if late { Err(CameraError::Silent { camera, silent_s: waited_s }) } else { Ok(None) };
            }
        } else if waited_s < (f64::from(self.images_per_pose) + 2.0) * self.image_period_s {
            // Without a frame camera the windows are cut by whatever drives the trigger input.
            return Ok(None);
        }
        let packets = self.devices.event.as_mut().map_or(Ok(Vec::new()), |event| event.end())?;
        Ok(Some((capture.frames.take().unwrap_or_default(), packets)))
    }

    fn deliver(
        &mut self,
        capture: &Capture,
        frames: Vec<FrameImage>,
        packets: Vec<RawEvents>,
    ) -> Result<(), LiveError> {
        let mut exposures = Vec::new();
        for FrameImage { exposure, image } in frames {
            if let Some(image) = image {
                self.writer.image(Stamp::from_seconds(exposure.start_s), image)?;
            }
            exposures.push(exposure);
        }
        let now = self.devices.clock.now();
        let (size, encoding) =
            self.devices.event.as_ref().map_or(([0, 0], "evt3"), |event| (event.size(), event.encoding()));
        let mut event_bytes = 0;
        for RawEvents { first_us, arrived, words } in packets {
            event_bytes += words.len() as u64;
            self.packets += 1;
            let packet = EventPacket {
                stamp_ns: arrived.0,
                height: size[1],
                width: size[0],
                sequence: self.packets,
                time_base_ns: u64::try_from(first_us).unwrap_or(0) * 1000,
                encoding: encoding.into(),
                events: words,
            };
            self.writer.events(now, packet)?;
        }
        let (pose, attempt) = (capture.pose, capture.attempt);
        let captured = Captured { pose, attempt, exposures, event_bytes, declared: None };
        self.pending.push_back((now, Input::Captured(captured)));
        Ok(())
    }

    fn wait_for_robot(&mut self) -> (Stamp, Input) {
        if self.interrupted.swap(false, Ordering::Relaxed) {
            return (self.devices.clock.now(), Input::Interrupted);
        }
        if self.asking
            && let Some(yes) = self.operator.answer()
        {
            self.asking = false;
            return (self.devices.clock.now(), if yes { Input::Confirmed } else { Input::Declined });
        }
        match self.devices.robot.next_sample() {
            Ok((at, sample)) => {
                self.heartbeat_due = true;
                (at, Input::Robot(Box::new(sample)))
            }
            Err(error) => (self.devices.clock.now(), Input::RobotLost { why: error.to_string() }),
        }
    }
}

impl World for Live<'_> {
    type Error = LiveError;

    fn execute(&mut self, command: &Command) -> Result<(), LiveError> {
        self.writer.command(self.devices.clock.now(), command)?;
        if matches!(command, Command::Start | Command::Move { .. } | Command::Travel { .. }) {
            // What has been asked of the arm must be known to whoever resumes.
            self.writer.sync()?;
        }
        (self.progress)(Told::Command(command));
        let robot = &mut self.devices.robot;
        let begun = match command {
            Command::Start => robot.start_program(),
            Command::Move { target, .. } | Command::Travel { target, .. } => robot.start_move(target).map(drop),
            Command::Confirm { question } => {
                self.operator.ask(question);
                self.asking = true;
                Ok(())
            }
            Command::Capture { pose, attempt } => {
                if let Err(error) = self.begin_capture(*pose, *attempt) {
                    let at = self.devices.clock.now();
                    self.pending.push_back((at, Input::CaptureFailed { pose: *pose, why: error.to_string() }));
                }
                Ok(())
            }
            Command::Wait { .. } => Ok(()),
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
            self.pending.push_back((self.devices.clock.now(), Input::RobotLost { why: error.to_string() }));
        }
        Ok(())
    }

    fn next_input(&mut self) -> Result<Option<(Stamp, Input)>, LiveError> {
        if self.heartbeat_due {
            self.heartbeat_due = false;
            if let Err(error) = self.devices.robot.heartbeat() {
                let why = error.to_string();
                self.pending.push_back((self.devices.clock.now(), Input::RobotLost { why }));
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
        Ok(self.writer.sync()?)
    }
}
