//! Captures with the cameras of a session: begun by a command, polled until complete, logged, told as an input.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use super::live::LiveError;
use crate::devices::{CameraError, Clock, EventCamera, FrameCamera, FrameImage, RawEvents};
use crate::events::blink::{DisplayProof, ExpectedBlink};
use crate::events::{Decoder, Event, Format, Sink, Trigger};
use crate::geometry::Camera;
use crate::recording::{Background, EventPacket};
use crate::session::{Captured, Input, Stamp, Watched};

/// A capture that takes longer has failed, s.
const CAPTURE_TIMEOUT_S: f64 = 10.0;

/// The display is watched for this long, s.
const WATCH_S: f64 = 1.0;

/// Where everything is recorded, it is logged this often between captures, s.
const DRAIN_S: f64 = 0.1;

/// Pulses the trigger line of the frame camera.
pub(super) type Pulse<'a> = dyn FnMut() -> Result<(), String> + 'a;

/// Images and raw events of one capture.
pub(super) type Delivered = (Vec<FrameImage>, Vec<RawEvents>);

/// The cameras and what they are doing.
pub(super) struct Cameras {
    frame: Option<Box<dyn FrameCamera>>,
    event: Option<Box<dyn EventCamera>>,
    clock: Arc<dyn Clock>,
    images_per_pose: u32,
    image_period_s: f64,
    expected: Option<ExpectedBlink>,
    capture: Option<Capture>,
    watch: Option<Watching>,
    packets: u64,
    between: Option<Between>,
}

/// The recording of events between captures.
#[derive(Default)]
struct Between {
    /// Whether the camera records.
    runs: bool,
    /// When it was asked last.
    asked: Stamp,
    /// Taken, and not logged yet.
    taken: Vec<RawEvents>,
}

/// How far the watching of the display is.
enum Watching {
    /// Events are recorded.
    Since(Stamp),
    /// They are judged, beside the loop that keeps the arm alive.
    Judged(Receiver<Watched>),
}

struct Capture {
    pose: usize,
    attempt: u32,
    images: u32,
    began: Stamp,
    frames: Option<Vec<FrameImage>>,
}

impl Cameras {
    /// `timing`: images of a capture, and the time from one to the next, s.
    pub(super) fn new(
        frame: Option<Box<dyn FrameCamera>>,
        event: Option<Box<dyn EventCamera>>,
        clock: Arc<dyn Clock>,
        timing: (u32, f64),
    ) -> Self {
        let (images_per_pose, image_period_s) = timing;
        let (expected, capture, watch, packets, between) = (None, None, None, 0, None);
        Self { frame, event, clock, images_per_pose, image_period_s, expected, capture, watch, packets, between }
    }

    /// Records events between captures too.
    pub(super) fn always(self) -> Self {
        Self { between: Some(Between::default()), ..self }
    }

    /// What the display should do, for [`Cameras::begin_watch`].
    pub(super) fn expecting(self, expected: ExpectedBlink) -> Self {
        Self { expected: Some(expected), ..self }
    }

    /// Begins to watch the display; an input says where that is not possible.
    pub(super) fn begin_watch(&mut self) -> Option<(Stamp, Input)> {
        self.take_between();
        let begun = match &mut self.event {
            Some(event) => event.begin().map_err(|error| error.to_string()),
            None => Err("there is no event camera to watch the display with".into()),
        };
        let now = self.clock.now();
        self.watch = begun.is_ok().then_some(Watching::Since(now));
        begun.err().map(|why| (now, Input::Watched(Watched::Problem(why))))
    }

    /// The judgement of the display, once there is one; its events are logged.
    pub(super) fn poll_watch(&mut self, writer: &mut Background) -> Result<Option<(Stamp, Input)>, LiveError> {
        let now = self.clock.now();
        let judged = match &self.watch {
            None => return Ok(None),
            Some(Watching::Since(since)) if now.seconds() - since.seconds() < WATCH_S => return Ok(None),
            Some(Watching::Since(_)) => match self.end_events() {
                Some(Ok(packets)) => {
                    self.watch = Some(Watching::Judged(self.judge(packets.clone())));
                    self.log_events(packets, writer)?;
                    return Ok(None);
                }
                Some(Err(error)) => Watched::Problem(error.to_string()),
                None => Watched::Problem("the event camera is gone".into()),
            },
            Some(Watching::Judged(receiver)) => match receiver.try_recv() {
                Ok(watched) => watched,
                Err(TryRecvError::Empty) => return Ok(None),
                Err(TryRecvError::Disconnected) => Watched::Problem("its events could not be judged".into()),
            },
        };
        self.watch = None;
        Ok(Some((now, Input::Watched(judged))))
    }

    fn judge(&self, packets: Vec<RawEvents>) -> Receiver<Watched> {
        let (sender, receiver) = channel();
        let size = self.event.as_ref().map_or([0, 0], |event| event.size());
        let encoding = self.event.as_ref().map_or("evt3", |event| event.encoding());
        let expected = self.expected;
        std::thread::spawn(move || {
            let watched = match expected.map(|expected| proof(&packets, size, encoding, expected)) {
                Some(Ok(proof)) => Watched::Proof(proof),
                Some(Err(why)) => Watched::Problem(why),
                None => Watched::Problem("the cell does not say how the display should blink".into()),
            };
            // Nobody waits any more where the session has ended.
            let _ = sender.send(watched);
        });
        receiver
    }

    /// Whether a capture is going on.
    pub(super) fn is_busy(&self) -> bool {
        self.capture.is_some()
    }

    /// Begins a capture; an input says where that is not possible.
    pub(super) fn begin(&mut self, pose: usize, attempt: u32) -> Option<(Stamp, Input)> {
        self.start(pose, attempt, self.images_per_pose).err().map(|error| self.failed(pose, &error))
    }

    /// Begins with `images` images that are not for the log.
    pub(super) fn begin_look(&mut self, images: u32) -> Result<(), CameraError> {
        self.start(0, 0, images)
    }

    fn start(&mut self, pose: usize, attempt: u32, images: u32) -> Result<(), CameraError> {
        self.take_between();
        if let Some(event) = &mut self.event {
            event.begin()?;
        }
        if let Some(frame) = &mut self.frame {
            frame.begin(images)?;
        }
        self.capture = Some(Capture { pose, attempt, images, began: self.clock.now(), frames: None });
        Ok(())
    }

    fn failed(&self, pose: usize, error: &CameraError) -> (Stamp, Input) {
        (self.clock.now(), capture_failed(pose, error))
    }

    /// Asks the cameras; an input when the capture is complete and logged, or has failed.
    pub(super) fn poll(
        &mut self,
        writer: &mut Background,
        pulse: &mut Pulse<'_>,
    ) -> Result<Option<(Stamp, Input)>, LiveError> {
        let Some((pose, attempt)) = self.capture.as_ref().map(|capture| (capture.pose, capture.attempt)) else {
            return Ok(None);
        };
        match self.poll_look(pulse) {
            Ok(Some((frames, packets))) => self.deliver(pose, attempt, frames, packets, writer).map(Some),
            Ok(None) => Ok(None),
            Err(error) => Ok(Some(self.failed(pose, &error))),
        }
    }

    /// Asks the cameras; what they delivered once all is there. After an error nothing is going on any more.
    pub(super) fn poll_look(&mut self, pulse: &mut Pulse<'_>) -> Result<Option<Delivered>, CameraError> {
        let Some(mut capture) = self.capture.take() else { return Ok(None) };
        let delivered = self.advance(&mut capture, pulse)?;
        if delivered.is_none() {
            self.capture = Some(capture);
        }
        Ok(delivered)
    }

    fn advance(&mut self, capture: &mut Capture, pulse: &mut Pulse<'_>) -> Result<Option<Delivered>, CameraError> {
        let camera = Camera::Rgb;
        let waited_s = self.clock.now().seconds() - capture.began.seconds();
        if let Some(frame) = &mut self.frame {
            if capture.frames.is_none() {
                capture.frames = frame.poll()?;
            }
            if capture.frames.is_none() && frame.wants_pulse() {
                pulse().map_err(|why| CameraError::Failed { camera, why })?;
            }
            if capture.frames.is_none() {
                let patient = waited_s <= CAPTURE_TIMEOUT_S + f64::from(capture.images) * self.image_period_s;
                return if patient { Ok(None) } else { Err(CameraError::Silent { camera, silent_s: waited_s }) };
            }
        } else if waited_s < (f64::from(capture.images) + 2.0) * self.image_period_s {
            // Without a frame camera the windows are cut by whatever drives the trigger input.
            return Ok(None);
        }
        let packets = self.end_events().unwrap_or(Ok(Vec::new()))?;
        Ok(Some((capture.frames.take().unwrap_or_default(), packets)))
    }

    fn deliver(
        &mut self,
        pose: usize,
        attempt: u32,
        frames: Vec<FrameImage>,
        packets: Vec<RawEvents>,
        writer: &mut Background,
    ) -> Result<(Stamp, Input), LiveError> {
        let mut exposures = Vec::new();
        for FrameImage { exposure, image } in frames {
            if let Some(image) = image {
                writer.image(Stamp::from_seconds(exposure.start_s), image)?;
            }
            exposures.push(exposure);
        }
        let event_bytes = self.log_events(packets, writer)?;
        let captured = Captured { pose, attempt, exposures, event_bytes, declared: None };
        Ok((self.clock.now(), Input::Captured(captured)))
    }

    /// Ends the recording of a capture; where everything is recorded it goes on at once.
    fn end_events(&mut self) -> Option<Result<Vec<RawEvents>, CameraError>> {
        let event = self.event.as_mut()?;
        let ended = event.end();
        if let Some(between) = &mut self.between {
            (between.runs, between.asked) = (event.begin().is_ok(), self.clock.now());
        }
        Some(ended)
    }

    /// Takes what came between captures, before it is dropped. A camera that fails now is told of at its next capture.
    fn take_between(&mut self) {
        let (Some(event), Some(between)) = (&mut self.event, &mut self.between) else { return };
        if between.runs {
            between.taken.extend(event.take().unwrap_or_default());
        } else {
            between.runs = event.begin().is_ok();
        }
        between.asked = self.clock.now();
    }

    /// Logs what came between captures, where everything is recorded: now and then, or all of it.
    pub(super) fn log_between(&mut self, writer: &mut Background, all: bool) -> Result<(), LiveError> {
        let Some(between) = &self.between else { return Ok(()) };
        let due = all || self.clock.now().seconds() - between.asked.seconds() >= DRAIN_S;
        let free = self.capture.is_none() && !matches!(self.watch, Some(Watching::Since(_)));
        if due && free {
            self.take_between();
        }
        let taken = self.between.as_mut().map(|between| std::mem::take(&mut between.taken));
        self.log_events(taken.unwrap_or_default(), writer).map(drop)
    }

    fn log_events(&mut self, packets: Vec<RawEvents>, writer: &mut Background) -> Result<u64, LiveError> {
        let Some(event) = &self.event else { return Ok(0) };
        let (size, encoding) = (event.size(), event.encoding());
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
            writer.events(self.clock.now(), packet)?;
        }
        Ok(event_bytes)
    }
}

/// What the session is told of a camera that failed.
pub(super) fn capture_failed(pose: usize, error: &CameraError) -> Input {
    Input::CaptureFailed { pose, camera: Some(error.camera()), why: error.to_string() }
}

/// The events of some packets, in order of arrival.
pub(super) fn decoded(packets: &[RawEvents], encoding: &str) -> Vec<Event> {
    let format = Format::from_name(encoding).unwrap_or(Format::Evt3);
    let (mut decoder, mut events) = (Decoder::new(format), Events(Vec::new()));
    if let Some(first) = packets.first() {
        decoder.set_epoch_us(first.first_us);
    }
    for packet in packets {
        decoder.decode_into(&packet.words, &mut events);
    }
    events.0
}

struct Events(Vec<Event>);

impl Sink for Events {
    fn event(&mut self, event: Event) {
        self.0.push(event);
    }

    fn trigger(&mut self, _: Trigger) {}
}

fn proof(
    packets: &[RawEvents],
    size: [u32; 2],
    encoding: &str,
    expected: ExpectedBlink,
) -> Result<DisplayProof, String> {
    let mut events = decoded(packets, encoding);
    events.sort_by_key(|event| event.t_us);
    let size = size.map(|n| u16::try_from(n).unwrap_or(u16::MAX));
    DisplayProof::find(&events, size, expected).map_err(|problem| problem.to_string())
}
