//! A cell file as it is written: the keys, their units and their ranges. `cell_convert` makes a cell of it.

use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;

use super::cameras_file::{EventCameraFile, FrameCameraFile};
use super::cell::{DisplayCell, IntrinsicsSource, KeepOut, RobotDriver, SimCell, Stillness, TrajectoryUse};
use super::handheld::{Handheld, RobotChoice};
use super::pose::PoseFile;
use super::robot::{Interlock, MotionBy, Signals, ToolShapeFile};
use crate::calibration::settings::{Carried, HandEyeMethod, Method, Pnp};
use crate::geometry::Camera;

/// A robot cell: robot, cameras, board, limits, gates and the trajectories of a session.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "cell", rename = "Cell")]
#[garde(allow_unvalidated)]
pub(super) struct CellFile {
    /// Letters, digits, `-` and `_`; the folder of its sessions.
    pub(super) name: String,
    /// What the robot carries: the display (`target`) or the `cameras`.
    pub(super) carried: Carried,
    /// The arm, or `none` where the display or the cameras are moved by hand.
    #[garde(dive)]
    pub(super) robot: RobotChoice,
    /// How a session without a robot is run.
    #[serde(default)]
    #[garde(dive)]
    pub(super) handheld: Handheld,
    /// The ChArUco board on the display.
    #[garde(dive)]
    pub(super) board: BoardFile,
    /// The display.
    #[garde(dive)]
    pub(super) display: DisplayCell,
    /// The frame camera.
    #[garde(dive)]
    pub(super) rgb: Option<FrameCameraFile>,
    /// The event camera.
    #[garde(dive)]
    pub(super) event: Option<EventCameraFile>,
    /// Where everything is, roughly: for planning, never for solving.
    #[serde(default)]
    #[garde(dive)]
    pub(super) nominal: NominalFile,
    /// `solve`, or `from: RESULT` with a result.json relative to this file.
    #[serde(default)]
    pub(super) intrinsics: IntrinsicsSource,
    /// Truth for the checks.
    #[serde(default)]
    #[garde(dive)]
    pub(super) checks: ChecksFile,
    /// Limits of a result that passes; an absent gate is not judged.
    #[serde(default)]
    #[garde(dive)]
    pub(super) gates: GatesFile,
    /// How numbers are made.
    #[serde(default)]
    #[garde(dive)]
    pub(super) settings: SettingsFile,
    /// The trajectories of a session, in order; none without a robot.
    #[serde(default)]
    pub(super) trajectories: Vec<TrajectoryUse>,
    /// Images of the frame camera, and event windows, at each pose.
    #[serde(default = "one")]
    #[garde(range(min = 1, max = 100))]
    pub(super) images_per_pose: u32,
    /// Poses in a row at which the same camera may fail before the session stops for an operator.
    #[serde(default = "three")]
    #[garde(range(min = 1, max = 1000))]
    pub(super) stop_after_failed_poses: u32,
    /// The simulated cell.
    pub(super) sim: Option<SimCell>,
}

fn one() -> u32 {
    1
}

fn three() -> u32 {
    3
}

/// The arm and how it may move.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Robot")]
#[garde(allow_unvalidated)]
pub(super) struct RobotFile {
    /// `sim` or `ur`.
    pub(super) driver: RobotDriver,
    /// Model name; `ur5e`.
    pub(super) model: String,
    /// A URDF to use instead of the nominal model, relative to this file; links `base` and `flange`.
    pub(super) urdf: Option<String>,
    /// Host name or IP address of the controller.
    pub(super) address: Option<String>,
    /// Serial number that the controller must report.
    pub(super) serial: Option<String>,
    /// The TCP in the flange, exactly as it is set on the controller.
    #[garde(dive)]
    pub(super) tcp_offset: PoseFile,
    /// Payload as it is set on the controller, kg.
    #[garde(range(min = 0.0, max = 50.0))]
    pub(super) payload_kg: f64,
    /// Its centre of gravity in the flange, metres.
    #[serde(default)]
    #[garde(inner(range(min = -1.0, max = 1.0)))]
    pub(super) payload_cog_m: [f64; 3],
    /// Where a session starts, degrees.
    #[garde(inner(range(min = -360.0, max = 360.0)))]
    pub(super) home_joints_deg: [f64; 6],
    /// Farthest that a joint may be from home at the start, degrees.
    #[serde(default = "default_start_within_deg")]
    #[garde(range(min = 0.0, max = 360.0))]
    pub(super) start_within_deg: f64,
    /// Caps of every move.
    #[serde(default)]
    #[garde(dive)]
    pub(super) limits: LimitsFile,
    /// Whether the arm may move in reduced mode.
    #[serde(default)]
    pub(super) allow_reduced: bool,
    /// What counts as standing still.
    #[serde(default)]
    #[garde(dive)]
    pub(super) stillness: Stillness,
    /// Boxes in `base` that arm, tool and board must not enter.
    #[serde(default)]
    #[garde(dive)]
    pub(super) keep_out: Vec<KeepOut>,
    /// Distance that every part keeps from the boxes, millimetres.
    #[serde(default)]
    #[garde(range(min = 0.0, max = 1000.0))]
    pub(super) keep_out_margin_mm: f64,
    /// Capsules fixed to the flange: tool, gripper, brackets. The board or the camera is added by itself.
    #[serde(default)]
    #[garde(dive)]
    pub(super) tool: Vec<ToolShapeFile>,
    /// Software version that the controller must begin with, such as `5.12`.
    pub(super) controller_version: Option<String>,
    /// Checksum of the kinematics that the controller must have, as `cellcal robot kinematics` prints it.
    pub(super) kinematics_checksum: Option<String>,
    /// Smallest and largest position of the speed slider, 0 to 1.
    #[serde(default = "default_speed_slider")]
    #[garde(inner(range(min = 0.01, max = 1.0)))]
    pub(super) speed_slider: [f64; 2],
    /// Samples per second: 500 / n, at least 50.
    #[serde(default = "default_sample_hz")]
    #[garde(range(min = 50.0, max = 500.0))]
    pub(super) sample_hz: f64,
    /// Inputs that must keep their values; the loss of one stops the arm.
    #[serde(default)]
    #[garde(dive)]
    pub(super) interlocks: Vec<Interlock>,
    /// An input that shows that the gripper holds nothing; looked at before the first move.
    #[garde(dive)]
    pub(super) gripper_empty: Option<Interlock>,
    /// Outputs that tell others what is going on.
    #[serde(default)]
    #[garde(dive)]
    pub(super) signals: Signals,
    /// `script` (our own, uploaded once per session) or `external: {at_pose: ..., captured: ...}`.
    #[serde(default)]
    pub(super) motion: MotionBy,
    /// Whether the arm goes home when the last pose is done.
    #[serde(default = "yes")]
    pub(super) return_home: bool,
    /// Program that is loaded, never started, when all is done.
    pub(super) load_program: Option<String>,
}

fn default_speed_slider() -> [f64; 2] {
    [0.1, 1.0]
}

fn default_sample_hz() -> f64 {
    125.0
}

fn yes() -> bool {
    true
}

fn default_start_within_deg() -> f64 {
    10.0
}

/// Caps of every move.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "MotionLimits")]
#[garde(allow_unvalidated)]
pub(super) struct LimitsFile {
    /// Speed of the leading joint, rad/s.
    #[garde(range(min = 0.01, max = 3.15))]
    pub(super) joint_speed_rad_s: f64,
    /// Acceleration of the leading joint, rad/s2.
    #[garde(range(min = 0.05, max = 10.0))]
    pub(super) joint_acceleration_rad_s2: f64,
    /// Speed of the TCP, m/s.
    #[garde(range(min = 0.01, max = 1.0))]
    pub(super) tcp_speed_m_s: f64,
    /// Acceleration of the TCP, m/s2.
    #[garde(range(min = 0.05, max = 5.0))]
    pub(super) tcp_acceleration_m_s2: f64,
    /// Smallest and largest position of each joint, degrees; absent: those of the model.
    pub(super) joints_deg: Option<[[f64; 2]; 6]>,
}

impl Default for LimitsFile {
    fn default() -> Self {
        Self {
            joint_speed_rad_s: 1.05,
            joint_acceleration_rad_s2: 1.4,
            tcp_speed_m_s: 0.25,
            tcp_acceleration_m_s2: 0.5,
            joints_deg: None,
        }
    }
}

/// The ChArUco board.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Board")]
#[garde(allow_unvalidated)]
pub(super) struct BoardFile {
    /// ArUco dictionary by OpenCV's name, such as `DICT_4X4_50`.
    pub(super) dictionary: String,
    /// Squares along x.
    #[garde(range(min = 3, max = 100))]
    pub(super) squares_x: u32,
    /// Squares along y.
    #[garde(range(min = 3, max = 100))]
    pub(super) squares_y: u32,
    /// Side of a square as measured on the display, millimetres.
    #[garde(range(min = 1.0, max = 1000.0))]
    pub(super) square_mm: f64,
    /// Side of a marker, millimetres; 0.3 to 0.95 of the square.
    #[garde(range(min = 0.3, max = 950.0))]
    pub(super) marker_mm: f64,
}

/// Rough places; `camera` is the reference camera. Which keys are needed depends on `carried`.
#[derive(Debug, Default, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "Nominal")]
pub(super) struct NominalFile {
    /// `carried: target`: the static camera in the base of the robot.
    #[garde(dive)]
    pub(super) base_from_camera: Option<PoseFile>,
    /// `carried: target`: the board in the TCP.
    #[garde(dive)]
    pub(super) tcp_from_target: Option<PoseFile>,
    /// `carried: cameras`: the camera in the TCP.
    #[garde(dive)]
    pub(super) tcp_from_camera: Option<PoseFile>,
    /// `carried: cameras`: the static board in the base of the robot.
    #[garde(dive)]
    pub(super) base_from_target: Option<PoseFile>,
    /// With two cameras: the frame camera in the event camera.
    #[garde(dive)]
    pub(super) event_from_rgb: Option<PoseFile>,
}

/// Truth for the checks.
#[derive(Debug, Default, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "Checks")]
#[garde(allow_unvalidated)]
pub(super) struct ChecksFile {
    /// The corner of the target-to-TCP check.
    pub(super) corner_id: u32,
    /// Its distance from the TCP as measured on the tool, millimetres.
    #[garde(range(min = 0.0, max = 2000.0))]
    pub(super) target_to_tcp_mm: Option<f64>,
}

/// Limits of a result that passes; an absent gate is not judged.
#[derive(Debug, Default, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "Gates")]
pub(super) struct GatesFile {
    /// Largest RMS reprojection error of the frame camera, px.
    #[garde(range(min = 0.001, max = 100.0))]
    pub(super) rgb_rms_px: Option<f64>,
    /// Largest RMS reprojection error of the event camera, px.
    #[garde(range(min = 0.001, max = 100.0))]
    pub(super) event_rms_px: Option<f64>,
    /// Largest RMS reprojection error of the stereo pair, px.
    #[garde(range(min = 0.001, max = 100.0))]
    pub(super) stereo_rms_px: Option<f64>,
    /// Smallest share of corners found, 0 to 1, each camera.
    #[garde(range(min = 0.0, max = 1.0))]
    pub(super) corner_rate: Option<f64>,
    /// Largest standard deviation of the target-to-TCP distance, millimetres.
    #[garde(range(min = 0.001, max = 1000.0))]
    pub(super) target_to_tcp_sigma_mm: Option<f64>,
    /// Largest error of the target-to-TCP distance at one pose, millimetres.
    #[garde(range(min = 0.001, max = 1000.0))]
    pub(super) target_to_tcp_max_mm: Option<f64>,
    /// Largest |mean error| of the target-to-TCP distance, millimetres.
    #[garde(range(min = 0.001, max = 1000.0))]
    pub(super) target_to_tcp_bias_mm: Option<f64>,
    /// Largest mean absolute error of the base-frame distances, millimetres.
    #[garde(range(min = 0.001, max = 1000.0))]
    pub(super) base_distance_mae_mm: Option<f64>,
    /// Largest mean error of the displacement vectors, millimetres.
    #[garde(range(min = 0.001, max = 1000.0))]
    pub(super) base_vector_mae_mm: Option<f64>,
    /// Largest distance between the translations of two hand-eye solvers, millimetres.
    #[garde(range(min = 0.001, max = 1000.0))]
    pub(super) panel_spread_mm: Option<f64>,
    /// Largest distance between the controller's pose of the flange and its kinematics or the URDF, millimetres.
    #[garde(range(min = 0.001, max = 1000.0))]
    pub(super) kinematics_mm: Option<f64>,
    /// Largest angle between them, degrees.
    #[garde(range(min = 0.0001, max = 180.0))]
    pub(super) kinematics_deg: Option<f64>,
}

/// How numbers are made.
#[derive(Debug, Default, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "Settings")]
#[garde(allow_unvalidated)]
pub(super) struct SettingsFile {
    /// How corners are found.
    pub(super) method: Option<Method>,
    /// Views with a larger RMS reprojection error are dropped once; px.
    #[garde(range(min = 0.01, max = 100.0))]
    pub(super) reject_view_above_px: Option<f64>,
    /// Fewest corners of a usable view.
    #[garde(range(min = 4, max = 10000))]
    pub(super) min_corners: Option<u32>,
    /// Board pose from a view.
    pub(super) pnp: Option<Pnp>,
    /// The hand-eye solver that gives the result.
    pub(super) hand_eye: Option<HandEyeMethod>,
    /// The camera that the hand-eye result is for; absent: event where present.
    pub(super) reference_camera: Option<Camera>,
}
