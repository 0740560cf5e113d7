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

/// Largest disagreement of two solvers that count (see [`HandEyeMethod::counts_in_spread`]); `None` for fewer than two.
pub fn panel_spread<S: Solution>(panel: &BTreeMap<HandEyeMethod, S>) -> Option<PanelSpread> {
    let cameras: Vec<_> = panel.iter().filter(|(m, _)| m.counts_in_spread()).map(|(_, s)| s.camera()).collect();
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
    /// Root mean square distance of the target from its mean, all poses, m.
    pub scatter_m: f64,
    /// The pose without which the others agree best: an outlier, if `scatter_without_m` is much smaller
    /// than `scatter_m`.
    pub culprit: Influence,
    /// The pose without which the camera moves farthest: an outlier, or one that holds up much alone.
    pub most_influential: Influence,
}

/// What leaving out one pose does.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Influence {
    /// Id of the pose.
    pub pose_id: String,
    /// How far the camera moves without it, m.
    pub translation_change_m: f64,
    /// How far the camera turns without it, rad.
    pub rotation_change_rad: f64,
    /// Root mean square distance of the target from its mean without it, m.
    pub scatter_without_m: f64,
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
///
/// `pose_ids` in the order of the pairs, to name the culprit.
pub fn jackknife<S: Solution>(
    method: HandEyeMethod,
    pairs: &[Pair],
    pose_ids: &[String],
) -> Result<Jackknife<S>, HandEyeError> {
    let full = S::solve(method, pairs)?;
    let (mut without, mut influences) = (Vec::new(), Vec::new());
    for (i, pose_id) in (0..pairs.len()).zip(pose_ids.iter().cloned().chain(std::iter::repeat(String::new()))) {
        let others: Vec<Pair> = pairs.iter().enumerate().filter(|(k, _)| *k != i).map(|(_, p)| *p).collect();
        let hangs = |why| HandEyeError::HangsOnOne { pair: i, why: Box::new(why) };
        let solution = S::solve(method, &others).map_err(hangs)?;
        influences.push(influence(pose_id, &full, &solution, &others));
        without.push(solution);
    }
    let scatter_m = scatter_m(&full, pairs);
    let uncertainty = uncertainty(&without, &influences, scatter_m).ok_or(super::breakdown(method, pairs.len()))?;
    Ok(Jackknife { uncertainty, without })
}

fn influence<S: Solution>(pose_id: String, full: &S, without: &S, others: &[Pair]) -> Influence {
    let (camera, moved) = (full.camera(), without.camera());
    Influence {
        pose_id,
        translation_change_m: (moved.translation.vector - camera.translation.vector).norm(),
        rotation_change_rad: rotation::angle_between_rad(&camera.rotation, &moved.rotation),
        scatter_without_m: scatter_m(without, others),
    }
}

/// Root mean square of the residuals in translation, m.
fn scatter_m<S: Solution>(solution: &S, pairs: &[Pair]) -> f64 {
    let squares = residuals(solution, pairs).iter().map(|r| r.translation_m * r.translation_m).sum::<f64>();
    (squares / pairs.len() as f64).sqrt()
}

/// Jackknife variance: `(n - 1) / n` times the sum of squares about the mean of the n answers.
fn uncertainty<S: Solution>(without: &[S], influences: &[Influence], scatter_m: f64) -> Option<Uncertainty> {
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
    let culprit = influences.iter().min_by(|a, b| a.scatter_without_m.total_cmp(&b.scatter_without_m));
    let influential = influences.iter().max_by(|a, b| a.translation_change_m.total_cmp(&b.translation_change_m));
    Some(Uncertainty {
        translation_sigma_m: translation.map(|sum| (factor * sum).sqrt()).into(),
        rotation_sigma_rad: (factor * rotation_sum).sqrt(),
        method: UncertaintyMethod::Jackknife,
        poses: cameras.len(),
        scatter_m,
        culprit: culprit?.clone(),
        most_influential: influential?.clone(),
    })
}
