//! Tsai and Lenz (1989): rotation by linear least squares on the rotation axes, then translation.
//!
//! Their equation is `skew(p_A + p_B) x = p_B - p_A` with `p = 2 sin(theta/2) n` and
//! `x = tan(theta_X/2) n_X`. Here `p/2` is the vector part of the quaternion, which is regular at every
//! angle and weights each motion as theirs does; `x` grows without bound where the answer is a half
//! turn. So up to 178 deg the equations are theirs to the letter, and beyond that the camera frame is
//! turned first, which makes `x` nearly zero (see `motion`). OpenCV solves the same equations but leaves
//! out motions below 0.3 rad and above about 2.1 rad; with its choice the answers are equal to 1e-15.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

use super::motion::{Motion, Motions};
use crate::geometry::rotation::to_vector;

/// Largest angle of the answer that is solved for as it is, radians.
const LARGEST_RAD: f64 = 178.0 * std::f64::consts::PI / 180.0;

/// Rotation of the turned camera frame.
pub(super) fn rotation(motions: &Motions) -> Option<UnitQuaternion<f64>> {
    let as_it_is = to_vector(&motions.prior).norm() <= LARGEST_RAD;
    let turn = if as_it_is { motions.prior } else { UnitQuaternion::identity() };
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for Motion { a, b } in &motions.list {
        let (a, b) = (a.rotation.imag(), turn.inverse() * b.rotation.imag());
        let skew = (a + b).cross_matrix();
        normal += skew.transpose() * skew;
        right += skew.transpose() * (b - a);
    }
    let x = normal.cholesky()?.solve(&right);
    Some(UnitQuaternion::try_new(Quaternion::from_parts(1.0, x), 1e-9)? * turn.inverse())
}
