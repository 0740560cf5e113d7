//! The unknowns: which there are, where they stand in the shared vector, and how a step changes them.

use std::ops::Range;

use nalgebra::{Isometry3, SMatrix, SVector, Vector6};

use super::lens::{Distortion, LENS, Lens};
use super::se3;
use super::shape::{PRIOR_SIGMA_M, Shape, TERMS};

/// Numbers that all poses share: two lenses, the second camera, the shape, both ends of the robot's loop.
pub(super) const SHARED: usize = 2 * LENS + 6 + TERMS + 12;
/// The lens of a camera of the rig.
pub(super) const LENSES: [Range<usize>; 2] = [0..LENS, LENS..2 * LENS];
/// Step of `second_from_first`.
pub(super) const SECOND: Range<usize> = 2 * LENS..2 * LENS + 6;
/// The shape of the board.
pub(super) const SHAPE: Range<usize> = 2 * LENS + 6..2 * LENS + 6 + TERMS;
/// Step of the left end of the loop.
pub(super) const LEFT: Range<usize> = SHAPE.end..SHAPE.end + 6;
/// Step of its right end.
pub(super) const RIGHT: Range<usize> = LEFT.end..LEFT.end + 6;

/// A step of the shared numbers, or what pulls at them.
pub(super) type SharedVector = SVector<f64, SHARED>;
/// Normal equations or covariance of the shared numbers.
pub(super) type SharedMatrix = SMatrix<f64, SHARED, SHARED>;

/// Which end of the loop of the robot is what.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Loop {
    /// The arm carries the target: `base_from_rig`, `tcp_from_target`.
    Target,
    /// The arm carries the cameras: `base_from_target`, `tcp_from_rig`.
    Cameras,
}

/// Everything that is solved.
#[derive(Debug, Clone)]
pub(super) struct State {
    /// The lenses; the second is meaningless in a rig of one.
    pub(super) lenses: [Lens; 2],
    /// The second camera before the first.
    pub(super) second_from_first: Isometry3<f64>,
    /// Terms of the board's shape, m.
    pub(super) shape_m: [f64; TERMS],
    /// Left end of the loop: `base_from_rig`, or `base_from_target`.
    pub(super) left: Isometry3<f64>,
    /// Right end: `tcp_from_target`, or `tcp_from_rig`.
    pub(super) right: Isometry3<f64>,
    /// `rig_from_target` at each pose; the rig is its first camera.
    pub(super) poses: Vec<Isometry3<f64>>,
}

impl State {
    /// Takes a step of the shared numbers.
    pub(super) fn step_shared(&mut self, step: &SharedVector) {
        for (lens, range) in self.lenses.iter_mut().zip(LENSES) {
            lens.iter_mut().zip(&step.as_slice()[range]).for_each(|(l, d)| *l += d);
        }
        self.shape_m.iter_mut().zip(&step.as_slice()[SHAPE]).for_each(|(z, d)| *z += d);
        for (motion, range) in [(&mut self.second_from_first, SECOND), (&mut self.left, LEFT), (&mut self.right, RIGHT)]
        {
            *motion = moved(motion, &six(step, range));
        }
    }
}

/// A motion after a step on its left.
pub(super) fn moved(motion: &Isometry3<f64>, step: &Vector6<f64>) -> Isometry3<f64> {
    let mut moved = se3::exp(step) * motion;
    moved.rotation.renormalize();
    moved
}

/// Six of the shared numbers.
pub(super) fn six(step: &SharedVector, range: Range<usize>) -> Vector6<f64> {
    Vector6::from_column_slice(&step.as_slice()[range])
}

/// Which of the shared numbers are solved.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Active(pub(super) [bool; SHARED]);

impl Active {
    /// Nothing but the poses.
    pub(super) fn nothing() -> Self {
        Self([false; SHARED])
    }

    /// Solves these numbers, or no longer.
    pub(super) fn set(&mut self, range: Range<usize>, solved: bool) {
        self.0[range].fill(solved);
    }

    /// Solves the lens of a camera with these terms, and no others.
    pub(super) fn set_lens(&mut self, camera: usize, distortion: Distortion) {
        let start = LENSES[camera].start;
        self.set(start..start + LENS, false);
        self.set(start..start + 4 + distortion.terms(), true);
    }

    /// Solves these terms of the shape, and no others.
    pub(super) fn set_shape(&mut self, shape: Shape) {
        self.set(SHAPE, false);
        self.set(SHAPE.start..SHAPE.start + shape.terms(), true);
    }
}

/// What a term of the shape is held to 0 with, 1/m2.
pub(super) fn shape_prior() -> f64 {
    1.0 / (PRIOR_SIGMA_M * PRIOR_SIGMA_M)
}
