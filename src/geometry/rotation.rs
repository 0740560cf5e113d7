//! Rotations that stay right at 0 and at pi.
//!
//! nalgebra's `Rotation3::from_matrix` and `UnitQuaternion::from_matrix` can be 180 deg wrong and
//! `Rotation3::scaled_axis` is zero at exactly pi; tool-down poses sit right there. These functions
//! take the safe path.

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

/// Rotation of a matrix that is a rotation up to rounding; the nearest one in the Frobenius norm.
///
/// `None` where the matrix has no nearest rotation (not finite, or rank below 2).
pub fn from_matrix(matrix: &Matrix3<f64>) -> Option<UnitQuaternion<f64>> {
    if !matrix.iter().all(|v| v.is_finite()) {
        return None;
    }
    let svd = matrix.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    if svd.singular_values[1] <= 1e-12 * svd.singular_values[0].max(1e-300) {
        return None;
    }
    let sign = (u * v_t).determinant().signum();
    let nearest = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t;
    let rotation = Rotation3::from_matrix_unchecked(nearest);
    Some(canonical(UnitQuaternion::from_rotation_matrix(&rotation)))
}

/// Rotation of an axis-angle vector in radians (as UR poses carry it).
pub fn from_vector(vector_rad: [f64; 3]) -> UnitQuaternion<f64> {
    canonical(UnitQuaternion::from_scaled_axis(Vector3::from(vector_rad)))
}

/// Axis-angle vector in radians, length 0 to pi.
pub fn to_vector(rotation: &UnitQuaternion<f64>) -> Vector3<f64> {
    let q = canonical(*rotation);
    let (w, v) = (q.w, q.imag());
    let sine = v.norm();
    // Below 1e-9 the quotient 2 atan2(s, w) / s is 2 / w to full precision.
    if sine < 1e-9 { v * (2.0 / w) } else { v * (2.0 * sine.atan2(w) / sine) }
}

/// Angle between two rotations in radians, 0 to pi; accurate near 0, unlike `acos` of the trace.
pub fn angle_between_rad(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> f64 {
    to_vector(&(a.inverse() * b)).norm()
}

/// The same rotation with w >= 0.
pub fn canonical(q: UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    if q.w < 0.0 { UnitQuaternion::new_unchecked(Quaternion::from(-q.coords)) } else { q }
}

/// Point at `fraction` of the shortest way from `a` to `b` on the rotation group.
pub fn interpolate(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>, fraction: f64) -> UnitQuaternion<f64> {
    let step = to_vector(&(a.inverse() * b)) * fraction;
    canonical(a * UnitQuaternion::from_scaled_axis(step))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn awkward_vectors() -> Vec<[f64; 3]> {
        let s = std::f64::consts::FRAC_1_SQRT_2;
        vec![
            [0.0; 3],
            [1e-12, 0.0, 0.0],
            [0.0, 1e-9, 0.0],
            [PI, 0.0, 0.0],
            [0.0, PI, 0.0],
            [0.0, 0.0, -PI],
            [PI * s, -PI * s, 0.0],
            [(PI - 1e-9) * s, 0.0, (PI - 1e-9) * s],
            [0.3, -0.2, 3.0],
        ]
    }

    #[test]
    fn vector_and_matrix_come_back_at_zero_and_at_pi() {
        for vector in awkward_vectors() {
            let q = from_vector(vector);
            let matrix = *q.to_rotation_matrix().matrix();
            let again = from_matrix(&matrix).unwrap();
            assert!(angle_between_rad(&q, &again) < 1e-7, "{vector:?} -> {again:?}");
            let twice = from_vector(to_vector(&q).into());
            assert!(angle_between_rad(&q, &twice) < 1e-12, "{vector:?}");
            assert!(to_vector(&q).norm() <= PI + 1e-12);
        }
    }

    #[test]
    fn a_matrix_without_a_rotation_is_refused() {
        assert!(from_matrix(&Matrix3::zeros()).is_none());
        assert!(from_matrix(&Matrix3::from_element(f64::NAN)).is_none());
    }

    #[test]
    fn half_way_between_rotations_is_on_the_group() {
        let (a, b) = (from_vector([0.0, 0.0, 3.0]), from_vector([0.0, 0.0, -3.0]));
        let middle = interpolate(&a, &b, 0.5);
        assert!(angle_between_rad(&middle, &from_vector([0.0, 0.0, PI])) < 1e-12);
    }
}
