//! Robot-world and hand-eye together: `A_i X = Z B_i`, both transforms at once, from poses instead of motions.
//!
//! Shah (2013): rotations from the largest singular pair of a sum of Kronecker products, then both
//! translations by least squares. Li, Wang and Wu (2010): all 24 numbers of both transforms from one linear
//! system, rotations made such afterwards. Neither knows a quaternion or an angle, so nothing is special at
//! 0 or at 180 deg, and no turn of the camera frame is needed.
//!
//! Li's rotations are free matrices while the translations are solved with them, and these are not solved
//! again: with noise it is clearly worse than the others (twice the scatter of the others on a real arm).

use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, SMatrix, SVector, Translation3, UnitQuaternion, Vector3};

use crate::geometry::rotation::from_matrix;

/// Both unknowns of `A_i X B_i = Z`.
pub(super) struct Both {
    pub(super) x: Isometry3<f64>,
    pub(super) z: Isometry3<f64>,
}

/// Li's matrices have the scale 1 without noise; beyond a factor of two the translations do not determine it.
const SCALES: std::ops::RangeInclusive<f64> = 0.5..=2.0;

/// Shah (2013); the loops are `(A_i, B_i)` with `A_i X B_i = Z`, so that his `B` is the inverse of ours.
pub(super) fn shah(loops: &[(Isometry3<f64>, Isometry3<f64>)]) -> Option<Both> {
    let sum = loops.iter().fold(SMatrix::<f64, 9, 9>::zeros(), |sum, (a, b)| {
        let b_inverse = b.rotation.inverse();
        sum + b_inverse.to_rotation_matrix().matrix().kronecker(a.rotation.to_rotation_matrix().matrix())
    });
    let right = largest_right(&sum)?;
    let [x, z] = [right, sum * right].map(|v| Matrix3::from_column_slice(v.as_slice()));
    translations(loops, rotation(&x)?, rotation(&z)?)
}

/// The right singular vector of the largest singular value.
fn largest_right(matrix: &SMatrix<f64, 9, 9>) -> Option<SVector<f64, 9>> {
    let normal = matrix.transpose() * matrix;
    if !normal.iter().all(|v| v.is_finite()) {
        return None;
    }
    let eigen = normal.try_symmetric_eigen(f64::EPSILON, 1000)?;
    Some(eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned())
}

/// The rotation nearest to a matrix that is one up to scale and sign.
fn rotation(matrix: &Matrix3<f64>) -> Option<UnitQuaternion<f64>> {
    from_matrix(&(matrix * matrix.determinant().signum()))
}

/// Least squares of `R_A t_X - t_Z = R_Z t - t_A` over all loops, with t that of the inverse of B.
fn translations(
    loops: &[(Isometry3<f64>, Isometry3<f64>)],
    x: UnitQuaternion<f64>,
    z: UnitQuaternion<f64>,
) -> Option<Both> {
    let mut rows = DMatrix::zeros(3 * loops.len(), 6);
    let mut right = DVector::zeros(3 * loops.len());
    for (i, (a, b)) in loops.iter().enumerate() {
        rows.fixed_view_mut::<3, 3>(3 * i, 0).copy_from(a.rotation.to_rotation_matrix().matrix());
        rows.fixed_view_mut::<3, 3>(3 * i, 3).copy_from(&-Matrix3::identity());
        let b_inverse = b.inverse();
        right.fixed_rows_mut::<3>(3 * i).copy_from(&(z * b_inverse.translation.vector - a.translation.vector));
    }
    let found = least_squares(rows, right)?;
    Some(both([x, z], &found, [0, 3]))
}

/// Li, Wang and Wu (2010), for the same loops.
pub(super) fn li(loops: &[(Isometry3<f64>, Isometry3<f64>)]) -> Option<Both> {
    let mut rows = DMatrix::zeros(12 * loops.len(), 24);
    let mut right = DVector::zeros(12 * loops.len());
    let identity = Matrix3::<f64>::identity();
    for (i, (a, b)) in loops.iter().enumerate() {
        let (b, at) = (b.inverse(), 12 * i);
        let (a_turn, b_turn) = (a.rotation.to_rotation_matrix(), b.rotation.to_rotation_matrix());
        // Columns of X, columns of Z, t_X, t_Z.
        rows.fixed_view_mut::<9, 9>(at, 0).copy_from(&identity.kronecker(a_turn.matrix()));
        rows.fixed_view_mut::<9, 9>(at, 9).copy_from(&-b_turn.matrix().transpose().kronecker(&identity));
        rows.fixed_view_mut::<3, 9>(at + 9, 9).copy_from(&b.translation.vector.transpose().kronecker(&identity));
        rows.fixed_view_mut::<3, 3>(at + 9, 18).copy_from(&-a_turn.matrix());
        rows.fixed_view_mut::<3, 3>(at + 9, 21).copy_from(&identity);
        right.fixed_rows_mut::<3>(at + 9).copy_from(&a.translation.vector);
    }
    let found = least_squares(rows, right)?;
    let matrix = |at: usize| Matrix3::from_column_slice(&found.as_slice()[at..at + 9]);
    let (x, z) = (matrix(0), matrix(9));
    let scaled = [x, z].iter().all(|m| SCALES.contains(&m.determinant().abs().cbrt()));
    if !scaled {
        return None;
    }
    Some(both([rotation(&x)?, rotation(&z)?], &found, [18, 21]))
}

/// From the rotations, and the translations that begin at these rows.
fn both(turns: [UnitQuaternion<f64>; 2], found: &DVector<f64>, at: [usize; 2]) -> Both {
    let part = |i: usize| {
        let t: Vector3<f64> = found.fixed_rows::<3>(at[i]).into_owned();
        Isometry3::from_parts(Translation3::from(t), turns[i])
    };
    Both { x: part(0), z: part(1) }
}

/// By an orthogonal decomposition: the normal equations would cost half of the digits.
fn least_squares(rows: DMatrix<f64>, mut right: DVector<f64>) -> Option<DVector<f64>> {
    let unknowns = rows.ncols();
    let decomposed = rows.qr();
    decomposed.q_tr_mul(&mut right);
    decomposed.r().solve_upper_triangular(&right.rows(0, unknowns).into_owned())
}
