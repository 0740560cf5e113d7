//! Devices at the edge: the traits, one folder per driver, and the simulated cell.
//!
//! Drivers never name each other; traits carry no vendor words. Uses `session` for the words that are
//! logged. Start at [`Robot`].

pub mod event_stream;
#[cfg(feature = "evk4")]
pub mod evk4;
#[cfg(feature = "genicam")]
pub mod genicam;
pub mod pictures;
pub mod rtde;
pub mod sim;
mod streaming;
pub mod ur;
pub mod v4l2;
mod wall_clock;

pub use wall_clock::{WallClock, pause};

use crate::geometry::Camera;
use crate::image::GrayImage;
use crate::session::{Exposure, MoveTarget, RobotFacts, RobotSample, Stamp};

/// A robot arm.
///
/// The caller must call [`Robot::heartbeat`] after judging every sample: when heartbeats stop, the
/// controller stops the arm by itself.
pub trait Robot: Send {
    /// The controller and the arm as they described themselves.
    fn facts(&self) -> RobotFacts;
    /// Starts the program that moves the arm; it holds the arm where it is. Samples show when it is there.
    fn start_program(&mut self) -> Result<(), RobotError>;
    /// Waits for the next sample.
    fn next_sample(&mut self) -> Result<(Stamp, RobotSample), RobotError>;
    /// Starts a move and returns its sequence number at once; progress arrives through the samples.
    fn start_move(&mut self, target: &MoveTarget) -> Result<i32, RobotError>;
    /// Says that the caller has judged the last sample and is alive.
    fn heartbeat(&mut self) -> Result<(), RobotError>;
    /// Begins a pulse on the output that triggers the frame camera; it ends by itself with the heartbeats.
    fn pulse(&mut self) -> Result<(), RobotError> {
        Err(RobotError::Refused { what: "a trigger pulse".into(), why: "this robot has no trigger output".into() })
    }
    /// Stops as fast as the controller safely allows. Must work in every state.
    fn stop(&mut self) -> Result<(), RobotError>;
    /// Stops our program on the controller; the arm stays where it is. `load` names a program that is loaded
    /// then, never started.
    fn finish(&mut self, load: Option<&str>) -> Result<(), RobotError>;
}

/// The session's clock.
pub trait Clock: Send + Sync {
    /// Time since the session began.
    fn now(&self) -> Stamp;
}

/// What a robot driver can fail with.
#[derive(Debug, thiserror::Error)]
pub enum RobotError {
    /// The connection could not be opened.
    #[error("cannot reach the robot at {address}: {why}; is the controller on, and is the service enabled?")]
    Unreachable {
        /// Where.
        address: String,
        /// The reason of the system.
        why: String,
    },
    /// Nothing new for too long.
    #[error("no state from the robot for {silent_s:.3} s; is the controller on and reachable?")]
    Silent {
        /// For how long, seconds.
        silent_s: f64,
    },
    /// The peer does not speak the protocol.
    #[error("the robot at {address} broke the protocol: {what}")]
    Protocol {
        /// Where.
        address: String,
        /// What was found and what was expected.
        what: String,
    },
    /// The controller said no.
    #[error("the controller refused {what}: {why}")]
    Refused {
        /// What was asked.
        what: String,
        /// The answer.
        why: String,
    },
    /// The connection broke.
    #[error("the connection to the robot at {address} broke: {why}")]
    Broken {
        /// Where.
        address: String,
        /// The reason of the system.
        why: String,
    },
}

/// What a camera said about itself when the driver opened it.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct CameraFacts {
    /// Maker and model.
    pub model: String,
    /// Serial number, if it has one.
    pub serial: Option<String>,
    /// Firmware version, if it says.
    pub firmware: Option<String>,
    /// Settings as read back from the camera, by name; they go into the log.
    pub settings: std::collections::BTreeMap<String, String>,
}

/// An image and when it was exposed, on the session's clock.
#[derive(Debug, Clone)]
pub struct FrameImage {
    /// When it was exposed.
    pub exposure: Exposure,
    /// The image; absent where it was lost or nobody needs it. `exposure.image` says the same.
    pub image: Option<GrayImage>,
}

impl FrameImage {
    /// An image that arrived whole.
    pub fn whole(start_s: f64, end_s: f64, image: GrayImage) -> Self {
        Self { exposure: Exposure::whole(start_s, end_s), image: Some(image) }
    }
}

/// A frame camera, whose exposures are the timing of a capture.
///
/// Free running, the images of a capture are the next whole exposures. Triggered, the driver (or whoever pulses the
/// trigger line for it) begins the exposures one by one.
pub trait FrameCamera: Send {
    /// The camera as it described itself.
    fn facts(&self) -> CameraFacts;
    /// Image width and height, pixels.
    fn size(&self) -> [u32; 2];
    /// Asks for the next `images` exposures that begin after now. What an earlier capture left is dropped.
    fn begin(&mut self, images: u32) -> Result<(), CameraError>;
    /// The images asked for, in order, as soon as the last event window is over: the exposure after the last has begun
    /// or its closing pulse is given. Returns at once; a lost image is an exposure without an image.
    fn poll(&mut self) -> Result<Option<Vec<FrameImage>>, CameraError>;
    /// Whether it waits for a pulse of the robot's output now. The caller pulses the line and asks again.
    fn wants_pulse(&mut self) -> bool {
        false
    }
}

/// Raw words of an event camera.
#[derive(Debug, Clone)]
pub struct RawEvents {
    /// Sensor time of the first word in microseconds, wraps unrolled.
    pub first_us: i64,
    /// When the packet reached the host, on the session's clock.
    pub arrived: Stamp,
    /// The words, little-endian.
    pub words: Vec<u8>,
}

/// An event camera with the frame camera's exposure signal at its trigger input.
pub trait EventCamera: Send {
    /// The camera as it described itself.
    fn facts(&self) -> CameraFacts;
    /// Sensor width and height, pixels.
    fn size(&self) -> [u32; 2];
    /// Format of the words: `evt2`, `evt21`, `evt21_legacy` or `evt3`.
    fn encoding(&self) -> &'static str;
    /// Starts recording; what came in the last [`PRE_ROLL_S`] before is kept too, as far as the camera ran.
    fn begin(&mut self) -> Result<(), CameraError>;
    /// Hands over what has come since [`EventCamera::begin`] or the last call, and goes on recording. Returns at once.
    fn take(&mut self) -> Result<Vec<RawEvents>, CameraError>;
    /// Stops recording and hands over what was recorded since [`EventCamera::begin`] and not yet taken.
    fn end(&mut self) -> Result<Vec<RawEvents>, CameraError>;
}

/// Events are recorded from this long before a capture, s.
pub const PRE_ROLL_S: f64 = 0.2;

impl CameraError {
    /// Which camera failed.
    pub fn camera(&self) -> Camera {
        match self {
            Self::Silent { camera, .. } | Self::Failed { camera, .. } => *camera,
        }
    }
}

/// What a camera can fail with.
#[derive(Debug, thiserror::Error)]
pub enum CameraError {
    /// Nothing came.
    #[error("the {camera} camera delivered nothing for {silent_s:.1} s; is it connected and powered?")]
    Silent {
        /// Which camera.
        camera: Camera,
        /// For how long, s.
        silent_s: f64,
    },
    /// The camera is gone or refuses.
    #[error("the {camera} camera failed: {why}")]
    Failed {
        /// Which camera.
        camera: Camera,
        /// The driver's words.
        why: String,
    },
}
