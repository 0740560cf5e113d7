//! From the covariance of the shared numbers to errors of what a robot does with them.

use nalgebra::{DMatrix, Isometry3, Matrix3, Point3, SMatrix, Vector3};

use super::lens::{self, LENS};
use super::outcome::PlaceSigma;
use super::rig::Rig;
use super::se3;
use super::state::{LENSES, SECOND, SHARED, SharedMatrix};

type StepBy = SMatrix<f64, 6, SHARED>;

/// Quantile of the normal distribution that 95 of 100 stay below.
const NORMAL_95: f64 = 1.644_853_626_951_472_2;
/// The same for 99 of 100.
const NORMAL_99: f64 = 2.326_347_874_040_841;

/// The reference camera at the end of the loop, and how its place follows from the shared numbers.
pub(super) struct CameraPlace {
    /// `base_from_camera`, or `tcp_from_camera`.
    pub(super) place: Isometry3<f64>,
    /// Step on the left of it, by the shared numbers.
    by_shared: StepBy,
    camera: usize,
}

impl CameraPlace {
    /// `end_from_rig` at `end` of the shared numbers; the camera is number `camera` of the rig.
    pub(super) fn of(rig: &Rig, end_from_rig: &Isometry3<f64>, end: usize, camera: usize) -> Self {
        let place = end_from_rig * rig.camera_from_rig(camera).inverse();
        let mut by_shared = StepBy::zeros();
        by_shared.fixed_columns_mut::<6>(end).fill_with_identity();
        if camera == 1 {
            by_shared.fixed_columns_mut::<6>(SECOND.start).copy_from(&-se3::adjoint(&place));
        }
        Self { place, by_shared, camera }
    }

    /// Standard deviations of the place.
    pub(super) fn sigma(&self, covariance: &SharedMatrix) -> PlaceSigma {
        let step = self.by_shared * covariance * self.by_shared.transpose();
        PlaceSigma::of_step(&step, &self.place.translation.vector)
    }

    fn point_by_shared(&self, at: &Vector3<f64>) -> SMatrix<f64, 3, SHARED> {
        let mut by_step = SMatrix::<f64, 3, 6>::zeros();
        by_step.fixed_columns_mut::<3>(0).fill_with_identity();
        by_step.fixed_columns_mut::<3>(3).copy_from(&-se3::hat(at));
        by_step * self.by_shared
    }

    /// Error of a point that the camera sees at `at`, m.
    pub(super) fn point_error_95_m(&self, covariance: &SharedMatrix, at: &Vector3<f64>) -> f64 {
        let by = self.point_by_shared(at);
        let own: Matrix3<f64> = by * covariance * by.transpose();
        radius_95(own.trace(), (own * own).trace())
    }

    /// Error of where the camera sees what is at `at`, px; `None` behind the camera.
    pub(super) fn image_error_95_px(&self, rig: &Rig, covariance: &SharedMatrix, at: &Vector3<f64>) -> Option<f64> {
        let in_camera = self.place.inverse() * Point3::from(*at);
        let seen = lens::project_with_slopes(&rig.fit.state.lenses[self.camera], &in_camera.coords)?;
        let turn = self.place.rotation.inverse().to_rotation_matrix();
        let mut by = -(seen.by_point * turn.matrix() * self.point_by_shared(at));
        let mut own = by.fixed_columns_mut::<LENS>(LENSES[self.camera].start);
        own += seen.by_lens;
        let own = by * covariance * by.transpose();
        Some(radius_95(own.trace(), (own * own).trace()))
    }
}

/// Distance that 95 of 100 normal errors stay within, from the traces of their covariance and of its square.
///
/// The sum of squares is taken as a chi-squared one of the same mean and variance (Satterthwaite).
fn radius_95(trace: f64, trace_of_square: f64) -> f64 {
    let something = trace > 0.0 && trace_of_square > 0.0;
    if !something {
        return 0.0;
    }
    let freedom = trace * trace / trace_of_square;
    (trace_of_square / trace * chi_squared(freedom, NORMAL_95)).sqrt()
}

/// Quantile of chi-squared (Wilson and Hilferty 1931); `normal` is that of the normal distribution.
fn chi_squared(freedom: f64, normal: f64) -> f64 {
    let spread = 2.0 / (9.0 * freedom);
    freedom * (1.0 - spread + normal * spread.sqrt()).powi(3)
}

/// How far `step` leads between two estimates of which the second knows more, over what chance allows in 99 of 100.
///
/// Hausman's test: their difference has the difference of their covariances. `None` where nothing was gained.
pub(super) fn hausman(step: &[f64], before: &DMatrix<f64>, after: &DMatrix<f64>) -> Option<f64> {
    // A direction that gained less than this cannot have been pulled by more than that part of its sigma.
    const GAINED: f64 = 0.05;
    let n = step.len();
    let size: Vec<f64> = (0..n).map(|i| before[(i, i)].sqrt()).collect();
    let scaled = |m: &DMatrix<f64>| DMatrix::from_fn(n, n, |i, j| m[(i, j)] / (size[i] * size[j]));
    let before = scaled(before);
    let lower = before.clone().cholesky()?.l();
    let half = lower.solve_lower_triangular(&(before - scaled(after)))?;
    let gain = lower.solve_lower_triangular(&half.transpose())?;
    let off = DMatrix::from_fn(n, 1, |i, _| step[i] / size[i]);
    let off = lower.solve_lower_triangular(&off)?;
    let eigen = (&gain + gain.transpose()).scale(0.5).symmetric_eigen();
    let (mut sum, mut freedom) = (0.0, 0.0);
    for (k, gained) in eigen.eigenvalues.iter().enumerate().filter(|(_, g)| **g > GAINED) {
        sum += eigen.eigenvectors.column(k).dot(&off.column(0)).powi(2) / gained;
        freedom += 1.0;
    }
    (freedom > 0.0).then(|| sum / chi_squared(freedom, NORMAL_99))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_tables() {
        for (freedom, normal, table) in
            [(1.0, NORMAL_95, 3.841), (2.0, NORMAL_95, 5.991), (3.0, NORMAL_95, 7.815), (6.0, NORMAL_99, 16.812)]
        {
            assert!((chi_squared(freedom, normal) / table - 1.0).abs() < 0.03, "{freedom}");
        }
        // Equal axes: the radius of a ball.
        assert!((radius_95(3.0, 3.0) - 7.815_f64.sqrt()).abs() < 0.02);
    }

    #[test]
    fn hausman_tells_a_pull_from_noise() {
        let before = DMatrix::from_diagonal_element(3, 3, 4.0);
        let after = DMatrix::from_diagonal_element(3, 3, 1.0);
        // The difference has a variance of 3: 1.7 is one sigma, 9 is five.
        assert!(hausman(&[1.7, -1.7, 0.5], &before, &after).unwrap() < 1.0);
        assert!(hausman(&[9.0, 0.0, 0.0], &before, &after).unwrap() > 1.0);
        assert!(hausman(&[9.0, 0.0, 0.0], &before, &before).is_none());
    }
}
