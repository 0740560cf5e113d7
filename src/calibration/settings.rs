//! Solver settings and gates: types of `calibration`, which `config` parses.

use serde::{Deserialize, Serialize};

use crate::geometry::Camera;

/// How corners are found and numbers are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// The paper's: last-polarity event image, median 3x3, OpenCV solvers, one rejection pass.
    Paper,
    /// Ours: corners fitted with their covariance, one bundle adjustment over everything that was seen.
    Precise,
}

/// What the robot carries.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Carried {
    /// The display is on the arm, the cameras stand still (eye-to-hand).
    #[default]
    Target,
    /// The cameras are on the arm, the display stands still (eye-in-hand).
    Cameras,
}

/// What a pose of a trajectory is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PoseKind {
    /// Intrinsics and stereo.
    Intrinsics,
    /// The hand-eye fit.
    HandEye,
    /// The base-distance check; held out of the fit.
    Distance,
}

/// How the board pose is found from one view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Pnp {
    /// Both planar solutions by IPPE, each refined; the better one counts.
    Ippe,
    /// EPnP, as the paper cites it; poor on planes, for reproduction only.
    Epnp,
}

/// Which hand-eye solver gives the result; the others stay in the panel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum HandEyeMethod {
    /// The adjustment of `method: precise`, in one problem with the cameras; starts from Tsai and Lenz.
    Refined,
    /// Tsai and Lenz (1989).
    Tsai,
    /// Park and Martin (1994).
    Park,
    /// Horaud and Dornaika (1995).
    Horaud,
    /// Andreff, Horaud and Espiau (1999).
    Andreff,
    /// Daniilidis (1999).
    Daniilidis,
    /// Shah (2013): both transforms, rotations first.
    Shah,
    /// Li, Wang and Wu (2010): both transforms at once; the most sensitive to noise.
    Li,
}

/// Settings of a solve.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// How corners are found.
    pub method: Method,
    /// Views with a larger RMS reprojection error are dropped once, then the rest is solved again; px.
    pub reject_view_above_px: f64,
    /// Fewest corners of a usable view.
    pub min_corners: usize,
    /// Board pose from a view.
    pub pnp: Pnp,
    /// The hand-eye solver that gives the result.
    pub hand_eye: HandEyeMethod,
    /// The camera that the hand-eye result is for; absent: event where present.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference_camera: Option<Camera>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            method: Method::Precise,
            reject_view_above_px: 0.75,
            min_corners: 6,
            pnp: Pnp::Ippe,
            hand_eye: HandEyeMethod::Refined,
            reference_camera: None,
        }
    }
}

impl Settings {
    /// The usual settings of a method.
    pub fn usual(method: Method) -> Self {
        let hand_eye = match method {
            Method::Paper => HandEyeMethod::Tsai,
            Method::Precise => HandEyeMethod::Refined,
        };
        Self { method, hand_eye, ..Self::default() }
    }

    /// The same with the usual solver for hand-eye, where that of the other method was usual.
    pub fn with_own_solver(self) -> Self {
        let hand_eye = match (self.method, self.hand_eye) {
            (Method::Precise, HandEyeMethod::Tsai) => HandEyeMethod::Refined,
            (Method::Paper, HandEyeMethod::Refined) => HandEyeMethod::Tsai,
            (Method::Precise | Method::Paper, chosen) => chosen,
        };
        Self { hand_eye, ..self }
    }

    /// Whether the solver for hand-eye goes with the method.
    pub fn check_method(&self) -> Result<(), String> {
        let fits = (self.method, self.hand_eye) != (Method::Paper, HandEyeMethod::Refined);
        if fits { Ok(()) } else { Err("hand_eye is refined, which needs method: precise".into()) }
    }

    /// Checks the ranges that a cell file keeps by itself. The error names key, value and range.
    pub fn check(&self) -> Result<(), String> {
        let Self { reject_view_above_px, min_corners, .. } = self;
        self.check_method()?;
        if !(0.05..=100.0).contains(reject_view_above_px) {
            return Err(format!("reject_view_above_px is {reject_view_above_px}, outside 0.05 to 100"));
        }
        if !(4..=1000).contains(min_corners) {
            return Err(format!("min_corners is {min_corners}, outside 4 to 1000"));
        }
        Ok(())
    }
}

/// Limits that a result must keep to pass; an absent gate is not judged.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gates {
    /// Largest RMS reprojection error of the frame camera, px.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rgb_rms_px: Option<f64>,
    /// Largest RMS reprojection error of the event camera, px.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub event_rms_px: Option<f64>,
    /// Largest RMS reprojection error of the stereo pair, px.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stereo_rms_px: Option<f64>,
    /// Smallest share of corners found, 0 to 1, each camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub corner_rate: Option<f64>,
    /// Largest standard deviation of the target-to-TCP distance, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target_to_tcp_sigma_m: Option<f64>,
    /// Largest error of the target-to-TCP distance at one pose, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target_to_tcp_max_m: Option<f64>,
    /// Largest |mean error| of the target-to-TCP distance, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target_to_tcp_bias_m: Option<f64>,
    /// Largest mean absolute error of the base-frame distances, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base_distance_mae_m: Option<f64>,
    /// Largest mean error of the displacement vectors, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base_vector_mae_m: Option<f64>,
    /// Largest distance between the translations of two hand-eye solvers, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub panel_spread_m: Option<f64>,
    /// Largest distance between the controller's pose of the flange and its kinematics or the URDF, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kinematics_m: Option<f64>,
    /// Largest angle between them, rad.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kinematics_rad: Option<f64>,
}
