//! Park and Martin (1994): rotation from the logarithms of the motions, then translation.
//!
//! `log R_A = R log R_B` for every motion, weighted by the angle. Their `(M^T M)^(-1/2) M^T` is taken as
//! the nearest rotation by singular values, which is the same where theirs exists and stays right for
//! two motions, where `M` has rank 2.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::motion::{Motion, Motions};
use crate::geometry::rotation::from_matrix;

/// Rotation of the turned camera frame.
pub(super) fn rotation(motions: &Motions) -> Option<UnitQuaternion<f64>> {
    let sum = motions.list.iter().fold(Matrix3::zeros(), |sum, Motion { a, b }| {
        sum + logarithm(&a.rotation) * logarithm(&b.rotation).transpose()
    });
    from_matrix(&sum)
}

/// Rotation vector in radians without a change of sign: a little over pi where w < 0, so that motions
/// on the same side of the quaternion sphere have logarithms that are near.
fn logarithm(q: &UnitQuaternion<f64>) -> Vector3<f64> {
    let (w, v) = (q.w, q.imag());
    let sine = v.norm();
    // Below 1e-9 the quotient 2 atan2(s, w) / s is 2 / w to full precision.
    if sine < 1e-9 { v * (2.0 / w) } else { v * (2.0 * sine.atan2(w) / sine) }
}
