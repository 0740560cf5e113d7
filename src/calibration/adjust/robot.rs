//! The loop of the robot: what its poses say about camera and target, softly.
//!
//! At each hand-eye pose `tcp_from_base * left * M * right^-1` should be the identity, where M is the board
//! before the rig, or its inverse where the cameras are carried. What is left is the error of the robot's pose,
//! in `tcp`, with a noise of its own for translation and rotation, estimated with everything else.

use nalgebra::{Isometry3, Matrix6, Vector3, Vector6};

use super::data::PoseSights;
use super::normal::{JointCovariance, LOOP, PoseNormal};
use super::se3;
use super::state::{Active, Loop, SHARED, State};

/// Smallest noise of a robot's pose, m and rad: below it, other things are worse.
pub(super) const FLOOR_M: f64 = 0.02e-3;
/// The same for its rotation, rad.
pub(super) const FLOOR_RAD: f64 = 20e-6;

/// How the robot's poses enter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ties {
    /// Which end is what.
    pub(super) kind: Loop,
    /// Noise of a robot's pose along each axis, m.
    pub(super) sigma_m: f64,
    /// Noise about each axis, rad.
    pub(super) sigma_rad: f64,
}

impl Ties {
    fn weights(&self) -> [f64; 6] {
        let (t, r) = (1.0 / (self.sigma_m * self.sigma_m), 1.0 / (self.sigma_rad * self.sigma_rad));
        [t, t, t, r, r, r]
    }
}

/// The error of the robot's pose, as the rest has it: translation (m) and rotation vector (rad) in `tcp`.
pub(super) fn error(state: &State, at: usize, sights: &PoseSights, kind: Loop) -> Option<Vector6<f64>> {
    let gap = gap(state, at, &sights.base_from_tcp?, kind).0;
    let (t, w) = (gap.translation.vector, se3::rotation_log(&gap.rotation));
    Some(Vector6::new(t.x, t.y, t.z, w.x, w.y, w.z))
}

/// The loop, and the part of it before the step of the pose.
fn gap(state: &State, at: usize, base_from_tcp: &Isometry3<f64>, kind: Loop) -> (Isometry3<f64>, Isometry3<f64>) {
    let before = base_from_tcp.inverse() * state.left;
    let (middle, before_pose) = match kind {
        Loop::Target => (state.poses[at], before),
        Loop::Cameras => {
            let middle = state.poses[at].inverse();
            (middle, before * middle)
        }
    };
    (before * middle * state.right.inverse(), before_pose)
}

/// Weighted square of the error; 0 where the robot's pose does not enter.
pub(super) fn cost(state: &State, at: usize, sights: &PoseSights, ties: &Ties) -> f64 {
    let Some(error) = error(state, at, sights, ties.kind).filter(|_| sights.tied) else { return 0.0 };
    error.iter().zip(ties.weights()).map(|(e, w)| e * e * w).sum()
}

/// Error with its derivatives by left end, right end and pose.
pub(super) struct Slopes {
    error: Vector6<f64>,
    ends: [Matrix6<f64>; 2],
    pose: Matrix6<f64>,
}

/// Derivatives of the error at one pose.
pub(super) fn slopes(state: &State, at: usize, sights: &PoseSights, kind: Loop) -> Option<Slopes> {
    let base_from_tcp = sights.base_from_tcp?;
    let (gap, before_pose) = gap(state, at, &base_from_tcp, kind);
    let t = gap.translation.vector;
    let w = se3::rotation_log(&gap.rotation);
    let mut by_step = Matrix6::identity();
    by_step.fixed_view_mut::<3, 3>(0, 3).copy_from(&-se3::hat(&t));
    by_step.fixed_view_mut::<3, 3>(3, 3).copy_from(&se3::left_jacobian_inverse(&w));
    let sign = match kind {
        Loop::Target => 1.0,
        Loop::Cameras => -1.0,
    };
    let left = by_step * se3::adjoint(&base_from_tcp.inverse());
    let right = -(by_step * se3::adjoint(&gap));
    let pose = by_step * se3::adjoint(&before_pose) * sign;
    Some(Slopes { error: Vector6::new(t.x, t.y, t.z, w.x, w.y, w.z), ends: [left, right], pose })
}

/// Adds the robot's pose to the normal equations of its pose.
pub(super) fn add(
    normal: &mut PoseNormal,
    state: &State,
    at: usize,
    sights: &PoseSights,
    ties: &Ties,
    active: &Active,
) {
    let Some(slopes) = slopes(state, at, sights, ties.kind).filter(|_| sights.tied) else { return };
    let weights = Matrix6::from_diagonal(&Vector6::from(ties.weights()));
    for (i, by_end) in slopes.ends.iter().enumerate() {
        if !active.0[LOOP[i]] {
            continue;
        }
        let weighted = by_end.transpose() * weights;
        let mut pull = normal.pull.fixed_rows_mut::<6>(LOOP[i]);
        pull -= weighted * slopes.error;
        let mut mixed = normal.mixed.fixed_rows_mut::<6>(LOOP[i]);
        mixed += weighted * slopes.pose;
        for (j, other) in slopes.ends.iter().enumerate().filter(|(j, _)| active.0[LOOP[*j]]) {
            let mut block = normal.shared.fixed_view_mut::<6, 6>(LOOP[i], LOOP[j]);
            block += weighted * other;
        }
    }
    let weighted = slopes.pose.transpose() * weights;
    normal.pose += weighted * slopes.pose;
    normal.pose_pull -= weighted * slopes.error;
}

/// How many unknowns the translations and the rotations of one robot's pose pay for.
pub(super) fn unknowns_paid(
    state: &State,
    at: usize,
    sights: &PoseSights,
    ties: &Ties,
    joint: &JointCovariance<'_>,
) -> [f64; 2] {
    let Some(slopes) = slopes(state, at, sights, ties.kind).filter(|_| sights.tied) else { return [0.0; 2] };
    let mut by_shared = nalgebra::SMatrix::<f64, 6, SHARED>::zeros();
    for (i, by_end) in slopes.ends.iter().enumerate() {
        by_shared.fixed_columns_mut::<6>(LOOP[i]).copy_from(by_end);
    }
    let mixed = by_shared * joint.mixed * slopes.pose.transpose();
    let explained = by_shared * joint.shared * by_shared.transpose()
        + mixed
        + mixed.transpose()
        + slopes.pose * joint.pose * slopes.pose.transpose();
    let weights = ties.weights();
    let paid = |rows: std::ops::Range<usize>| rows.map(|i| explained[(i, i)] * weights[i]).sum::<f64>();
    [paid(0..3), paid(3..6)]
}

/// Length of translation and rotation of an error.
pub(super) fn lengths(error: &Vector6<f64>) -> [f64; 2] {
    let (t, w): (Vector3<f64>, Vector3<f64>) = se3::halves(error);
    [t.norm(), w.norm()]
}
