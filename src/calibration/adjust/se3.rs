//! Rigid motions as small steps: exponential, logarithm and what connects them.
//!
//! A step is `(v, w)`: translation (m) first, then rotation (rad); it is applied on the left,
//! `T <- exp(step) T`, in the frame that `T` leads to. Right at 0 (series) and at pi (half angles).

use nalgebra::{Isometry3, Matrix3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};

use crate::geometry::rotation;

/// The matrix that multiplies as the cross product with `w` does.
pub(super) fn hat(w: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -w.z, w.y, w.z, 0.0, -w.x, -w.y, w.x, 0.0)
}

/// Rotation by the vector `w`.
pub(super) fn rotation_exp(w: &Vector3<f64>) -> UnitQuaternion<f64> {
    rotation::canonical(UnitQuaternion::from_scaled_axis(*w))
}

/// Rotation vector of length 0 to pi.
pub(super) fn rotation_log(q: &UnitQuaternion<f64>) -> Vector3<f64> {
    rotation::to_vector(q)
}

/// How far a turn of `w` and a shift that grows with it lead: `exp(v, w)` moves by this times `v`.
pub(super) fn left_jacobian(w: &Vector3<f64>) -> Matrix3<f64> {
    let t2 = w.norm_squared();
    let t = t2.sqrt();
    let half = if t < 1e-8 { 1.0 } else { (t / 2.0).sin() / (t / 2.0) };
    let third = if t2 < 1e-2 {
        1.0 / 6.0 - t2 * (1.0 / 120.0 - t2 * (1.0 / 5040.0 - t2 / 362_880.0))
    } else {
        (t - t.sin()) / (t2 * t)
    };
    let cross = hat(w);
    Matrix3::identity() + cross * (0.5 * half * half) + cross * cross * third
}

/// Inverse of [`left_jacobian`], for lengths up to pi.
pub(super) fn left_jacobian_inverse(w: &Vector3<f64>) -> Matrix3<f64> {
    let t2 = w.norm_squared();
    let half = t2.sqrt() / 2.0;
    let factor = if t2 < 1e-3 {
        1.0 / 12.0 + t2 * (1.0 / 720.0 + t2 * (1.0 / 30_240.0 + t2 / 1_209_600.0))
    } else {
        (1.0 - half * half.cos() / half.sin()) / t2
    };
    let cross = hat(w);
    Matrix3::identity() - cross * 0.5 + cross * cross * factor
}

/// The motion of a step.
pub(super) fn exp(step: &Vector6<f64>) -> Isometry3<f64> {
    let (v, w) = halves(step);
    Isometry3::from_parts(Translation3::from(left_jacobian(&w) * v), rotation_exp(&w))
}

/// The step of a motion; its rotation has length 0 to pi.
#[cfg(test)]
pub(super) fn log(motion: &Isometry3<f64>) -> Vector6<f64> {
    let w = rotation_log(&motion.rotation);
    let v = left_jacobian_inverse(&w) * motion.translation.vector;
    Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z)
}

/// Takes a step on the right of `motion` to the same step on its left.
pub(super) fn adjoint(motion: &Isometry3<f64>) -> Matrix6<f64> {
    let r = *motion.rotation.to_rotation_matrix().matrix();
    let mut all = Matrix6::zeros();
    all.fixed_view_mut::<3, 3>(0, 0).copy_from(&r);
    all.fixed_view_mut::<3, 3>(3, 3).copy_from(&r);
    all.fixed_view_mut::<3, 3>(0, 3).copy_from(&(hat(&motion.translation.vector) * r));
    all
}

/// Translation and rotation of a step.
pub(super) fn halves(step: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (step.fixed_rows::<3>(0).into_owned(), step.fixed_rows::<3>(3).into_owned())
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    /// Steps with rotations at 0, near 0, near pi and at pi.
    fn awkward() -> Vec<Vector6<f64>> {
        let axes = [Vector3::x(), -Vector3::y(), Vector3::new(0.6, -0.64, 0.48)];
        let angles = [0.0, 1e-12, 1e-9, 1e-4, 0.0316, 0.0317, 0.0999, 0.1001, 1.3, PI - 1e-5, PI - 1e-9, PI];
        let step = |axis: &Vector3<f64>, angle: f64| {
            let w = axis * angle;
            Vector6::new(0.3, -1.2, 0.05, w.x, w.y, w.z)
        };
        axes.iter().flat_map(|axis| angles.map(|angle| step(axis, angle))).collect()
    }

    #[test]
    fn log_undoes_exp_from_zero_to_pi() {
        for step in awkward() {
            let again = exp(&log(&exp(&step)));
            let off = exp(&step).inverse() * again;
            assert!(off.translation.vector.norm() < 1e-12, "{step}: {off}");
            assert!(rotation_log(&off.rotation).norm() < 1e-12, "{step}: {off}");
            let (_, w) = halves(&step);
            assert!((log(&exp(&step)).fixed_rows::<3>(3).norm() - w.norm()).abs() < 1e-12, "{step}");
        }
    }

    /// The translation of exp is the integral of the turning frame, here by Simpson's rule.
    #[test]
    fn exp_moves_by_the_integral_of_the_turning_frame() {
        for step in awkward() {
            let (v, w) = halves(&step);
            let n = 200;
            let at = |k: usize| rotation_exp(&(w * (k as f64 / n as f64))) * v;
            let weight = |k: usize| {
                if k == 0 || k == n {
                    1.0
                } else if k % 2 == 1 {
                    4.0
                } else {
                    2.0
                }
            };
            let sum: Vector3<f64> = (0..=n).map(|k| at(k) * weight(k)).sum();
            let integral = sum / (3.0 * n as f64);
            assert!((exp(&step).translation.vector - integral).norm() < 1e-9, "{step}");
        }
    }

    #[test]
    fn the_jacobians_are_inverse_and_predict_small_turns() {
        for step in awkward() {
            let (_, w) = halves(&step);
            let product = left_jacobian(&w) * left_jacobian_inverse(&w);
            assert!((product - Matrix3::identity()).norm() < 1e-12, "{w}: {product}");
            // exp(J d) exp(w) = exp(w + d), away from pi, where the logarithm jumps.
            let d = Vector3::new(2e-7, -1e-7, 3e-7);
            let turned = rotation_exp(&(left_jacobian(&w) * d)) * rotation_exp(&w);
            let off = turned.inverse() * rotation_exp(&(w + d));
            assert!(rotation_log(&off).norm() < 1e-12, "{w}");
        }
    }

    #[test]
    fn the_adjoint_takes_a_step_to_the_other_side() {
        let motion = exp(&Vector6::new(0.4, -0.3, 1.1, 0.3, 2.0, -0.4));
        let step = Vector6::new(1e-3, 2e-3, -1e-3, 0.02, -0.01, 0.03);
        let off = (motion * exp(&step)).inverse() * (exp(&(adjoint(&motion) * step)) * motion);
        assert!(log(&off).norm() < 1e-14, "{off}");
    }
}
