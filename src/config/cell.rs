//! A robot cell, as the rest of the program sees it: checked, in metres, radians and seconds.

use garde::Validate;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::cameras::{EventCameraCell, FrameCameraCell};
use super::handheld::Handheld;
use super::robot::{Interlock, MotionBy, Signals, ToolShape};
use crate::board::Board;
use crate::calibration::settings::{Carried, Gates, PoseKind, Settings};
use crate::geometry::{Base, Camera, Event, Flange, Pinhole, Rgb, Sensor, Target, Tcp, Transform, kinematics::Joints};

/// A robot cell.
#[derive(Debug, Clone, PartialEq)]
pub struct Cell {
    /// Letters, digits, `-` and `_`; the folder of its sessions.
    pub name: String,
    /// What the robot carries.
    pub carried: Carried,
    /// The arm; a placeholder where its driver is `none`.
    pub robot: RobotCell,
    /// How a session without a robot is run.
    pub handheld: Handheld,
    /// The board on the display.
    pub board: Board,
    /// The display.
    pub display: DisplayCell,
    /// The frame camera, if there is one.
    pub rgb: Option<FrameCameraCell>,
    /// The event camera, if there is one; at least one of the two is.
    pub event: Option<EventCameraCell>,
    /// Where everything is, roughly.
    pub nominal: Nominal,
    /// Where the camera models come from.
    pub intrinsics: IntrinsicsSource,
    /// Truth for the checks.
    pub checks: ChecksCell,
    /// Limits of a result that passes.
    pub gates: Gates,
    /// How numbers are made.
    pub settings: Settings,
    /// The trajectories of a session, in order.
    pub trajectories: Vec<TrajectoryUse>,
    /// Images of the frame camera, and event windows, at each pose.
    pub images_per_pose: u32,
    /// Poses in a row at which the same camera may fail before the session stops for an operator.
    pub stop_after_failed_poses: u32,
    /// The simulated cell, for the driver `sim`.
    pub sim: Option<SimCell>,
}

impl Cell {
    /// The camera that the hand-eye result, the nominal poses and the views of trajectories are for.
    pub fn reference_camera(&self) -> Camera {
        let event = if self.event.is_some() { Camera::Event } else { Camera::Rgb };
        self.settings.reference_camera.unwrap_or(event)
    }

    /// The camera as it would be without distortion and with its axis through the centre: for planning only.
    pub fn nominal_camera(&self, camera: Camera) -> Option<Pinhole> {
        match camera {
            Camera::Rgb => self.rgb.as_ref().map(|c| nominal(c.width, c.height, c.focal_length_m, c.pixel_pitch_m)),
            Camera::Event => self.event.as_ref().map(|c| nominal(c.width, c.height, c.focal_length_m, c.pixel_pitch_m)),
        }
    }

    /// Takes coordinates in the reference camera to coordinates in `camera`; `None` where the cell does not say.
    pub fn camera_from_reference(&self, camera: Camera) -> Option<Transform<Sensor, Sensor>> {
        let reference = self.reference_camera();
        let event_from_rgb = self.nominal.event_from_rgb.map(|t| *t.iso());
        // Both ends are cameras that are known only as data here.
        match (camera, reference) {
            (Camera::Rgb, Camera::Rgb) | (Camera::Event, Camera::Event) => Some(Transform::identity()),
            (Camera::Event, Camera::Rgb) => event_from_rgb.map(Transform::assume_frames),
            (Camera::Rgb, Camera::Event) => event_from_rgb.map(|t| Transform::assume_frames(t.inverse())),
        }
    }
}

fn nominal(width: u32, height: u32, focal_length_m: f64, pixel_pitch_m: f64) -> Pinhole {
    Pinhole::centred(width, height, focal_length_m / pixel_pitch_m)
}

/// The arm and how it may move.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotCell {
    /// What answers on the other side.
    pub driver: RobotDriver,
    /// Model name; `ur5e`.
    pub model: String,
    /// A URDF to use instead of the nominal model, relative to the cell file; links `base` and `flange`.
    pub urdf: Option<String>,
    /// Host of the controller; always there for `ur`.
    pub address: Option<String>,
    /// Serial number that the controller must report.
    pub serial: Option<String>,
    /// The active TCP that the controller must have.
    pub tcp_offset: Transform<Flange, Tcp>,
    /// Payload that the controller must have, kg.
    pub payload_kg: f64,
    /// Its centre of gravity in the flange, m.
    pub payload_cog_m: [f64; 3],
    /// Where a session starts, rad.
    pub home_joints_rad: Joints,
    /// Caps of every move.
    pub limits: MotionLimits,
    /// Whether the arm may move in reduced mode.
    pub allow_reduced: bool,
    /// What counts as standing still.
    pub stillness: Stillness,
    /// Where no part of arm, tool or board may go, in `base`.
    pub keep_out: Vec<KeepOut>,
    /// Distance that every part keeps from the boxes, m.
    pub keep_out_margin_m: f64,
    /// What is fixed to the flange, besides the board or the camera.
    pub tool: Vec<ToolShape>,
    /// Farthest that a joint may be from home at the start, rad.
    pub start_within_rad: f64,
    /// Software version that the controller must begin with, such as `5.12`.
    pub controller_version: Option<String>,
    /// Checksum of the kinematics that the controller must have, lower-case hexadecimal.
    pub kinematics_checksum: Option<String>,
    /// Smallest and largest position of the speed slider, 0 to 1.
    pub speed_slider: [f64; 2],
    /// Samples per second, 500 / n Hz.
    pub sample_hz: f64,
    /// Inputs that must keep their values.
    pub interlocks: Vec<Interlock>,
    /// An input that shows that the gripper holds nothing; looked at before the first move.
    pub gripper_empty: Option<Interlock>,
    /// Outputs that tell others what is going on.
    pub signals: Signals,
    /// Who moves the arm.
    pub motion: MotionBy,
    /// Whether the arm goes home when the last pose is done.
    pub return_home: bool,
    /// Program that is loaded, never started, when all is done.
    pub load_program: Option<String>,
}

impl RobotCell {
    /// What stands where there is no arm; nothing of it is used.
    pub(super) fn none() -> Self {
        Self {
            driver: RobotDriver::None,
            model: "none".into(),
            urdf: None,
            address: None,
            serial: None,
            tcp_offset: Transform::identity(),
            payload_kg: 0.0,
            payload_cog_m: [0.0; 3],
            home_joints_rad: [0.0; 6],
            limits: MotionLimits {
                joint_speed_rad_s: 0.0,
                joint_acceleration_rad_s2: 0.0,
                tcp_speed_m_s: 0.0,
                tcp_acceleration_m_s2: 0.0,
                joints_rad: None,
            },
            allow_reduced: false,
            stillness: Stillness::default(),
            keep_out: Vec::new(),
            keep_out_margin_m: 0.0,
            tool: Vec::new(),
            start_within_rad: 0.0,
            controller_version: None,
            kinematics_checksum: None,
            speed_slider: [0.0, 1.0],
            sample_hz: 125.0,
            interlocks: Vec::new(),
            gripper_empty: None,
            signals: Signals::default(),
            motion: MotionBy::Script,
            return_home: false,
            load_program: None,
        }
    }
}

/// Drivers of arms.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RobotDriver {
    /// The simulated arm, in the same process.
    Sim,
    /// A controller of Universal Robots.
    Ur,
    /// There is no arm: an operator moves the display or the cameras. Written as `robot: none`.
    #[serde(skip)]
    None,
}

/// Caps of every move.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionLimits {
    /// Speed of the leading joint, rad/s.
    pub joint_speed_rad_s: f64,
    /// Acceleration of the leading joint, rad/s2.
    pub joint_acceleration_rad_s2: f64,
    /// Speed of the TCP, m/s.
    pub tcp_speed_m_s: f64,
    /// Acceleration of the TCP, m/s2.
    pub tcp_acceleration_m_s2: f64,
    /// Smallest and largest position of each joint, rad; absent: those of the model.
    pub joints_rad: Option<[[f64; 2]; 6]>,
}

/// What counts as standing still.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Stillness {
    /// Every sample of this long must keep the limits, s.
    #[garde(range(min = 0.05, max = 10.0))]
    pub window_s: f64,
    /// Fewest samples in the window.
    #[garde(range(min = 3, max = 5000))]
    pub min_samples: u32,
    /// Longest time between two samples, s.
    #[garde(range(min = 0.002, max = 1.0))]
    pub max_gap_s: f64,
    /// Largest measured joint speed, rad/s.
    #[garde(range(min = 1e-6, max = 0.1))]
    pub joint_speed_rad_s: f64,
    /// Largest spread of a measured joint position in the window, rad.
    #[garde(range(min = 1e-7, max = 0.01))]
    pub joint_spread_rad: f64,
    /// Largest distance of a joint from where the controller aims, rad.
    #[garde(range(min = 1e-6, max = 0.1))]
    pub joint_error_rad: f64,
    /// Largest speed of the TCP, m/s.
    #[garde(range(min = 1e-6, max = 0.05))]
    pub tcp_speed_m_s: f64,
    /// Largest turning speed of the TCP, rad/s.
    #[garde(range(min = 1e-6, max = 0.1))]
    pub tcp_rotation_rad_s: f64,
    /// Give up after this long, s.
    #[garde(range(min = 0.1, max = 120.0))]
    pub timeout_s: f64,
}

impl Stillness {
    /// The limits for the short time of an exposure: few samples lie in it, and together with those of the
    /// decision the encoder noise spreads farther.
    pub fn through_capture(&self) -> Self {
        Self { min_samples: 2, joint_spread_rad: 2.0 * self.joint_spread_rad, ..self.clone() }
    }
}

impl Default for Stillness {
    fn default() -> Self {
        Self {
            window_s: 0.3,
            min_samples: 20,
            max_gap_s: 0.1,
            joint_speed_rad_s: 0.005,
            joint_spread_rad: 1e-4,
            joint_error_rad: 1e-3,
            tcp_speed_m_s: 0.001,
            tcp_rotation_rad_s: 0.002,
            timeout_s: 5.0,
        }
    }
}

/// A box in `base`, edges parallel to its axes, that tool and board must not enter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct KeepOut {
    /// What is there.
    #[garde(skip)]
    pub name: String,
    /// Corner with the smallest x, y, z, metres.
    #[garde(inner(range(min = -10.0, max = 10.0)))]
    pub min_m: [f64; 3],
    /// Corner with the largest x, y, z, metres.
    #[garde(inner(range(min = -10.0, max = 10.0)))]
    pub max_m: [f64; 3],
}

/// The display that blinks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DisplayCell {
    /// Share of white in the second state, of gamma-encoded values.
    #[serde(default = "default_alpha")]
    #[garde(range(min = 0.0, max = 0.95))]
    pub alpha: f64,
    /// Full cycles (pattern and blended) per second, Hz.
    #[serde(default = "default_cycle_hz")]
    #[garde(range(min = 1.0, max = 120.0))]
    pub cycle_hz: f64,
    /// Refresh rate of the panel, Hz; a whole number of refreshes must fit each state.
    #[serde(default = "default_refresh_hz")]
    #[garde(range(min = 10.0, max = 500.0))]
    pub refresh_hz: f64,
    /// Columns and rows of the panel.
    #[garde(skip)]
    pub panel_px: Option<[u32; 2]>,
    /// Side of a square as measured along x and y of the board, millimetres; `board.square_mm` is their mean.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[garde(skip)]
    pub square_xy_mm: Option<[f64; 2]>,
    /// Standard uncertainty of these two, millimetres.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[garde(skip)]
    pub square_sigma_mm: Option<[f64; 2]>,
}

impl Default for DisplayCell {
    fn default() -> Self {
        Self {
            alpha: default_alpha(),
            cycle_hz: default_cycle_hz(),
            refresh_hz: default_refresh_hz(),
            panel_px: None,
            square_xy_mm: None,
            square_sigma_mm: None,
        }
    }
}

fn default_alpha() -> f64 {
    0.6
}

fn default_cycle_hz() -> f64 {
    15.0
}

fn default_refresh_hz() -> f64 {
    60.0
}

/// Where everything is, roughly: for planning, never for solving. `Sensor` is the reference camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Nominal {
    /// The places that depend on what is carried.
    pub mount: Mount,
    /// Frame camera in the event camera; always there with two cameras.
    pub event_from_rgb: Option<Transform<Event, Rgb>>,
}

/// Rough places of camera and board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mount {
    /// `carried: target`.
    Target {
        /// The camera stands still.
        base_from_camera: Transform<Base, Sensor>,
        /// The board is on the arm.
        tcp_from_target: Transform<Tcp, Target>,
    },
    /// `carried: cameras`.
    Cameras {
        /// The camera is on the arm.
        tcp_from_camera: Transform<Tcp, Sensor>,
        /// The board stands still.
        base_from_target: Transform<Base, Target>,
    },
}

impl Mount {
    /// The board as the reference camera sees it with the arm at this pose.
    pub fn camera_from_target(&self, base_from_tcp: Transform<Base, Tcp>) -> Transform<Sensor, Target> {
        match *self {
            Self::Target { base_from_camera, tcp_from_target } => {
                base_from_camera.inverse() * base_from_tcp * tcp_from_target
            }
            Self::Cameras { tcp_from_camera, base_from_target } => {
                (base_from_tcp * tcp_from_camera).inverse() * base_from_target
            }
        }
    }

    /// The pose of the arm at which the reference camera sees the board so.
    pub fn base_from_tcp(&self, camera_from_target: Transform<Sensor, Target>) -> Transform<Base, Tcp> {
        match *self {
            Self::Target { base_from_camera, tcp_from_target } => {
                base_from_camera * camera_from_target * tcp_from_target.inverse()
            }
            Self::Cameras { tcp_from_camera, base_from_target } => {
                base_from_target * camera_from_target.inverse() * tcp_from_camera.inverse()
            }
        }
    }
}

/// Where the camera models come from.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum IntrinsicsSource {
    /// From the images of the session.
    #[default]
    Solve,
    /// From a result.json, relative to the cell file.
    From(String),
}

/// Truth for the checks.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ChecksCell {
    /// The corner of the target-to-TCP check.
    pub corner_id: u32,
    /// Its distance from the TCP as measured on the tool, m; absent: the spread is checked, not the mean.
    pub target_to_tcp_m: Option<f64>,
}

/// A trajectory and what its poses are for.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TrajectoryUse {
    /// Trajectory file, relative to the cell file.
    pub file: String,
    /// What its poses are for.
    pub purpose: PoseKind,
}

/// The simulated cell; the parts are read by the simulators themselves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SimCell {
    /// Seed of everything that is drawn.
    #[serde(default = "default_seed")]
    pub seed: u64,
    /// Flaws of the display.
    pub display: Option<Section>,
    /// Flaws of the frame camera.
    pub frame: Option<Section>,
    /// Flaws of the event camera.
    pub events: Option<Section>,
    /// Flaws of the arm.
    pub robot: Option<Section>,
}

fn default_seed() -> u64 {
    1
}

/// Keys that somebody else reads.
pub type Section = serde_json::Map<String, serde_json::Value>;
