//! How far an answer can be trusted: residuals per pair, the panel of solvers, and the jackknife.
//!
//! Formal covariance is far too optimistic (0.18 mm against 2.6 mm by jackknife on real data), so
//! uncertainty is what really changes when poses are left out.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};

use super::{HandEyeError, HandEyeMethod, METHODS, Pair, Solution, motion};
use crate::geometry::rotation;

/// How one pair differs from the mean of all.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Residual {
    /// Distance of the target's origin from its mean, m.
    pub translation_m: f64,
    /// Rotation of the target against its mean, rad.
    pub rotation_rad: f64,
}

/// Scatter of the target through the camera, one residual per pair, in order.
pub fn residuals<S: Solution>(solution: &S, pairs: &[Pair]) -> Vec<Residual> {
    let mean = solution.target();
    let residual = |pair: &Pair| {
        let seen = solution.target_by(pair);
        Residual {
            translation_m: (seen.translation.vector - mean.translation.vector).norm(),
            rotation_rad: rotation::angle_between_rad(&seen.rotation, &mean.rotation),
        }
    };
    pairs.iter().map(residual).collect()
}

/// Solves with every method: the answers, and the reasons of those without one.
pub fn panel<S: Solution>(pairs: &[Pair]) -> (BTreeMap<HandEyeMethod, S>, BTreeMap<HandEyeMethod, String>) {
    let (mut solved, mut failed) = (BTreeMap::new(), BTreeMap::new());
    for method in METHODS {
        match S::solve(method, pairs) {
            Ok(solution) => drop(solved.insert(method, solution)),
            Err(error) => drop(failed.insert(method, error.to_string())),
        }
    }
    (solved, failed)
}

/// How far the solvers of a panel disagree about the camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PanelSpread {
    /// Largest distance between two translations, m.
    pub translation_m: f64,
    /// Largest angle between two rotations, rad.
    pub rotation_rad: f64,
}

/// Largest disagreement of two solvers; `None` for fewer than two.
pub fn panel_spread<S: Solution>(panel: &BTreeMap<HandEyeMethod, S>) -> Option<PanelSpread> {
    let cameras: Vec<_> = panel.values().map(S::camera).collect();
    let both = |a: &Isometry3<f64>, b: &Isometry3<f64>| {
        let distance_m = (a.translation.vector - b.translation.vector).norm();
        (distance_m, rotation::angle_between_rad(&a.rotation, &b.rotation))
    };
    let gaps = cameras.iter().enumerate().flat_map(|(i, a)| cameras[..i].iter().map(move |b| both(a, b)));
    let larger = |(t, r): (f64, f64), (t2, r2): (f64, f64)| (t.max(t2), r.max(r2));
    gaps.reduce(larger).map(|(translation_m, rotation_rad)| PanelSpread { translation_m, rotation_rad })
}

/// How an uncertainty was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UncertaintyMethod {
    /// By leaving out one pose at a time.
    Jackknife,
}

/// Standard deviation of the camera's transform.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Uncertainty {
    /// Standard deviation of the translation along x, y, z of `base` (or `tcp`), m.
    pub translation_sigma_m: [f64; 3],
    /// Standard deviation of the rotation, all axes together, rad.
    pub rotation_sigma_rad: f64,
    /// How it was found.
    pub method: UncertaintyMethod,
    /// Number of poses.
    pub poses: usize,
    /// The pose that changes the answer most.
    pub culprit: Culprit,
}

/// The pose without which the answer changes most.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Culprit {
    /// Index in the pairs; after [`Uncertainty::named`] the id of the pose.
    pub pose_id: usize,
    /// How far the camera moves without it, m.
    pub translation_change_m: f64,
    /// How far the camera turns without it, rad.
    pub rotation_change_rad: f64,
}

/// The jackknife and the answers it went through.
#[derive(Debug, Clone, PartialEq)]
pub struct Jackknife<S> {
    /// What follows from them.
    pub uncertainty: Uncertainty,
    /// The answer without pair i, for each i in order: scores poses that were not in the fit.
    pub without: Vec<S>,
}

/// Leaves out one pair at a time; at least 4 pairs, and no pair may be indispensable.
pub fn jackknife<S: Solution>(method: HandEyeMethod, pairs: &[Pair]) -> Result<Jackknife<S>, HandEyeError> {
    let full = S::solve(method, pairs)?;
    let without = (0..pairs.len()).map(|i| solve_without(method, pairs, i)).collect::<Result<Vec<S>, _>>()?;
    let uncertainty = uncertainty(&full, &without).ok_or(super::breakdown(method, pairs.len()))?;
    Ok(Jackknife { uncertainty, without })
}

fn solve_without<S: Solution>(method: HandEyeMethod, pairs: &[Pair], left_out: usize) -> Result<S, HandEyeError> {
    let others: Vec<Pair> = pairs.iter().enumerate().filter(|(i, _)| *i != left_out).map(|(_, p)| *p).collect();
    S::solve(method, &others).map_err(|why| HandEyeError::HangsOnOne { pair: left_out, why: Box::new(why) })
}

/// Jackknife variance: `(n - 1) / n` times the sum of squares about the mean of the n answers.
fn uncertainty<S: Solution>(full: &S, without: &[S]) -> Option<Uncertainty> {
    let cameras: Vec<_> = without.iter().map(S::camera).collect();
    let mean = motion::mean(cameras.iter())?;
    let n = cameras.len() as f64;
    let (mut translation, mut rotation_sum) = (Vector3::zeros(), 0.0);
    for camera in &cameras {
        let off = camera.translation.vector - mean.translation.vector;
        translation += off.component_mul(&off);
        rotation_sum += rotation::angle_between_rad(&mean.rotation, &camera.rotation).powi(2);
    }
    let factor = (n - 1.0) / n;
    Some(Uncertainty {
        translation_sigma_m: translation.map(|sum| (factor * sum).sqrt()).into(),
        rotation_sigma_rad: (factor * rotation_sum).sqrt(),
        method: UncertaintyMethod::Jackknife,
        poses: cameras.len(),
        culprit: culprit(full, without)?,
    })
}

/// The pose without which the camera moves farthest.
fn culprit<S: Solution>(full: &S, without: &[S]) -> Option<Culprit> {
    let camera = full.camera();
    let change = |(pose_id, solution): (usize, &S)| {
        let other = solution.camera();
        Culprit {
            pose_id,
            translation_change_m: (other.translation.vector - camera.translation.vector).norm(),
            rotation_change_rad: rotation::angle_between_rad(&camera.rotation, &other.rotation),
        }
    };
    let larger = |a: &Culprit, b: &Culprit| a.translation_change_m.total_cmp(&b.translation_change_m);
    without.iter().enumerate().map(change).max_by(larger)
}

impl Uncertainty {
    /// The same, with the culprit named by the id of its pose; `pose_ids` in the order of the pairs.
    pub fn named(mut self, pose_ids: &[usize]) -> Self {
        self.culprit.pose_id = pose_ids.get(self.culprit.pose_id).copied().unwrap_or(self.culprit.pose_id);
        self
    }
}
