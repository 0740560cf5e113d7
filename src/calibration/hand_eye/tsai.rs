//! Tsai and Lenz (1989): rotation by linear least squares on the rotation axes, then translation.
//!
//! Their equation is `skew(p_A + p_B) x = p_B - p_A` with `p = 2 sin(theta/2) n` and
//! `x = tan(theta_X/2) n_X`; the answer's `x` grows without bound at half turns. Here `p/2` is the vector
//! part of the quaternion, which is regular at every angle and weights each motion as theirs does, and
//! `x` is near zero because the camera frame was turned first (see `motion`). With a turn of zero the
//! equations are theirs to the letter.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

use super::motion::{Motion, Motions};

/// Rotation of the turned camera frame.
pub(super) fn rotation(motions: &Motions) -> Option<UnitQuaternion<f64>> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for Motion { a, b } in &motions.list {
        let (a, b) = (a.rotation.imag(), b.rotation.imag());
        let skew = (a + b).cross_matrix();
        normal += skew.transpose() * skew;
        right += skew.transpose() * (b - a);
    }
    let x = normal.cholesky()?.solve(&right);
    UnitQuaternion::try_new(Quaternion::from_parts(1.0, x), 1e-9)
}
