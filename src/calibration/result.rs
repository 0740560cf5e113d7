//! The finished calibration: what `result.json` holds (schema version 1).
//!
//! A section that cannot be computed is absent, never null; there is no NaN, no wall clock, no path, no
//! host name and no thread count in it: the same session gives the same bytes.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::adjust::{AdjustedLens, DisplayShape, LoopFacts, Parameters, PlaceSigma, Uncertain};
use super::checks::{BaseDistance, TargetInBase, TargetToTcp};
use super::gates::Verdict;
use super::hand_eye::{HandEyeMethod, Uncertainty};
use super::kinematics::KinematicsResult;
use super::observability::Observability;
use super::settings::{Gates, PoseKind, Settings};
use crate::board::Board;
use crate::events::blink::DisplayProof;
use crate::geometry::{Base, Camera, Event, Pinhole, Rgb, Sensor, Target, Tcp, Transform};

/// Version of the layout of `result.json`.
pub const SCHEMA_VERSION: u32 = 1;

/// A finished calibration.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct CalibrationResult {
    /// [`SCHEMA_VERSION`].
    pub schema_version: u32,
    /// Version of this program.
    pub program_version: String,
    /// Names the session.
    pub session_id: String,
    /// Name of the cell or data set.
    pub cell: String,
    /// Whether it may be used.
    pub verdict: Verdict,
    /// What was changed against the recorded settings for this solve; absent where nothing was.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub overrides: Vec<String>,
    /// What a reader should know before trusting it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Why a section is absent, by name of the section.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub not_computed: BTreeMap<String, String>,
    /// The cameras.
    pub cameras: BTreeMap<Camera, CameraResult>,
    /// The event camera before the frame camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stereo: Option<StereoResult>,
    /// Where camera and target are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hand_eye: Option<HandEyeResult>,
    /// The consistency checks.
    pub checks: ChecksResult,
    /// How the display is bent; only of `method: precise`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub display_shape: Option<DisplayShape>,
    /// Everything that was solved together with its covariance, one entry a rig; only of `method: precise`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub uncertainty: Vec<Parameters>,
    /// How well the models of the arm explain what its controller says.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kinematics: Option<KinematicsResult>,
    /// How event camera and exposures were brought together.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub timing: Option<Timing>,
    /// How the display blinked when the session watched it last, on the clock of the event camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub display: Option<DisplayProof>,
    /// What happened at each pose.
    pub poses: Vec<PoseResult>,
    /// Where it comes from.
    pub provenance: Provenance,
}

/// One camera.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct CameraResult {
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Focal length along x, pixels.
    pub fx: f64,
    /// Focal length along y, pixels.
    pub fy: f64,
    /// Principal point x, pixels from the centre of the top-left pixel.
    pub cx: f64,
    /// Principal point y.
    pub cy: f64,
    /// k1, k2, p1, p2, k3.
    pub distortion: [f64; 5],
    /// `sqrt(mean |e|^2)` over the points of the views used, px.
    pub rms_px: f64,
    /// Views used.
    pub views_used: usize,
    /// Views left out.
    pub views_rejected: usize,
    /// Corners in the views used.
    pub points: usize,
    /// Corners found over all corners of all poses with an image, 0 to 1.
    pub corner_rate: f64,
    /// Serial number, where declared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// Lens and its setting, where declared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lens: Option<String>,
    /// Terms of distortion and how sure all numbers are; only of `method: precise`, solved.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub adjusted: Option<AdjustedLens>,
}

impl CameraResult {
    /// The intrinsics.
    pub fn pinhole(&self) -> Pinhole {
        let &Self { width, height, fx, fy, cx, cy, distortion, .. } = self;
        Pinhole { width, height, fx, fy, cx, cy, distortion }
    }
}

/// The event camera before the frame camera.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct StereoResult {
    /// Takes coordinates of the frame camera to the event camera.
    pub event_from_rgb: Transform<Event, Rgb>,
    /// Distance of the cameras, m.
    pub baseline_m: f64,
    /// Angle of the rotation, deg.
    pub rotation_deg: f64,
    /// RMS over the points of both cameras, px.
    pub rms_px: f64,
    /// Pairs of views used.
    pub pairs_used: usize,
    /// Pairs left out.
    pub pairs_rejected: usize,
    /// Ids seen by both over all corners of all poses with both images, 0 to 1.
    pub corner_rate: f64,
    /// Whether it was taken over from an earlier result; then `rms_px` says how this session fits it, with board
    /// poses from the frame camera alone.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub taken_over: bool,
    /// How sure the transform is; only of `method: precise`, solved.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma: Option<Uncertain<PlaceSigma>>,
}

/// Where camera and target are.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct HandEyeResult {
    /// The camera that this is for.
    pub reference_camera: Camera,
    /// The solver.
    pub method: HandEyeMethod,
    /// `carried: target`: where the camera stands.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base_from_camera: Option<Transform<Base, Sensor>>,
    /// `carried: target`: how the target sits on the tool.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tcp_from_target: Option<Transform<Tcp, Target>>,
    /// `carried: cameras`: how the camera sits on the tool.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tcp_from_camera: Option<Transform<Tcp, Sensor>>,
    /// `carried: cameras`: where the target stands.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base_from_target: Option<Transform<Base, Target>>,
    /// What every solver found for the camera.
    pub panel: BTreeMap<HandEyeMethod, Value>,
    /// Why the others found nothing.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub panel_failed: BTreeMap<HandEyeMethod, String>,
    /// Largest distance between two solvers of the panel, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub panel_spread_m: Option<f64>,
    /// Jackknife over the poses.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uncertainty: Option<Uncertainty>,
    /// What the adjustment found about camera, target and arm; only of `hand_eye: refined`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refined: Option<LoopFacts>,
    /// RMS scatter of the target's origin over the poses used, m.
    pub scatter_rms_m: f64,
    /// Poses used.
    pub poses_used: usize,
    /// How well the rotations span space.
    pub observability: Observability,
}

/// The consistency checks.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct ChecksResult {
    /// Distance of a corner to the TCP (`carried: target`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target_to_tcp: Option<TargetToTcp>,
    /// Scatter of a corner in `base` (`carried: cameras`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target_in_base: Option<TargetInBase>,
    /// Distances and displacements between pairs of poses.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base_distance: Option<BaseDistance>,
}

/// How the event camera's clock and the exposures were brought together.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Timing {
    /// By what images and events were paired.
    #[serde(default)]
    pub paired_by: PairedBy,
    /// Session clock minus sensor clock at sensor time 0, s.
    pub offset_s: f64,
    /// How much faster the session's clock runs, parts per million.
    pub drift_ppm: f64,
    /// RMS of trigger edges about that, s; paired by arrival, the median delay of packets beyond the fastest.
    pub residual_rms_s: f64,
    /// How much later than by the edges the arrival of the fastest packets puts the events, s: a latency, if images
    /// and edges are paired rightly.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub arrival_latency_s: Option<f64>,
    /// Exposures with an event window, and all exposures.
    pub windows: [usize; 2],
    /// What was odd.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
}

/// By what images and events were paired.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PairedBy {
    /// Exposures are edges at the event camera's trigger input.
    #[default]
    Trigger,
    /// The host's clock, from the arrival of packets: there is no wire.
    Arrival,
    /// Events alone, cut by the image period.
    Period,
}

/// What happened at one pose.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct PoseResult {
    /// Its id.
    pub pose_id: String,
    /// What it is for.
    pub kind: PoseKind,
    /// Whether anything of the result rests on it.
    pub used: bool,
    /// Why not, or what was left out; absent where all is well.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// What each camera saw.
    pub cameras: BTreeMap<Camera, PoseCamera>,
    /// Scatter of the target at this pose, mm-scale: distance from the mean, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hand_eye_residual_m: Option<f64>,
    /// Robot pose of the capture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base_from_tcp: Option<Transform<Base, Tcp>>,
    /// Evidence that the arm stood still.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stationarity: Option<Value>,
}

/// What one camera saw at one pose.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct PoseCamera {
    /// Corners found.
    pub corners: usize,
    /// RMS reprojection error of the view, px; absent where it could not be fitted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rms_px: Option<f64>,
    /// Whether the view was used for the camera.
    pub used: bool,
}

/// Where a result comes from.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Provenance {
    /// Version of OpenCV.
    pub opencv: String,
    /// The board.
    pub board: Board,
    /// Layout of the ChArUco board.
    pub board_layout: String,
    /// The board's frame, in words.
    pub board_frame: String,
    /// `solved`, or where the intrinsics were taken from.
    pub intrinsics: String,
    /// Solver settings.
    pub settings: Settings,
    /// Gates, where there were any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gates: Option<Gates>,
    /// Where the session comes from: source layout, versions.
    pub facts: BTreeMap<String, String>,
    /// SHA-256 of what went in, by name.
    pub sha256: BTreeMap<String, String>,
}

/// A number of the result is NaN or infinite.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("the result cannot be written: {0}")]
pub struct NotWritable(String);

impl CalibrationResult {
    /// The bytes of `result.json`: sorted as declared, one key a line, newline at the end.
    pub fn to_json(&self) -> Result<String, NotWritable> {
        let value = serde_json::to_value(self).map_err(|e| NotWritable(e.to_string()))?;
        refuse_null(&value, "result")?;
        let mut text = serde_json::to_string_pretty(self).map_err(|e| NotWritable(e.to_string()))?;
        text.push('\n');
        Ok(text)
    }
}

/// serde_json writes NaN as null; neither may appear.
fn refuse_null(value: &Value, at: &str) -> Result<(), NotWritable> {
    match value {
        Value::Null => Err(NotWritable(format!("{at} is not a number"))),
        Value::Array(items) => items.iter().enumerate().try_for_each(|(i, v)| refuse_null(v, &format!("{at}[{i}]"))),
        Value::Object(fields) => fields.iter().try_for_each(|(k, v)| refuse_null(v, &format!("{at}.{k}"))),
        Value::Bool(_) | Value::Number(_) | Value::String(_) => Ok(()),
    }
}
