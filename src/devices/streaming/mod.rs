//! Frame cameras that send images by themselves: a thread of the driver keeps taking them in, the session asks.
//!
//! The thread hands over exposures and failures through [`Intake`]; [`Streaming`] is the camera that the session
//! sees, and never waits.

mod capture;

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

pub(super) use capture::{Capture, Timing};

use super::{CameraError, CameraFacts, Clock, FrameCamera, FrameImage};
use crate::config::FrameTrigger;
use crate::geometry::Camera;
use crate::image::GrayImage;

/// Between the thread of a driver and the session.
pub(super) struct Intake {
    clock: Arc<dyn Clock>,
    state: Mutex<State>,
    ended: AtomicBool,
}

#[derive(Default)]
struct State {
    capture: Option<Capture>,
    failed: Option<String>,
}

impl Intake {
    pub(super) fn new(clock: Arc<dyn Clock>) -> Arc<Self> {
        Arc::new(Self { clock, state: Mutex::default(), ended: AtomicBool::new(false) })
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // Each change is a whole one: a thread that panicked left nothing half done.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The session's time, s.
    pub(super) fn now_s(&self) -> f64 {
        self.clock.now().seconds()
    }

    /// Whether the camera has been closed and the thread is to end.
    pub(super) fn has_ended(&self) -> bool {
        self.ended.load(Ordering::Relaxed)
    }

    /// An exposure that began at `start_s` on the session's clock; `image` is made only where it is needed, and fails
    /// with what is wrong with the camera.
    pub(super) fn take(
        &self,
        start_s: f64,
        lost_packets: u32,
        image: impl FnOnce() -> Result<Option<GrayImage>, String>,
    ) {
        let now_s = self.now_s();
        let needed = self.lock().capture.as_ref().is_some_and(|capture| capture.needs_image(start_s));
        // Not under the lock: the session must never wait for a copy.
        let image = if needed { image() } else { Ok(None) };
        match (image, &mut *self.lock()) {
            (Ok(image), State { capture: Some(capture), .. }) => capture.take(start_s, lost_packets, image, now_s),
            (Ok(_), State { capture: None, .. }) => {}
            (Err(why), state) => state.failed = Some(why),
        }
    }

    /// The camera is gone or broken; said once, kept for ever.
    pub(super) fn fail(&self, why: String) {
        self.lock().failed.get_or_insert(why);
    }

    /// Whether the next exposure is to be triggered now; whoever asks does it.
    pub(super) fn claim_trigger(&self) -> bool {
        let now_s = self.now_s();
        match &mut self.lock().capture {
            Some(capture) if capture.wants_trigger(now_s) => {
                capture.triggered(now_s);
                true
            }
            Some(_) | None => false,
        }
    }
}

/// A camera whose images a thread takes in.
pub(super) struct Streaming {
    facts: CameraFacts,
    size: [u32; 2],
    timing: Timing,
    intake: Arc<Intake>,
    thread: Option<JoinHandle<()>>,
}

impl Streaming {
    /// `thread` feeds `intake` until that has ended.
    pub(super) fn new(
        facts: CameraFacts,
        size: [u32; 2],
        timing: Timing,
        intake: Arc<Intake>,
        thread: JoinHandle<()>,
    ) -> Self {
        Self { facts, size, timing, intake, thread: Some(thread) }
    }

    fn silent(&self, silent_s: f64) -> CameraError {
        let camera = Camera::Rgb;
        let FrameTrigger::RobotOutput(output) = self.timing.trigger else {
            return CameraError::Silent { camera, silent_s };
        };
        let line = self.facts.settings.get("trigger").map_or("its trigger input", String::as_str);
        let why = format!(
            "no image within {silent_s:.1} s of a pulse on digital output {output} of the robot; is that output wired to {line}?"
        );
        CameraError::Failed { camera, why }
    }
}

impl Drop for Streaming {
    fn drop(&mut self) {
        self.intake.ended.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic of the thread has been told where it happened.
            let _ = thread.join();
        }
    }
}

impl FrameCamera for Streaming {
    fn facts(&self) -> CameraFacts {
        self.facts.clone()
    }

    fn size(&self) -> [u32; 2] {
        self.size
    }

    fn begin(&mut self, images: u32) -> Result<(), CameraError> {
        let now_s = self.intake.now_s();
        let mut state = self.intake.lock();
        if let Some(why) = &state.failed {
            return Err(CameraError::Failed { camera: Camera::Rgb, why: why.clone() });
        }
        state.capture = Some(Capture::new(self.timing, images, now_s));
        Ok(())
    }

    fn poll(&mut self) -> Result<Option<Vec<FrameImage>>, CameraError> {
        let now_s = self.intake.now_s();
        let mut state = self.intake.lock();
        let Some(mut capture) = state.capture.take() else { return Ok(None) };
        if let Some(why) = &state.failed {
            return Err(CameraError::Failed { camera: Camera::Rgb, why: why.clone() });
        }
        if capture.is_over(now_s) {
            return Ok(Some(capture.into_images()));
        }
        if let Some(silent_s) = capture.silent_s(now_s) {
            drop(state);
            return Err(self.silent(silent_s));
        }
        state.capture = Some(capture);
        Ok(None)
    }

    fn wants_pulse(&mut self) -> bool {
        matches!(self.timing.trigger, FrameTrigger::RobotOutput(_)) && self.intake.claim_trigger()
    }
}
