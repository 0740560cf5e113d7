//! Where the adjustment starts: rigs of cameras that share poses, and the board at each pose by PnP.

use std::collections::BTreeMap;

use nalgebra::Isometry3;

use super::data::{self, PoseSights};
use super::lens;
use super::normal::{self, Weights};
use super::shape::{Basis, TERMS};
use super::state::State;
use crate::calibration::cameras::{self, SolvedCamera};
use crate::calibration::problem::Problem;
use crate::calibration::settings::PoseKind;
use crate::geometry::{Camera, Pinhole, rotation};

/// Fewest poses that both cameras of a rig see.
const MIN_SHARED: usize = 3;
/// Corners count as this many sigma wide while poses are compared.
const LOOSE: f64 = 10.0;

/// A rig before it is solved.
#[derive(Debug, Clone)]
pub(super) struct Start {
    /// One camera or both; the first is the frame of the rig.
    pub(super) cameras: Vec<Camera>,
    /// Their first solves, or what was taken over.
    pub(super) pinholes: Vec<Pinhole>,
    /// What was seen.
    pub(super) sights: Vec<PoseSights>,
    /// Where it starts.
    pub(super) state: State,
}

impl Start {
    /// The cameras in words.
    pub(super) fn names(&self) -> String {
        self.cameras.iter().map(|c| c.name()).collect::<Vec<_>>().join(" and ")
    }
}

type Seen = BTreeMap<usize, Isometry3<f64>>;

/// One rig of both cameras where they share poses, else a rig for each.
pub(super) fn rigs(problem: &Problem, solved: &BTreeMap<Camera, SolvedCamera>) -> Vec<Start> {
    let seen: Vec<(Camera, Pinhole, Seen)> =
        solved.iter().map(|(c, s)| (*c, s.pinhole, board_poses(problem, *c, &s.pinhole))).collect();
    if let [(_, _, first), (_, _, second)] = seen.as_slice()
        && first.keys().filter(|k| second.contains_key(k)).count() >= MIN_SHARED
    {
        return rig(problem, &seen).into_iter().collect();
    }
    seen.iter().filter_map(|one| rig(problem, std::slice::from_ref(one))).collect()
}

/// The board before one camera at every pose that has a usable view.
fn board_poses(problem: &Problem, camera: Camera, pinhole: &Pinhole) -> Seen {
    let mut seen = Seen::new();
    for (index, pose) in problem.poses.iter().enumerate() {
        let Some(view) = pose.views.get(&camera) else { continue };
        let usable = cameras::usable(&problem.board, view, &problem.settings).is_ok();
        if let (true, Ok(found)) = (usable, cameras::board_pose(&problem.board, view, pinhole, problem.settings.pnp)) {
            let finite = found.camera_from_target.is_finite() && found.camera_from_target.translation_m()[2] > 0.0;
            finite.then(|| seen.insert(index, *found.camera_from_target.iso()));
        }
    }
    seen
}

fn rig(problem: &Problem, seen: &[(Camera, Pinhole, Seen)]) -> Option<Start> {
    let (_, first, _) = seen.first()?;
    let second = seen.get(1);
    let known = problem.known.as_ref().and_then(|k| k.event_from_rgb).map(|t| *t.iso());
    let second_from_first = match second {
        Some((_, _, poses)) => known.or_else(|| most_agreed(&seen[0].2, poses))?,
        None => Isometry3::identity(),
    };
    let mut state = State {
        lenses: [lens::of_pinhole(first), lens::of_pinhole(second.map_or(first, |s| &s.1))],
        second_from_first,
        shape_m: [0.0; TERMS],
        left: Isometry3::identity(),
        right: Isometry3::identity(),
        poses: Vec::new(),
    };
    let mut sights = Vec::new();
    for index in 0..problem.poses.len() {
        let candidates: Vec<_> = seen.iter().enumerate().filter_map(|(c, s)| Some((c, *s.2.get(&index)?))).collect();
        if candidates.is_empty() {
            continue;
        }
        let one = pose_sights(problem, seen, index);
        state.poses.push(best_pose(&state, &one, &candidates));
        sights.push(one);
    }
    let cameras = seen.iter().map(|s| s.0).collect();
    Some(Start { cameras, pinholes: seen.iter().map(|s| s.1).collect(), sights, state })
}

fn pose_sights(problem: &Problem, seen: &[(Camera, Pinhole, Seen)], index: usize) -> PoseSights {
    let pose = &problem.poses[index];
    let basis = Basis::of(&problem.board);
    let mut views = [Vec::new(), Vec::new()];
    for ((camera, _, poses), to) in seen.iter().zip(&mut views) {
        if let (true, Some(view)) = (poses.contains_key(&index), pose.views.get(camera)) {
            *to = data::sights(&problem.board, &basis, *camera, view);
        }
    }
    let robot = pose.base_from_tcp.filter(|_| problem.robot_poses && pose.kind == PoseKind::HandEye);
    PoseSights { index, id: pose.id.clone(), views, base_from_tcp: robot.map(|t| *t.iso()), tied: false }
}

/// The board pose of one of the cameras that suits both better: a plane has two in one view.
fn best_pose(state: &State, sights: &PoseSights, candidates: &[(usize, Isometry3<f64>)]) -> Isometry3<f64> {
    let weights = Weights { scale: [LOOSE; 2], ties: None };
    let mut best = (f64::INFINITY, Isometry3::identity());
    for (camera, camera_from_target) in candidates {
        let rig_from_camera = if *camera == 0 { Isometry3::identity() } else { state.second_from_first.inverse() };
        let pose = rig_from_camera * camera_from_target;
        let trial = super::pose::alone(state, pose);
        let cost = normal::pose_cost(&trial, 0, sights, &weights);
        if cost <= best.0 {
            best = (cost, pose);
        }
    }
    best.1
}

/// Of what each pose says about the second camera, that which lies nearest to all others.
fn most_agreed(first: &Seen, second: &Seen) -> Option<Isometry3<f64>> {
    let each: Vec<_> = first.iter().filter_map(|(i, a)| Some(second.get(i)? * a.inverse())).collect();
    let distance = |a: &Isometry3<f64>, b: &Isometry3<f64>| {
        let far = (a.translation.vector - b.translation.vector).norm() / 0.01;
        (far + rotation::angle_between_rad(&a.rotation, &b.rotation) / 0.02).min(1.0)
    };
    let sum = |a: &Isometry3<f64>| each.iter().map(|b| distance(a, b)).sum::<f64>();
    each.iter().min_by(|a, b| sum(a).total_cmp(&sum(b))).copied()
}
