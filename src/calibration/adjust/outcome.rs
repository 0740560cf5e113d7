//! What an adjustment says, as it stands in `result.json`.

use std::ops::Range;

use nalgebra::{Matrix6, Vector3};
use serde::{Deserialize, Serialize};

use super::lens::LENS;
use super::rig::Rig;
use super::se3;
use super::select::ModelScore;
use super::state::{LEFT, LENSES, RIGHT, SECOND, SHAPE, SHARED, SharedMatrix};

/// Standard deviations of which the larger of two counts.
pub trait Sigmas: Clone {
    /// The larger of each.
    fn larger(&self, other: &Self) -> Self;
}

/// A standard deviation from the weights and one from leaving poses out; the larger counts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Uncertain<S> {
    /// The larger of both, number by number.
    pub sigma: S,
    /// From the normal equations, with the noise that was found.
    pub formal: S,
    /// From leaving out one pose at a time; absent where one is indispensable.
    #[serde(default = "none", skip_serializing_if = "Option::is_none")]
    pub jackknife: Option<S>,
}

fn none<S>() -> Option<S> {
    None
}

impl<S: Sigmas> Uncertain<S> {
    pub(super) fn of(formal: S, jackknife: Option<S>) -> Self {
        let sigma = jackknife.as_ref().map_or_else(|| formal.clone(), |j| formal.larger(j));
        Self { sigma, formal, jackknife }
    }
}

/// Standard deviations of a camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LensSigma {
    /// Of fx, px.
    pub fx: f64,
    /// Of fy, px.
    pub fy: f64,
    /// Of cx, px.
    pub cx: f64,
    /// Of cy, px.
    pub cy: f64,
    /// Of k1, k2, p1, p2, k3; 0 for a term that is not solved.
    pub distortion: [f64; 5],
}

impl LensSigma {
    pub(super) fn of(covariance: &SharedMatrix, lens: &Range<usize>) -> Self {
        let sigma = |k: usize| covariance[(lens.start + k, lens.start + k)].sqrt();
        let distortion = std::array::from_fn(|k| sigma(4 + k));
        Self { fx: sigma(0), fy: sigma(1), cx: sigma(2), cy: sigma(3), distortion }
    }
}

impl Sigmas for LensSigma {
    fn larger(&self, other: &Self) -> Self {
        Self {
            fx: self.fx.max(other.fx),
            fy: self.fy.max(other.fy),
            cx: self.cx.max(other.cx),
            cy: self.cy.max(other.cy),
            distortion: std::array::from_fn(|k| self.distortion[k].max(other.distortion[k])),
        }
    }
}

/// Standard deviations of a transform.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlaceSigma {
    /// Of the translation along x, y, z, m.
    pub translation_m: [f64; 3],
    /// Of a turn about x, y, z, rad.
    pub rotation_rad: [f64; 3],
}

impl PlaceSigma {
    /// From the covariance of a step on the left of a transform with this translation.
    pub(super) fn of_step(covariance: &Matrix6<f64>, translation: &Vector3<f64>) -> Self {
        let mut to = Matrix6::identity();
        to.fixed_view_mut::<3, 3>(0, 3).copy_from(&-se3::hat(translation));
        let own = to * covariance * to.transpose();
        let sigma = |k: usize| own[(k, k)].max(0.0).sqrt();
        Self { translation_m: std::array::from_fn(sigma), rotation_rad: std::array::from_fn(|k| sigma(3 + k)) }
    }
}

impl Sigmas for PlaceSigma {
    fn larger(&self, other: &Self) -> Self {
        let max = |a: &[f64; 3], b: &[f64; 3]| std::array::from_fn(|k| a[k].max(b[k]));
        Self {
            translation_m: max(&self.translation_m, &other.translation_m),
            rotation_rad: max(&self.rotation_rad, &other.rotation_rad),
        }
    }
}

impl Sigmas for Vec<f64> {
    fn larger(&self, other: &Self) -> Self {
        self.iter().zip(other).map(|(a, b)| a.max(*b)).collect()
    }
}

impl Sigmas for f64 {
    fn larger(&self, other: &Self) -> Self {
        self.max(*other)
    }
}

/// A camera beyond its numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AdjustedLens {
    /// The terms of distortion that were solved, in words; the others are 0.
    pub distortion_model: String,
    /// Why these.
    pub chosen_by: String,
    /// Every model that was tried, simplest first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub models: Vec<ModelScore>,
    /// How sure the numbers are.
    pub sigma: Uncertain<LensSigma>,
    /// How much larger the errors of corners are than their covariance, or 0.1 px (rgb) and 0.45 px (event), says.
    pub corner_noise_factor: f64,
    /// Corners used.
    pub corners_used: usize,
    /// Corners of views that are used, but which did not fit themselves.
    pub corners_left_out: usize,
}

/// How the display is bent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DisplayShape {
    /// `flat`, `quadratic` or `cubic`.
    pub model: String,
    /// Names of the terms.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub terms: Vec<String>,
    /// Their sizes, m.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub terms_m: Vec<f64>,
    /// How sure they are, m.
    pub sigma_m: Uncertain<Vec<f64>>,
    /// What the terms mean.
    pub meaning: String,
    /// Why this model.
    pub chosen_by: String,
    /// Every model that was tried, simplest first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub models: Vec<ModelScore>,
}

/// The shared numbers of a rig and their covariance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Parameters {
    /// Names with units; steps of transforms act on the left, translation (m) before rotation (rad).
    pub names: Vec<String>,
    /// Covariance by the weights, row by row.
    pub covariance: Vec<Vec<f64>>,
    /// Standard deviations from leaving out one pose at a time; absent where one is indispensable.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jackknife_sigma: Option<Vec<f64>>,
}

impl Parameters {
    pub(super) fn of(rig: &Rig) -> Self {
        let (formal, jackknife) = rig.covariances();
        let solved: Vec<usize> = (0..SHARED).filter(|i| rig.fit.active.0[*i]).collect();
        let row = |i: &usize| solved.iter().map(|j| formal[(*i, *j)]).collect();
        Self {
            names: solved.iter().map(|i| name(rig, *i)).collect(),
            covariance: solved.iter().map(row).collect(),
            jackknife_sigma: jackknife.map(|c| solved.iter().map(|i| c[(*i, *i)].sqrt()).collect()),
        }
    }
}

fn name(rig: &Rig, i: usize) -> String {
    let step = |what: &str, k: usize| format!("{what}.{}", ["x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad"][k]);
    for (camera, lens) in rig.cameras.iter().zip(LENSES) {
        if lens.contains(&i) {
            let numbers: [&str; LENS] = ["fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3"];
            return format!("{camera}.{}", numbers[i - lens.start]);
        }
    }
    let [left, right] = rig.ends();
    match i {
        _ if SECOND.contains(&i) => step("event_from_rgb", i - SECOND.start),
        _ if SHAPE.contains(&i) => format!("shape.{}_m", i - SHAPE.start + 1),
        _ if LEFT.contains(&i) => step(&left, i - LEFT.start),
        _ => step(&right, i - RIGHT.start),
    }
}

/// How the robot's poses took part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RobotTie {
    /// In one problem with the cameras.
    Joint,
    /// After the cameras, which they would have pulled away: the arm is worse than noise.
    AfterCameras,
}

/// What the adjustment found about the loop of the robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LoopFacts {
    /// How the robot's poses took part.
    pub robot_tie: RobotTie,
    /// How far they pulled at the cameras against what noise would do: chi-squared over its 99 % limit; above 1 they
    /// stay apart.
    pub pull_on_cameras: f64,
    /// Noise of the robot's position along each axis, m; at least 0.02 mm.
    pub robot_sigma_m: f64,
    /// Noise of its orientation about each axis, rad; at least 20 urad.
    pub robot_sigma_rad: f64,
    /// How sure the place of the camera is, in the frame of its transform.
    pub camera: Uncertain<PlaceSigma>,
    /// How sure the place of the target is.
    pub target: Uncertain<PlaceSigma>,
    /// Expected error of points at the corners of the box around all board corners, in the frame of the camera's
    /// transform.
    pub points: Vec<PointError>,
    /// Expected error of the image of these points.
    pub image: Vec<ImageError>,
}

/// Expected error of a point that the camera sees.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PointError {
    /// The point, m.
    pub at_m: [f64; 3],
    /// In 95 of 100 calibrations like this one the error is at most this, m.
    pub error_95_m: f64,
}

/// Expected error of the image of a point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ImageError {
    /// The point, m.
    pub at_m: [f64; 3],
    /// In 95 of 100 calibrations like this one the error is at most this, px.
    pub error_95_px: f64,
}
