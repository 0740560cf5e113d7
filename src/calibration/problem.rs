//! Everything that a solve starts from: the board, the cameras and what was seen at each pose.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::kinematics::KinematicsResult;
use super::settings::{Carried, Gates, PoseKind, Settings};
use crate::board::{Board, View};
use crate::geometry::{Base, Camera, Event, Pinhole, Rgb, Tcp, Transform};

/// A calibration problem.
#[derive(Debug, Clone)]
pub struct Problem {
    /// Name of the cell.
    pub cell: String,
    /// The board.
    pub board: Board,
    /// What the robot carries.
    pub carried: Carried,
    /// Whether robot poses enter the result (`handeye`) or not (`stereo`).
    pub robot_poses: bool,
    /// The cameras of the cell.
    pub cameras: BTreeMap<Camera, CameraSetup>,
    /// The poses, in order.
    pub poses: Vec<PoseData>,
    /// Known distances between poses.
    pub pairs: Vec<DistancePair>,
    /// What the checks compare with; absent where nothing is said.
    pub checks: Option<CheckTruth>,
    /// How to solve.
    pub settings: Settings,
    /// What must hold; absent for imports without a cell.
    pub gates: Option<Gates>,
    /// Cameras and stereo that were solved before.
    pub known: Option<KnownCameras>,
    /// How well the models of the arm explain what its controller says.
    pub kinematics: Option<KinematicsResult>,
}

/// One camera as the cell declares it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraSetup {
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Serial number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// Lens and its setting, in the user's words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lens: Option<String>,
    /// Focal length over pixel pitch, where declared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub focal_px: Option<f64>,
}

/// Mechanical truths that the checks compare with.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CheckTruth {
    /// The corner whose distance to the TCP is checked.
    pub corner_id: u32,
    /// Its mechanical distance to the TCP, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target_to_tcp_m: Option<f64>,
}

/// Two poses a known distance apart.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DistancePair {
    /// Name of the pair.
    pub name: String,
    /// Id of the first pose.
    pub pose_a: String,
    /// Id of the second pose.
    pub pose_b: String,
    /// The known distance, metres.
    pub truth_m: f64,
}

/// What was seen at one pose.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseData {
    /// Id of the pose.
    pub id: String,
    /// What it is for.
    pub kind: PoseKind,
    /// The robot's pose; absent where none was recorded.
    pub base_from_tcp: Option<Transform<Base, Tcp>>,
    /// The corners that each camera saw; a camera without an image is absent.
    pub views: BTreeMap<Camera, View>,
    /// Evidence that the arm stood still, as the session recorded it.
    pub stillness: Option<serde_json::Value>,
    /// Why nothing was captured here, in words.
    pub skipped: Option<String>,
}

/// Cameras and stereo from an earlier result.
#[derive(Debug, Clone)]
pub struct KnownCameras {
    /// The cameras.
    pub cameras: BTreeMap<Camera, KnownCamera>,
    /// The stereo transform, where both are known.
    pub event_from_rgb: Option<Transform<Event, Rgb>>,
    /// Where they come from: hash of the result file.
    pub source_sha256: String,
    /// Session that solved them.
    pub source_session: String,
}

/// One camera from an earlier result.
#[derive(Debug, Clone)]
pub struct KnownCamera {
    /// The intrinsics.
    pub pinhole: Pinhole,
    /// Serial number then.
    pub serial: Option<String>,
    /// Lens setting then.
    pub lens: Option<String>,
}
