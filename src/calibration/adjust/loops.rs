//! Hand-eye by the adjustment: both ends of the robot's loop, the noise of the arm, and every answer without one pose.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, Isometry3, Point3, Vector3};

use super::fit::Fit;
use super::normal::{LOOP, Weights};
use super::outcome::{ImageError, LoopFacts, PlaceSigma, PointError, RobotTie};
use super::propagate::{self, CameraPlace};
use super::rig::Rig;
use super::robot::{self, Ties};
use super::state::{LEFT, Loop, RIGHT, SECOND, SHARED, SharedMatrix, SharedVector, State};
use super::{leave_one_out, se3};
use crate::calibration::arm::{self, SolvedArm};
use crate::calibration::hand_eye::{
    self, EyeInHand, EyeToHand, Influence, Pair, Residual, Solution, Uncertainty, UncertaintyMethod,
};
use crate::calibration::problem::Problem;
use crate::geometry::{Camera, Transform, rotation};

/// Where the noise of the arm starts.
const START: (f64, f64) = (0.2e-3, 0.5e-3);
/// A robot pose is wrong when it is this many times farther off than the median; as for the closed forms.
const OUTLIER_TIMES_MEDIAN: f64 = 4.0;
/// Errors below these are never called wrong, m and rad.
const OUTLIER_FLOORS: [f64; 2] = [1e-3, 3e-3];
/// At most this share of the poses is left out.
const OUTLIER_SHARE: f64 = 0.25;

/// An answer that can be put together from both ends of the loop.
pub trait Ends: Solution {
    /// Whether the arm carries the cameras.
    const CARRIES_CAMERAS: bool;
    /// From the place of the camera and that of the target.
    fn of_ends(camera: Isometry3<f64>, target: Isometry3<f64>) -> Self;
}

impl Ends for EyeToHand {
    const CARRIES_CAMERAS: bool = false;
    fn of_ends(camera: Isometry3<f64>, target: Isometry3<f64>) -> Self {
        let (base_from_camera, tcp_from_target) = (Transform::assume_frames(camera), Transform::assume_frames(target));
        Self { base_from_camera, tcp_from_target }
    }
}

impl Ends for EyeInHand {
    const CARRIES_CAMERAS: bool = true;
    fn of_ends(camera: Isometry3<f64>, target: Isometry3<f64>) -> Self {
        let (tcp_from_camera, base_from_target) = (Transform::assume_frames(camera), Transform::assume_frames(target));
        Self { tcp_from_camera, base_from_target }
    }
}

/// The answer of the adjustment.
#[derive(Debug, Clone)]
pub struct Refined<S> {
    /// Where camera and target are.
    pub solution: S,
    /// The same without each pose used, by index of the pose.
    pub without: BTreeMap<usize, S>,
    /// Scatter of the target at each pose used, board poses from corners alone.
    pub residuals: BTreeMap<usize, Residual>,
    /// Poses that were left out, with the reason.
    pub rejected: BTreeMap<usize, String>,
    /// What changes when poses are left out; absent where everything hangs on one.
    pub uncertainty: Option<Uncertainty>,
    /// The rest.
    pub facts: LoopFacts,
}

/// Brings the robot's poses into a rig, starting from a closed form.
pub(super) fn refine<S: Ends>(rig: &mut Rig, problem: &Problem, reference: Camera) -> Result<Refined<S>, String> {
    let place = rig.place(reference).ok_or("the reference camera is not in the rig")?;
    let pairs = rig.pairs(problem, reference);
    let start = arm::solve::<S>(problem, &pairs)?;
    let mut fit = tied(rig, &start, place);
    let mut rejected = start.rejected.clone();
    rejected.extend(leave_out_wrong(&mut fit)?);
    let (facts_of_tie, pull) = bring_in(rig, fit)?;
    let camera = camera_place::<S>(rig, place);
    let solution = solution_of::<S>(&rig.fit.state, place);
    let pairs = rig.pairs(problem, reference);
    let used: Vec<(usize, Pair)> =
        tied_indices(rig).into_iter().filter_map(|(_, i)| Some((i, *pairs.get(&i)?))).collect();
    let only: Vec<Pair> = used.iter().map(|u| u.1).collect();
    let residuals = used.iter().map(|u| u.0).zip(hand_eye::residuals(&solution, &only)).collect();
    let without = without::<S>(rig, place);
    let facts = facts(rig, problem, &camera, &pairs, (facts_of_tie, pull));
    let uncertainty = uncertainty(problem, &solution, &without, &used, &facts);
    Ok(Refined { solution, without, residuals, rejected, uncertainty, facts })
}

/// The fit of a rig with the loop as the closed form has it, cameras fixed.
fn tied<S: Ends>(rig: &Rig, start: &SolvedArm<S>, place: usize) -> Fit {
    let kind = if S::CARRIES_CAMERAS { Loop::Cameras } else { Loop::Target };
    let (sigma_m, sigma_rad) = START;
    let mut fit = rig.fit.clone();
    let end_from_rig = start.solution.camera() * rig.camera_from_rig(place);
    (fit.state.left, fit.state.right) = match kind {
        Loop::Target => (end_from_rig, start.solution.target()),
        Loop::Cameras => (start.solution.target(), end_from_rig),
    };
    for sights in &mut fit.sights {
        sights.tied = sights.base_from_tcp.is_some() && start.residuals.contains_key(&sights.index);
    }
    fit.weights = Weights { ties: Some(Ties { kind, sigma_m, sigma_rad }), ..fit.weights };
    fit.active = super::state::Active::nothing();
    fit.active.set(LEFT, true);
    fit.active.set(RIGHT, true);
    fit
}

/// Solves the loop and leaves out robot poses that do not fit, the worst first.
fn leave_out_wrong(fit: &mut Fit) -> Result<BTreeMap<usize, String>, String> {
    let mut rejected = BTreeMap::new();
    let all = fit.sights.iter().filter(|s| s.tied).count();
    fit.go_and_reweight(false)?;
    while rejected.len() < (all as f64 * OUTLIER_SHARE) as usize {
        let Some((at, why)) = worst(fit) else { break };
        fit.sights[at].tied = false;
        rejected.insert(fit.sights[at].index, why);
        fit.go_and_reweight(false)?;
    }
    Ok(rejected)
}

fn worst(fit: &Fit) -> Option<(usize, String)> {
    let ties = fit.weights.ties?;
    let tied = fit.sights.iter().enumerate().filter(|(_, s)| s.tied);
    let off: Vec<(usize, [f64; 2])> =
        tied.filter_map(|(at, s)| Some((at, robot::lengths(&robot::error(&fit.state, at, s, ties.kind)?)))).collect();
    let median = |k: usize| {
        let mut sorted: Vec<f64> = off.iter().map(|(_, l)| l[k]).collect();
        sorted.sort_by(f64::total_cmp);
        sorted.get(sorted.len() / 2).copied()
    };
    let medians = [median(0)?, median(1)?];
    let times = |lengths: &[f64; 2]| {
        let one = |k: usize| lengths[k] / (OUTLIER_TIMES_MEDIAN * medians[k]).max(OUTLIER_FLOORS[k]);
        one(0).max(one(1))
    };
    let (at, lengths) = off.iter().max_by(|a, b| times(&a.1).total_cmp(&times(&b.1)))?;
    (times(lengths) > 1.0).then(|| {
        let [mm, mrad] = lengths.map(|l| l * 1e3);
        let [median_mm, median_mrad] = medians.map(|l| l * 1e3);
        let why = format!(
            "outlier: the robot's pose is {mm:.2} mm and {mrad:.2} mrad from where the others put it (median \
             {median_mm:.2} mm, {median_mrad:.2} mrad)"
        );
        (*at, why)
    })
}

/// Solves cameras and loop together, unless the arm pulls the cameras away; the rig keeps the answer.
fn bring_in(rig: &mut Rig, fixed: Fit) -> Result<(RobotTie, f64), String> {
    let mut joint = fixed.clone();
    joint.active = rig.fit.active.clone();
    joint.active.set(LEFT, true);
    joint.active.set(RIGHT, true);
    let solved = joint.go_and_reweight(false);
    let pull = solved.as_ref().ok().and_then(|a| pull(rig, &joint.state, &a.covariance)).unwrap_or(0.0);
    match solved {
        Ok(arrived) if pull <= 1.0 => {
            rig.steps = leave_one_out::steps(&arrived, &joint.active);
            (rig.fit, rig.arrived) = (joint, arrived);
            Ok((RobotTie::Joint, pull))
        }
        _ => after_cameras(rig, fixed, joint.active).map(|()| (RobotTie::AfterCameras, pull)),
    }
}

/// How far the robot pulled at the cameras, against chance.
fn pull(rig: &Rig, state: &State, after: &SharedMatrix) -> Option<f64> {
    let before = &rig.fit.state;
    let mut step = SharedVector::zeros();
    for (k, (a, b)) in state.lenses.iter().flatten().zip(before.lenses.iter().flatten()).enumerate() {
        step[k] = a - b;
    }
    let turned = state.second_from_first * before.second_from_first.inverse();
    let (t, w) = (turned.translation.vector, se3::rotation_log(&turned.rotation));
    let second = se3::left_jacobian_inverse(&w) * t;
    step.fixed_rows_mut::<3>(SECOND.start).copy_from(&second);
    step.fixed_rows_mut::<3>(SECOND.start + 3).copy_from(&w);
    for (k, (a, b)) in state.shape_m.iter().zip(&before.shape_m).enumerate() {
        step[super::state::SHAPE.start + k] = a - b;
    }
    let solved: Vec<usize> = (0..SHARED).filter(|i| rig.fit.active.0[*i]).collect();
    let of = |m: &SharedMatrix| DMatrix::from_fn(solved.len(), solved.len(), |i, j| m[(solved[i], solved[j])]);
    let step: Vec<f64> = solved.iter().map(|i| step[*i]).collect();
    propagate::hausman(&step, &of(&rig.arrived.covariance), &of(after))
}

/// Keeps the cameras, takes the loop, and adds what the cameras' uncertainty does to it.
fn after_cameras(rig: &mut Rig, mut fixed: Fit, all: super::state::Active) -> Result<(), String> {
    let loop_only = fixed.active.clone();
    let mut arrived = fixed.arrived()?;
    let own_steps = leave_one_out::steps(&arrived, &loop_only);
    fixed.active = all;
    let full = fixed.arrived().ok().ok_or("cameras and loop do not hang together")?;
    let gain = gain(&full.matrix, &arrived.covariance);
    arrived.covariance += gain * rig.arrived.covariance * gain.transpose();
    let mixed = gain * rig.arrived.covariance;
    arrived.covariance += rig.arrived.covariance + mixed + mixed.transpose();
    let both = |(own, cameras): (Option<SharedVector>, &Option<SharedVector>)| {
        let cameras = (*cameras)?;
        Some(own? + cameras + gain * cameras)
    };
    rig.steps = own_steps.into_iter().zip(&rig.steps).map(both).collect();
    // Board poses stay as the corners have them.
    fixed.state.poses.clone_from(&rig.fit.state.poses);
    (rig.fit, rig.arrived) = (fixed, arrived);
    Ok(())
}

/// How the ends of the loop follow the other shared numbers.
fn gain(matrix: &SharedMatrix, loop_covariance: &SharedMatrix) -> SharedMatrix {
    let mut coupling = *matrix;
    let ends = LEFT.start..RIGHT.end;
    for i in 0..SHARED {
        for j in (0..SHARED).filter(|j| !ends.contains(&i) || ends.contains(j)) {
            coupling[(i, j)] = 0.0;
        }
    }
    -(loop_covariance * coupling)
}

fn tied_indices(rig: &Rig) -> Vec<(usize, usize)> {
    rig.fit.sights.iter().enumerate().filter(|(_, s)| s.tied).map(|(at, s)| (at, s.index)).collect()
}

fn solution_of<S: Ends>(state: &State, place: usize) -> S {
    let camera_from_rig = if place == 0 { Isometry3::identity() } else { state.second_from_first };
    let (end_from_rig, target) = if S::CARRIES_CAMERAS { (state.right, state.left) } else { (state.left, state.right) };
    S::of_ends(end_from_rig * camera_from_rig.inverse(), target)
}

fn camera_place<S: Ends>(rig: &Rig, place: usize) -> CameraPlace {
    let state = &rig.fit.state;
    let (end, at) = if S::CARRIES_CAMERAS { (state.right, LOOP[1]) } else { (state.left, LOOP[0]) };
    CameraPlace::of(rig, &end, at, place)
}

fn without<S: Ends>(rig: &Rig, place: usize) -> BTreeMap<usize, S> {
    let one = |(at, index): (usize, usize)| {
        let state = leave_one_out::state_without(&rig.fit, rig.steps[at].as_ref()?);
        Some((index, solution_of::<S>(&state, place)))
    };
    tied_indices(rig).into_iter().filter_map(one).collect()
}

fn facts(
    rig: &Rig,
    problem: &Problem,
    camera: &CameraPlace,
    pairs: &BTreeMap<usize, Pair>,
    tie: (RobotTie, f64),
) -> LoopFacts {
    let ties = rig.fit.weights.ties.unwrap_or(Ties { kind: Loop::Target, sigma_m: 0.0, sigma_rad: 0.0 });
    let (target, at) = match ties.kind {
        Loop::Target => (&rig.fit.state.right, RIGHT.start),
        Loop::Cameras => (&rig.fit.state.left, LEFT.start),
    };
    let target_sigma =
        |c: &SharedMatrix| PlaceSigma::of_step(&c.fixed_view::<6, 6>(at, at).into_owned(), &target.translation.vector);
    let corners = box_of(problem, &camera.place, pairs);
    LoopFacts {
        robot_tie: tie.0,
        pull_on_cameras: tie.1,
        robot_sigma_m: ties.sigma_m,
        robot_sigma_rad: ties.sigma_rad,
        camera: rig.uncertain(|c| camera.sigma(c)),
        target: rig.uncertain(target_sigma),
        points: corners.iter().map(|p| point_error(rig, camera, p)).collect(),
        image: corners.iter().filter_map(|p| image_error(rig, camera, p)).collect(),
    }
}

/// By the covariance that gives the larger error, formal or jackknife.
fn point_error(rig: &Rig, camera: &CameraPlace, at: &Vector3<f64>) -> PointError {
    let both = rig.uncertain(|c| camera.point_error_95_m(c, at));
    PointError { at_m: (*at).into(), error_95_m: both.sigma }
}

/// The same for the image; `None` behind the camera.
fn image_error(rig: &Rig, camera: &CameraPlace, at: &Vector3<f64>) -> Option<ImageError> {
    camera.image_error_95_px(rig, &rig.arrived.covariance, at)?;
    let both = rig.uncertain(|c| camera.image_error_95_px(rig, c, at).unwrap_or(0.0));
    Some(ImageError { at_m: (*at).into(), error_95_px: both.sigma })
}

/// The corners of the box around all board corners at all poses, in the frame of the camera's transform.
fn box_of(problem: &Problem, place: &Isometry3<f64>, pairs: &BTreeMap<usize, Pair>) -> Vec<Vector3<f64>> {
    let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    for pair in pairs.values() {
        for corner in (0..problem.board.corner_count() as u32).filter_map(|id| problem.board.corner(id)) {
            let in_camera = (pair.camera_from_target * corner).coords_m();
            let at = (place * Point3::from(in_camera)).coords;
            (low, high) = (low.inf(&at), high.sup(&at));
        }
    }
    let end = |bits: usize, k: usize| if bits >> k & 1 == 0 { low[k] } else { high[k] };
    (0..8).map(|bits| Vector3::new(end(bits, 0), end(bits, 1), end(bits, 2))).collect()
}

/// The jackknife in the words of the closed forms; the larger of both sigmas.
fn uncertainty<S: Ends>(
    problem: &Problem,
    solution: &S,
    without: &BTreeMap<usize, S>,
    used: &[(usize, Pair)],
    facts: &LoopFacts,
) -> Option<Uncertainty> {
    let complete = without.len() == used.len() && used.len() > 1 && facts.camera.jackknife.is_some();
    if !complete {
        return None;
    }
    let scatter_m = |s: &S, pairs: &[Pair]| {
        let squares = hand_eye::residuals(s, pairs).iter().map(|r| r.translation_m.powi(2)).sum::<f64>();
        (squares / pairs.len() as f64).sqrt()
    };
    let influence = |(index, _): &(usize, Pair)| {
        let others: Vec<Pair> = used.iter().filter(|(i, _)| i != index).map(|u| u.1).collect();
        let (now, then) = (solution.camera(), without[index].camera());
        Influence {
            pose_id: problem.poses[*index].id.clone(),
            translation_change_m: (then.translation.vector - now.translation.vector).norm(),
            rotation_change_rad: rotation::angle_between_rad(&now.rotation, &then.rotation),
            scatter_without_m: scatter_m(&without[index], &others),
        }
    };
    let influences: Vec<Influence> = used.iter().map(influence).collect();
    let culprit = influences.iter().min_by(|a, b| a.scatter_without_m.total_cmp(&b.scatter_without_m))?;
    let most = influences.iter().max_by(|a, b| a.translation_change_m.total_cmp(&b.translation_change_m))?;
    let only: Vec<Pair> = used.iter().map(|u| u.1).collect();
    let sigma = &facts.camera.sigma;
    Some(Uncertainty {
        translation_sigma_m: sigma.translation_m,
        rotation_sigma_rad: Vector3::from(sigma.rotation_rad).norm(),
        method: UncertaintyMethod::Jackknife,
        poses: used.len(),
        scatter_m: scatter_m(solution, &only),
        culprit: culprit.clone(),
        most_influential: most.clone(),
    })
}
