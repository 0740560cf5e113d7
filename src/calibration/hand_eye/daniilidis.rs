//! Daniilidis (1999): rotation and translation together, as a dual quaternion.
//!
//! `q` (real) and `p = t q / 2` (dual) span the null space of his 6 x 8 rows, all motions stacked. The
//! null space has two dimensions, one of them `(0, q)`; the sum is fixed by `|q| = 1` and `q . p = 0`.
//! Translations are divided by their own size first, so that the answer does not depend on the unit.

use nalgebra::{Isometry3, Quaternion, SMatrix, SVector, Translation3, UnitQuaternion, Vector3, Vector4};

use super::motion::{Motion, Motions};

/// Transform of the turned camera frame.
pub(super) fn solve(motions: &Motions) -> Option<Isometry3<f64>> {
    let size_m = translation_size_m(&motions.list);
    let normal = motions.list.iter().fold(SMatrix::<f64, 8, 8>::zeros(), |sum, motion| {
        let rows = rows(motion, size_m);
        sum + rows.transpose() * rows
    });
    if !normal.iter().all(|v| v.is_finite()) {
        return None;
    }
    let eigen = normal.try_symmetric_eigen(f64::EPSILON, 1000)?;
    let mut order: [usize; 8] = std::array::from_fn(|i| i);
    order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
    let [first, second] = [order[0], order[1]].map(|i| eigen.eigenvectors.column(i).into_owned());
    let (q, p) = dual_quaternion(&first, &second)?;
    let translation = (p * q.conjugate()).imag() * (2.0 * size_m);
    Some(Isometry3::from_parts(Translation3::from(translation), UnitQuaternion::try_new(q, 1e-9)?))
}

/// Root mean square of all translations; 1 if there are none.
fn translation_size_m(motions: &[Motion]) -> f64 {
    let squares = motions.iter().map(|m| m.a.translation.vector.norm_squared() + m.b.translation.vector.norm_squared());
    let size_m = (squares.sum::<f64>() / (2 * motions.len()) as f64).sqrt();
    if size_m > 1e-9 { size_m } else { 1.0 }
}

/// Vector parts of `A X - X B`, real and dual, on (q, p) as (x, y, z, w) each.
fn rows(Motion { a, b }: &Motion, size_m: f64) -> SMatrix<f64, 6, 8> {
    let (a_dual, b_dual) = (dual(a, size_m), dual(b, size_m));
    let (a, b) = (a.rotation.imag(), b.rotation.imag());
    let mut rows = SMatrix::<f64, 6, 8>::zeros();
    for (row, column, a, b) in [(0, 0, a, b), (3, 0, a_dual, b_dual), (3, 4, a, b)] {
        rows.fixed_view_mut::<3, 3>(row, column).copy_from(&(a + b).cross_matrix());
        rows.fixed_view_mut::<3, 1>(row, column + 3).copy_from(&(a - b));
    }
    rows
}

/// Vector part of the dual quaternion `t q / 2`.
fn dual(iso: &Isometry3<f64>, size_m: f64) -> Vector3<f64> {
    let t = iso.translation.vector / size_m;
    (Quaternion::from_imag(t) * iso.rotation.quaternion()).imag() * 0.5
}

/// The unit dual quaternion in the span of two vectors (q, p).
///
/// The basis is first rotated so that the second vector has the smallest real part, zero without noise:
/// then `q . p = 0` is a quadratic whose small root is the answer, and nothing is divided by zero for a
/// translation of zero or a half turn.
fn dual_quaternion(a: &SVector<f64, 8>, b: &SVector<f64, 8>) -> Option<(Quaternion<f64>, Quaternion<f64>)> {
    let real = |v: &SVector<f64, 8>| -> Vector4<f64> { v.fixed_rows::<4>(0).into_owned() };
    let (aa, ab, bb) = (real(a).norm_squared(), real(a).dot(&real(b)), real(b).norm_squared());
    let angle = 0.5 * (2.0 * ab).atan2(aa - bb);
    let (sine, cosine) = angle.sin_cos();
    let (most, least) = (a * cosine + b * sine, b * cosine - a * sine);
    let step = small_root(&most, &least);
    let sum = most + least * step;
    let (q, p) = (real(&sum), sum.fixed_rows::<4>(4).into_owned());
    let length = q.norm();
    (length > 1e-6).then(|| (Quaternion::from(q / length), Quaternion::from(p / length)))
}

/// The root s of smaller size of `(u + s u') . (v + s v') = 0`, for vectors (u, v) and (u', v').
fn small_root(most: &SVector<f64, 8>, least: &SVector<f64, 8>) -> f64 {
    let real = |v: &SVector<f64, 8>| -> Vector4<f64> { v.fixed_rows::<4>(0).into_owned() };
    let dual = |v: &SVector<f64, 8>| -> Vector4<f64> { v.fixed_rows::<4>(4).into_owned() };
    let constant = real(most).dot(&dual(most));
    let linear = real(most).dot(&dual(least)) + dual(most).dot(&real(least));
    let square = real(least).dot(&dual(least));
    let root = (linear * linear - 4.0 * square * constant).max(0.0).sqrt();
    -2.0 * constant / (linear + root.copysign(linear))
}
