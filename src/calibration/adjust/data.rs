//! What the adjustment starts from: corners with their weights, by pose and camera.

use nalgebra::{Isometry3, Vector2, Vector3};

use super::shape::{Basis, TERMS};
use crate::board::{Board, Corner, View};
use crate::geometry::Camera;

/// Accuracy of a corner whose detector gives none, px.
fn usual_sigma_px(camera: Camera) -> f64 {
    match camera {
        Camera::Rgb => 0.1,
        Camera::Event => 0.45,
    }
}

/// One corner that one camera saw.
#[derive(Debug, Clone)]
pub(super) struct Sight {
    /// Id on the board.
    pub(super) id: u32,
    /// Where it is on a flat board, m.
    pub(super) on_board: Vector3<f64>,
    /// Terms of the board's shape there.
    pub(super) basis: [f64; TERMS],
    /// Which of two halves, as on a chess board.
    pub(super) half: u32,
    /// Where it was seen, px.
    pub(super) px: Vector2<f64>,
    /// Root of the weight (rows `[a, 0], [b, c]`), 1/px: takes an error to unit variance.
    root: [f64; 3],
    /// Whether it enters.
    pub(super) used: bool,
}

impl Sight {
    fn of(board: &Board, basis: &Basis, camera: Camera, corner: &Corner) -> Option<Self> {
        let usual = usual_sigma_px(camera);
        let root = corner.covariance_px2.and_then(root_of_weight).unwrap_or([1.0 / usual, 0.0, 1.0 / usual]);
        Some(Self {
            id: corner.id,
            on_board: board.corner(corner.id)?.coords_m(),
            basis: basis.at(corner.id),
            half: (corner.id % (board.squares_x - 1) + corner.id / (board.squares_x - 1)) % 2,
            px: corner.px.into(),
            root,
            used: corner.px.iter().all(|v| v.is_finite()),
        })
    }

    /// Takes an error in px to one of unit variance.
    pub(super) fn whiten(&self, error_px: &Vector2<f64>) -> Vector2<f64> {
        let [a, b, c] = self.root;
        Vector2::new(a * error_px.x, b * error_px.x + c * error_px.y)
    }

    /// The corner on the board of this shape, m.
    pub(super) fn on_shape(&self, shape_m: &[f64; TERMS]) -> Vector3<f64> {
        let height: f64 = self.basis.iter().zip(shape_m).map(|(b, m)| b * m).sum();
        Vector3::new(self.on_board.x, self.on_board.y, self.on_board.z + height)
    }
}

/// Inverse of the lower Cholesky factor of a covariance; `None` where it is none.
fn root_of_weight([xx, xy, yy]: [f64; 3]) -> Option<[f64; 3]> {
    let l11 = xx.sqrt();
    let l21 = xy / l11;
    let l22 = (yy - l21 * l21).sqrt();
    let root = [1.0 / l11, -l21 / (l11 * l22), 1.0 / l22];
    root.iter().all(|v| v.is_finite()).then_some(root)
}

/// What was seen at one pose.
#[derive(Debug, Clone)]
pub(super) struct PoseSights {
    /// Index of the pose in the problem.
    pub(super) index: usize,
    /// Its id.
    pub(super) id: String,
    /// The corners by camera of the rig; empty where it saw nothing.
    pub(super) views: [Vec<Sight>; 2],
    /// The robot's pose, where it may enter.
    pub(super) base_from_tcp: Option<Isometry3<f64>>,
    /// Whether the robot's pose enters.
    pub(super) tied: bool,
}

impl PoseSights {
    /// Corners that enter, of both cameras.
    pub(super) fn used(&self) -> usize {
        self.views.iter().flatten().filter(|s| s.used).count()
    }
}

/// The corners of a view; those that the board does not have are left out.
pub(super) fn sights(board: &Board, basis: &Basis, camera: Camera, view: &View) -> Vec<Sight> {
    view.corners.iter().filter_map(|c| Sight::of(board, basis, camera, c)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whitened_errors_have_unit_variance() {
        let [xx, xy, yy] = [0.04, -0.013, 0.01];
        let [a, b, c] = root_of_weight([xx, xy, yy]).unwrap();
        let var = |p: f64, q: f64| p * p * xx + 2.0 * p * q * xy + q * q * yy;
        assert!((var(a, 0.0) - 1.0).abs() < 1e-12 && (var(b, c) - 1.0).abs() < 1e-12);
        assert!((a * (b * xx + c * xy)).abs() < 1e-12);
        assert!(root_of_weight([0.01, 0.02, 0.01]).is_none() && root_of_weight([0.0; 3]).is_none());
    }
}
