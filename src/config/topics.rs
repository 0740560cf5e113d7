//! What the topics of a recording by others mean, as checked values.

use serde::Deserialize;

use super::cell::ChecksCell;
use crate::board::Board;
use crate::calibration::settings::{Carried, PoseKind};
use crate::geometry::{Flange, Tcp, Transform};

/// The meaning of the topics of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Topics {
    /// What the robot poses are for.
    pub mode: TopicsMode,
    /// What the robot carries.
    pub carried: Carried,
    /// The board.
    pub board: Board,
    /// The frame camera.
    pub rgb: Option<ImageTopic>,
    /// The event camera.
    pub event: Option<EventTopic>,
    /// Where the arm was.
    pub robot: Option<RobotTopic>,
    /// How the poses are found.
    pub stops: Stops,
    /// What the checks compare with.
    pub checks: Option<ChecksCell>,
}

/// What the robot poses of a recording are for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TopicsMode {
    /// Cameras and stereo only; robot poses do not enter the result.
    Stereo,
    /// Hand-eye as well.
    Handeye,
}

/// Images of the frame camera.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageTopic {
    /// The topic.
    pub topic: String,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Length of an exposure, s.
    pub exposure_s: f64,
    /// Images a second while the camera takes some.
    pub images_per_s: f64,
    /// Which moment the stamp of an image is.
    pub stamp: StampOf,
}

/// Which moment the stamp of an image is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum StampOf {
    /// When its exposure began.
    ExposureStart,
    /// When its exposure ended.
    ExposureEnd,
}

/// Packets of the event camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EventTopic {
    /// The topic.
    pub topic: String,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Trigger input that carries the exposure signal.
    pub trigger_channel: u8,
    /// By what images and events are paired.
    pub paired_by: PairBy,
}

/// By what images and events are paired.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PairBy {
    /// By the edges at the trigger input where there are as many as images, else by arrival.
    #[default]
    Auto,
    /// By the edges at the trigger input.
    Trigger,
    /// By the stamps of packets and images.
    Arrival,
}

/// Where the arm was.
#[derive(Debug, Clone, PartialEq)]
pub enum RobotTopic {
    /// Joint positions; the pose follows from a model of the arm.
    Joints {
        /// The topic.
        topic: String,
        /// What stands before the names of the joints.
        prefix: String,
        /// A URDF instead of the nominal UR5e, relative to the file.
        urdf: Option<String>,
        /// The TCP in the flange.
        flange_from_tcp: Transform<Flange, Tcp>,
    },
    /// Transforms between named frames.
    Tf {
        /// The topic.
        topic: String,
        /// The topic of those that never change.
        static_topic: String,
        /// Name of our frame `base`.
        base: String,
        /// Name of our frame `tcp`.
        tcp: String,
    },
}

/// How the poses of a recording are found.
#[derive(Debug, Clone, PartialEq)]
pub enum Stops {
    /// Wherever the arm stands still.
    Still(StillRule),
    /// As declared.
    Intervals(Vec<Interval>),
    /// Each image is a pose of its own.
    EachImage,
}

/// What counts as standing still.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StillRule {
    /// For at least this long, s.
    pub hold_s: f64,
    /// Longest time between two samples, s.
    pub max_gap_s: f64,
    /// Largest joint speed, where the recording has speeds, rad/s.
    pub joint_speed_rad_s: f64,
    /// Largest change of a joint during that time, rad.
    pub joint_spread_rad: f64,
    /// Largest motion of the TCP during that time, m.
    pub tcp_spread_m: f64,
    /// Largest turn of the TCP during that time, rad.
    pub tcp_turn_rad: f64,
}

/// A time in which the arm, or whatever carries the board, stood still.
#[derive(Debug, Clone, PartialEq)]
pub struct Interval {
    /// Id of the pose.
    pub id: String,
    /// Begin, s on the clock of the stamps.
    pub from_s: f64,
    /// End, s on the clock of the stamps.
    pub to_s: f64,
    /// What the pose is for.
    pub kind: PoseKind,
}
