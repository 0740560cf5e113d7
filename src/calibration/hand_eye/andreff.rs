//! Andreff, Horaud and Espiau (1999): the nine numbers of the rotation matrix from a linear system of
//! Kronecker products, made a rotation afterwards, then translation.
//!
//! No quaternion and no angle enters, so nothing is special at 0 or at 180 deg: this is also the rough
//! rotation that the other solvers start from.

use nalgebra::{Isometry3, Matrix3, SMatrix, UnitQuaternion};

use super::motion::{Motion, Motions};
use crate::geometry::rotation::from_matrix;

/// Smallest uniqueness that is solved. Observable sets have 0.04 and more; poses that differ by half turns
/// only, which several rotations explain, have 0 without noise.
pub(super) const MIN_UNIQUENESS: f64 = 0.01;

/// What the linear system says.
pub(super) struct Linear {
    /// The nearest rotation.
    pub(super) rotation: UnitQuaternion<f64>,
    /// Second smallest singular value over the largest: 0 where several rotations fit.
    pub(super) uniqueness: f64,
}

/// Rotation of the turned camera frame.
pub(super) fn rotation(motions: &Motions) -> Option<UnitQuaternion<f64>> {
    linear(&motions.list).map(|l| l.rotation)
}

/// Solves `R_A X - X R_B = 0` for a unit vector of nine numbers; `None` if that breaks down.
pub(super) fn linear(motions: &[Motion]) -> Option<Linear> {
    let normal = motions.iter().fold(SMatrix::<f64, 9, 9>::zeros(), |sum, Motion { a, b }| {
        let m = difference(a, b);
        sum + m.transpose() * m
    });
    if !normal.iter().all(|v| v.is_finite()) {
        return None;
    }
    let eigen = normal.try_symmetric_eigen(f64::EPSILON, 1000)?;
    let mut order: [usize; 9] = std::array::from_fn(|i| i);
    order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
    let null = eigen.eigenvectors.column(order[0]);
    let x = Matrix3::from_column_slice(null.as_slice());
    let rotation = from_matrix(&(x * x.determinant().signum()))?;
    let [second, largest] = [order[1], order[8]].map(|i| eigen.eigenvalues[i].max(0.0).sqrt());
    Some(Linear { rotation, uniqueness: second / largest })
}

/// `I (x) R_A - R_B^T (x) I`, on the columns of `X` one below the other.
fn difference(a: &Isometry3<f64>, b: &Isometry3<f64>) -> SMatrix<f64, 9, 9> {
    let (a, b) = (a.rotation.to_rotation_matrix(), b.rotation.to_rotation_matrix());
    let identity = Matrix3::identity();
    identity.kronecker(a.matrix()) - b.matrix().transpose().kronecker(&identity)
}
