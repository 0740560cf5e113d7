//! Horaud and Dornaika (1995), closed form: rotation as the eigenvector of a 4 x 4 matrix of
//! quaternions, then translation by least squares.
//!
//! `q_A q = q q_B` on the vector parts, so motions count by `sin^2(theta/2)`: rotations near zero, whose
//! axes are noise, weigh nothing. (Their unit axes would let them count in full.)

use nalgebra::{Matrix4, Quaternion, UnitQuaternion, Vector3};

use super::motion::{Motion, Motions, smallest};

/// Rotation of the turned camera frame.
pub(super) fn rotation(motions: &Motions) -> Option<UnitQuaternion<f64>> {
    let sum = motions.list.iter().fold(Matrix4::zeros(), |sum, Motion { a, b }| {
        let m = left_minus_right(a.rotation.imag(), b.rotation.imag());
        sum + m.transpose() * m
    });
    UnitQuaternion::try_new(Quaternion::from(smallest(sum)?.1), 1e-9)
}

/// Matrix of `a q - q b` for pure quaternions a and b, on q as (x, y, z, w).
fn left_minus_right(a: Vector3<f64>, b: Vector3<f64>) -> Matrix4<f64> {
    let mut m = Matrix4::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(&(a + b).cross_matrix());
    m.fixed_view_mut::<3, 1>(0, 3).copy_from(&(a - b));
    m.fixed_view_mut::<1, 3>(3, 0).copy_from(&(b - a).transpose());
    m
}
