//! What happens and what is asked: the words that are logged, and that a replay repeats.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::board::View;
use crate::events::blink::DisplayProof;
use crate::geometry::{
    Base, Camera, Tcp, Transform,
    kinematics::{Dh, Joints},
};
pub use crate::plan::MoveTarget;

/// Time since the session began, nanoseconds of the session's clock.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Stamp(pub u64);

impl Stamp {
    /// Seconds since the session began.
    pub fn seconds(self) -> f64 {
        self.0 as f64 * 1e-9
    }

    /// The stamp `seconds` after the session began; negative and NaN become 0.
    pub fn from_seconds(seconds: f64) -> Self {
        Self((seconds * 1e9).round() as u64)
    }
}

/// One sample of the robot, exactly as the controller reported it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RobotSample {
    /// Seconds since the controller started.
    pub controller_time_s: f64,
    /// Measured joint positions, rad.
    pub joints_rad: Joints,
    /// Measured joint speeds, rad/s.
    pub joint_speeds_rad_s: Joints,
    /// Joint positions that the controller aims at, rad.
    pub target_joints_rad: Joints,
    /// Joint speeds that the controller aims at, rad/s.
    pub target_joint_speeds_rad_s: Joints,
    /// `base_from_tcp` as x, y, z (m) and axis-angle vector (rad).
    pub tcp_pose: [f64; 6],
    /// Speed of the TCP, m/s and rad/s.
    pub tcp_speed: [f64; 6],
    /// The active TCP in the flange: x, y, z (m) and axis-angle vector (rad).
    pub tcp_offset: [f64; 6],
    /// Payload, kg.
    pub payload_kg: f64,
    /// Centre of gravity of the payload in the flange, m.
    pub payload_cog_m: [f64; 3],
    /// UR robot mode; 7 is RUNNING.
    pub robot_mode: i32,
    /// UR safety mode; 1 is NORMAL, 2 REDUCED.
    pub safety_mode: i32,
    /// UR safety status bits.
    pub safety_status_bits: u32,
    /// UR robot status bits.
    pub robot_status_bits: u32,
    /// UR runtime state; 2 is PLAYING.
    pub runtime_state: u32,
    /// Product of slider and limits, 0 to 1.
    pub speed_scaling: f64,
    /// The speed slider of the pendant, 0 to 1.
    pub target_speed_fraction: f64,
    /// Digital inputs, bit by bit: 0 to 7 standard, 8 to 15 configurable, 16 and 17 of the tool.
    pub digital_inputs: u64,
    /// Digital outputs, in the same order.
    pub digital_outputs: u64,
    /// Temperatures of the joints, degrees Celsius.
    pub joint_temperatures_c: [f64; 6],
    /// Last sequence number that our script acknowledged.
    pub executor_sequence: i32,
    /// What our script says it is doing.
    pub executor_state: ExecutorState,
}

impl RobotSample {
    /// The pose of the active TCP.
    pub fn base_from_tcp(&self) -> Transform<Base, Tcp> {
        Transform::from_pose_vector(self.tcp_pose)
    }
}

/// What our script on the controller says it is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ExecutorState {
    /// Not started.
    Absent,
    /// Waiting for a command.
    Idle,
    /// Executing a move.
    Moving,
    /// The last move is done and the controller says that the arm is steady.
    Steady,
    /// The last command was refused by the controller's own safety limits.
    Refused,
}

/// The controller and the arm as they described themselves when the driver connected.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RobotFacts {
    /// Software version of the controller by RTDE: major, minor, bug fix, build.
    pub controller_version: [u32; 4],
    /// Model, `UR5` for a UR5e too; absent where the controller does not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// Serial number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// Whether scripts over the network are accepted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remote_control: Option<bool>,
    /// The kinematics that the controller itself uses.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kinematics: Option<Kinematics>,
    /// Program that will move the arm.
    pub motion: String,
    /// SHA-256 of its text; empty where it is not ours.
    pub script_sha256: String,
}

/// The kinematics of an individual arm, out of its controller.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Kinematics {
    /// Calibrated Denavit-Hartenberg parameters.
    pub dh: Dh,
    /// Checksum by the controller, 48 lower-case hexadecimal digits.
    pub checksum: String,
    /// Whether the controller says that they are calibrated, not nominal.
    pub calibrated: bool,
}

/// Something that happened, stamped since the session began. Exactly what is logged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "input", rename_all = "snake_case")]
pub enum Input {
    /// The driver is connected; nothing has been started.
    Connected(Box<RobotFacts>),
    /// The robot reported its state.
    Robot(Box<RobotSample>),
    /// The robot has been silent or broke the protocol.
    RobotLost {
        /// What was seen, in words.
        why: String,
    },
    /// The cameras delivered everything of a capture.
    Captured(Captured),
    /// A camera could not deliver.
    CaptureFailed {
        /// Index of the pose.
        pose: usize,
        /// Which camera; absent in recordings of before it was said.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        camera: Option<Camera>,
        /// What was seen, in words.
        why: String,
    },
    /// The operator asked to stop.
    Interrupted,
    /// The operator said yes to a question.
    Confirmed,
    /// The operator said no, or nobody can be asked.
    Declined,
    /// The session goes on after it had ended; everything before has been checked anew.
    Resumed,
    /// Both cameras were looked through; only without a robot.
    Looked(Look),
    /// The display was watched for a while.
    Watched(Watched),
}

/// What the event camera saw of the display.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Watched {
    /// It blinks as it should.
    Proof(DisplayProof),
    /// It does not, or nothing was delivered; in words.
    Problem(String),
}

/// What the cameras saw at one moment.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Look {
    /// The corners that each camera saw; an image that could not be had is absent.
    pub views: BTreeMap<Camera, View>,
}

/// What the cameras delivered for one capture; images and events lie beside it in the log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Captured {
    /// Index of the pose.
    pub pose: usize,
    /// Which try at this pose, from 0.
    pub attempt: u32,
    /// Exposures, in order.
    pub exposures: Vec<Exposure>,
    /// Number of raw event bytes.
    pub event_bytes: u64,
    /// What the source of an imported session declares; absent in a session of our own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub declared: Option<Declared>,
}

/// What the source of an imported session says about a pose.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Declared {
    /// The interval in which the arm stood still, seconds of the session's clock; absent if not said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub still_s: Option<[f64; 2]>,
    /// `base_from_tcp`; absent where there is no robot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base_from_tcp: Option<Transform<Base, Tcp>>,
    /// Measured joint positions, rad; absent if not said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joints_rad: Option<Joints>,
    /// The corners that each camera saw, where the source has corners instead of images and events.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub views: BTreeMap<Camera, View>,
}

/// One exposure of the frame camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Exposure {
    /// Start, seconds of the session's clock.
    pub start_s: f64,
    /// End, seconds of the session's clock.
    pub end_s: f64,
    /// Whether the log holds an image of it.
    pub image: bool,
    /// Whether it was made only to end the event window of the exposure before.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub closing: bool,
    /// Packets of the image that were lost on the way; such an image is not kept.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub lost_packets: u32,
}

impl Exposure {
    /// An exposure whose image arrived whole; seconds of the session's clock.
    pub fn whole(start_s: f64, end_s: f64) -> Self {
        Self { start_s, end_s, image: true, closing: false, lost_packets: 0 }
    }

    /// An exposure that only ends the event window of the one before; seconds of the session's clock.
    pub fn closing(start_s: f64, end_s: f64) -> Self {
        Self { start_s, end_s, image: false, closing: true, lost_packets: 0 }
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands references")]
fn is_zero(count: &u32) -> bool {
    *count == 0
}

/// Something that the outside world is asked to do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "command", rename_all = "snake_case")]
pub enum Command {
    /// Ask the operator a question; nothing moves until it is answered.
    Confirm {
        /// The question, in words.
        question: String,
    },
    /// Start the program that moves the arm; it holds the arm where it is.
    Start,
    /// Move without a capture at the end.
    Travel {
        /// What for, in words.
        why: String,
        /// Where to.
        target: MoveTarget,
    },
    /// Move to a pose of the trajectory.
    Move {
        /// Index of the pose.
        pose: usize,
        /// Where to.
        target: MoveTarget,
    },
    /// Capture with all cameras.
    Capture {
        /// Index of the pose.
        pose: usize,
        /// Which try, from 0.
        attempt: u32,
    },
    /// Discard the last capture of this pose and wait until the arm is still again.
    Wait {
        /// Index of the pose.
        pose: usize,
        /// The coming try, from 0.
        attempt: u32,
    },
    /// Stop the arm now.
    Stop {
        /// Why, in words.
        why: String,
    },
    /// Watch the display with the event camera for a while.
    Watch,
    /// Tell the operator what to do next; only without a robot.
    Guide {
        /// What to do, in words.
        advice: String,
    },
    /// No poses left: stop our program on the controller.
    Finish {
        /// Program that is loaded then, never started.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        load: Option<String>,
    },
}
