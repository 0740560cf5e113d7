//! Hand-eye on a whole session: pairs of poses, outliers, the panel, uncertainty.
//!
//! Generic over the two set-ups; uses `hand_eye`, `observability`, `cameras`.

use std::collections::BTreeMap;

use super::adjust::{LoopFacts, Refined};
use super::cameras::{self, SolvedCamera};
use super::hand_eye::{self, HandEyeMethod, Pair, Residual, Solution, Uncertainty};
use super::observability::{self, Observability};
use super::problem::Problem;
use super::settings::{Carried, PoseKind};
use crate::board::View;
use crate::geometry::{Camera, Sensor, Target, Transform};

/// A pose is an outlier when it lies this many times farther from where the others put it than the median does.
///
/// The length of a vector with three normal components has its median at 1.54 sigma: 4 medians are 6.2 sigma.
const OUTLIER_TIMES_MEDIAN: f64 = 4.0;
/// Scatter below this is never called an outlier, m.
const OUTLIER_FLOOR_M: f64 = 1e-3;
/// At most this share of the poses is left out.
const OUTLIER_SHARE: f64 = 0.25;

/// Hand-eye of one session.
#[derive(Debug, Clone)]
pub struct SolvedArm<S> {
    /// The answer.
    pub solution: S,
    /// The answers of all solvers that had one.
    pub panel: BTreeMap<HandEyeMethod, S>,
    /// Why the others had none.
    pub panel_failed: BTreeMap<HandEyeMethod, String>,
    /// Jackknife over the poses; absent where one pose is indispensable.
    pub uncertainty: Option<Uncertainty>,
    /// The answer without each pose used, by index of the pose.
    pub without: BTreeMap<usize, S>,
    /// Scatter of the target at each pose used, by index of the pose.
    pub residuals: BTreeMap<usize, Residual>,
    /// Poses that were left out as outliers, with the reason.
    pub rejected: BTreeMap<usize, String>,
    /// How well the rotations span space.
    pub observability: Observability,
    /// What the adjustment found, where the answer is its.
    pub refined: Option<LoopFacts>,
}

impl<S> SolvedArm<S> {
    /// The same poses and panel with the answer of the adjustment.
    pub fn with(self, refined: Refined<S>) -> Self {
        let Refined { solution, without, residuals, rejected, uncertainty, facts } = refined;
        Self { solution, without, residuals, rejected, uncertainty, refined: Some(facts), ..self }
    }
}

/// Robot pose and board pose of every pose that has both, by index of the pose.
///
/// A view that was too poor to solve the camera from still gives a board pose; it is left out where even the
/// board pose fits worse than twice the limit for views.
pub fn pairs(
    problem: &Problem,
    camera: Camera,
    solved: &SolvedCamera,
) -> (BTreeMap<usize, Pair>, BTreeMap<usize, String>) {
    let (mut found, mut missing) = (BTreeMap::new(), BTreeMap::new());
    for (index, pose) in problem.poses.iter().enumerate() {
        let (Some(base_from_tcp), Some(view)) = (pose.base_from_tcp, pose.views.get(&camera)) else { continue };
        match board_pose(problem, view, solved) {
            Ok(camera_from_target) => drop(found.insert(index, Pair { base_from_tcp, camera_from_target })),
            Err(why) => drop(missing.insert(index, format!("{camera}: {why}"))),
        }
    }
    (found, missing)
}

fn board_pose(problem: &Problem, view: &View, solved: &SolvedCamera) -> Result<Transform<Sensor, Target>, String> {
    cameras::usable(&problem.board, view, &problem.settings)?;
    let pose =
        cameras::board_pose(&problem.board, view, &solved.pinhole, problem.settings.pnp).map_err(|e| e.to_string())?;
    let limit_px = 2.0 * problem.settings.reject_view_above_px;
    let fits = pose.rms_px <= limit_px;
    if fits { Ok(pose.camera_from_target) } else { Err(format!("rms {:.2} px is above {limit_px} px", pose.rms_px)) }
}

/// Solves the set-up `S` from the poses that are for hand-eye.
pub fn solve<S: Solution>(problem: &Problem, pairs: &BTreeMap<usize, Pair>) -> Result<SolvedArm<S>, String> {
    let method = problem.settings.hand_eye;
    let is_for_fit = |(index, _): &(&usize, &Pair)| problem.poses[**index].kind == PoseKind::HandEye;
    let mut used: Vec<(usize, Pair)> = pairs.iter().filter(is_for_fit).map(|(i, p)| (*i, *p)).collect();
    let may_drop = (used.len() as f64 * OUTLIER_SHARE) as usize;
    let mut rejected = BTreeMap::new();
    while rejected.len() < may_drop {
        let Some((at, why)) = worst_outlier::<S>(method, &used) else { break };
        rejected.insert(used.remove(at).0, why);
    }
    let only: Vec<Pair> = used.iter().map(|(_, p)| *p).collect();
    let indices: Vec<usize> = used.iter().map(|(i, _)| *i).collect();
    let ids: Vec<String> = indices.iter().map(|i| problem.poses[*i].id.clone()).collect();
    let solution = S::solve(method, &only).map_err(|e| named(&e.to_string(), &ids))?;
    let (panel, panel_failed) = hand_eye::panel(&only);
    let jackknife = hand_eye::jackknife::<S>(method, &only, &ids).ok();
    let without = jackknife.as_ref().map(|j| indices.iter().copied().zip(j.without.clone()).collect());
    let residuals = indices.iter().copied().zip(hand_eye::residuals(&solution, &only)).collect();
    let poses: Vec<_> = only.iter().map(|p| p.base_from_tcp).collect();
    let observability = match problem.carried {
        Carried::Target => observability::carried_target(&poses),
        Carried::Cameras => observability::carried_cameras(&poses),
    };
    Ok(SolvedArm {
        solution,
        panel,
        panel_failed,
        uncertainty: jackknife.map(|j| j.uncertainty),
        without: without.unwrap_or_default(),
        residuals,
        rejected,
        observability: observability.map_err(|e| e.to_string())?,
        refined: None,
    })
}

/// Says which poses of the session an error is about, where it counts them in the set.
fn named(error: &str, ids: &[String]) -> String {
    format!("{error} (poses of the set: {})", ids.join(", "))
}

/// The pair that lies farthest from where the others put it, if that is far.
fn worst_outlier<S: Solution>(method: HandEyeMethod, used: &[(usize, Pair)]) -> Option<(usize, String)> {
    let off_m: Vec<f64> =
        (0..used.len()).map(|i| distance_from_others_m::<S>(method, used, i)).collect::<Option<_>>()?;
    let mut sorted = off_m.clone();
    sorted.sort_by(f64::total_cmp);
    let median_m = *sorted.get(sorted.len() / 2)?;
    let (at, worst_m) = off_m.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let outlier = worst_m > OUTLIER_FLOOR_M && worst_m > OUTLIER_TIMES_MEDIAN * median_m;
    let (worst_mm, median_mm) = (worst_m * 1e3, median_m * 1e3);
    outlier.then(|| {
        (at, format!("outlier: {worst_mm:.1} mm from where the other poses put the target (median {median_mm:.1} mm)"))
    })
}

fn distance_from_others_m<S: Solution>(method: HandEyeMethod, used: &[(usize, Pair)], at: usize) -> Option<f64> {
    let others: Vec<Pair> = used.iter().enumerate().filter(|(i, _)| *i != at).map(|(_, (_, p))| *p).collect();
    let solution = S::solve(method, &others).ok()?;
    let off = solution.target_by(&used[at].1).translation.vector - solution.target().translation.vector;
    Some(off.norm())
}
