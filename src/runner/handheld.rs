//! The world of a session without a robot: the cameras look again and again, an operator moves the display.
//!
//! A look is an image and the events of its exposure, judged at once and logged as corners; images and events of
//! captures are logged whole, as with a robot.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::World;
use super::capture::{Cameras, Delivered, capture_failed, decoded};
use super::live::{LiveError, Told};
use crate::board::{Board, View};
use crate::cv::codec;
use crate::devices::{Clock, EventCamera, FrameCamera, RawEvents};
use crate::events::LastPolarity;
use crate::geometry::Camera;
use crate::recording::{Background, RecordingError, Writer};
use crate::session::{Command, Input, Look, Stamp};
use crate::vision;

/// Events of a look are taken from its last part of this length, s.
const LOOK_S: f64 = 0.1;

/// Lets a little time pass while the cameras work: a moment of sleep, or of simulated time.
pub type Rest = Box<dyn FnMut()>;

/// Cameras, their clock, and what lets time pass.
pub type CameraDevices = (Option<Box<dyn FrameCamera>>, Option<Box<dyn EventCamera>>, Arc<dyn Clock>, Rest);

/// Live cameras as a world.
pub struct HandheldLive<'a> {
    board: Board,
    cameras: Cameras,
    event_size: [u32; 2],
    encoding: &'static str,
    clock: Arc<dyn Clock>,
    rest: Rest,
    writer: Background,
    interrupted: &'a AtomicBool,
    progress: &'a mut dyn FnMut(Told<'_>),
    pending: VecDeque<(Stamp, Input)>,
}

impl<'a> HandheldLive<'a> {
    /// Drives the cameras and logs to `writer`; `timing`: images of a capture, and from one to the next, s.
    pub fn new(
        devices: CameraDevices,
        board: Board,
        writer: Writer,
        timing: (u32, f64),
        interrupted: &'a AtomicBool,
        progress: &'a mut dyn FnMut(Told<'_>),
    ) -> Result<Self, LiveError> {
        let (frame, event, clock, rest) = devices;
        let writer = Background::new(writer, |image| codec::encode_png(image).map_err(|e| e.to_string()))?;
        let event_size = event.as_ref().map_or([0, 0], |event| event.size());
        let encoding = event.as_ref().map_or("evt3", |event| event.encoding());
        let cameras = Cameras::new(frame, event, Arc::clone(&clock), timing);
        let pending = VecDeque::new();
        Ok(Self { board, cameras, event_size, encoding, clock, rest, writer, interrupted, progress, pending })
    }

    /// Closes the recording and gives it its final name.
    pub fn into_recording(self) -> Result<std::path::PathBuf, RecordingError> {
        self.writer.finish()
    }

    /// Waits for the end of the capture that is going on, or looks once.
    fn wait_for_cameras(&mut self) -> Result<(Stamp, Input), LiveError> {
        let mut no_pulse = || Err("there is no robot to pulse the trigger line".to_owned());
        let capturing = self.cameras.is_busy();
        let begun = if capturing { Ok(()) } else { self.cameras.begin_look(1) };
        if let Err(error) = begun {
            return Ok((self.clock.now(), capture_failed(0, &error)));
        }
        loop {
            if self.interrupted.swap(false, Ordering::Relaxed) {
                return Ok((self.clock.now(), Input::Interrupted));
            }
            if capturing {
                if let Some(input) = self.cameras.poll(&mut self.writer, &mut no_pulse)? {
                    return Ok(input);
                }
            } else {
                match self.cameras.poll_look(&mut no_pulse) {
                    Ok(None) => {}
                    Ok(Some(delivered)) => return Ok((self.clock.now(), Input::Looked(self.look(delivered)))),
                    Err(error) => {
                        return Ok((self.clock.now(), capture_failed(0, &error)));
                    }
                }
            }
            (self.rest)();
        }
    }

    fn look(&self, (frames, packets): Delivered) -> Look {
        let mut views = BTreeMap::new();
        if let Some(image) = frames.iter().rev().find_map(|frame| frame.image.as_ref()) {
            views.insert(Camera::Rgb, vision::frame_view(&self.board, image).unwrap_or_default());
        }
        if !packets.is_empty() {
            views.insert(Camera::Event, self.event_view(&packets));
        }
        Look { views }
    }

    fn event_view(&self, packets: &[RawEvents]) -> View {
        let events = decoded(packets, self.encoding);
        let newest_us = events.iter().map(|event| event.t_us).max().unwrap_or(0);
        let from_us = newest_us - (LOOK_S * 1e6) as i64;
        let [width, height] = self.event_size.map(|n| u16::try_from(n).unwrap_or(u16::MAX));
        let mut image = LastPolarity::new(width, height);
        events.iter().filter(|event| event.t_us >= from_us).for_each(|event| image.add(event));
        vision::event_view(&self.board, &image.image()).unwrap_or_default()
    }
}

impl World for HandheldLive<'_> {
    type Error = LiveError;

    fn execute(&mut self, command: &Command) -> Result<(), LiveError> {
        self.writer.command(self.clock.now(), command)?;
        (self.progress)(Told::Command(command));
        if let Command::Capture { pose, attempt } = command {
            self.pending.extend(self.cameras.begin(*pose, *attempt));
        }
        Ok(())
    }

    fn next_input(&mut self) -> Result<Option<(Stamp, Input)>, LiveError> {
        let (at, input) = match self.pending.pop_front() {
            Some(input) => input,
            None => self.wait_for_cameras()?,
        };
        self.writer.input(at, &input)?;
        if matches!(input, Input::Captured(_)) {
            self.writer.sync()?;
        }
        Ok(Some((at, input)))
    }

    fn finish(&mut self) -> Result<(), LiveError> {
        Ok(self.writer.sync()?)
    }
}
