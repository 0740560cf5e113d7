//! What a set of poses will be worth: the errors that a user sees, from the information of its poses.

use nalgebra::{DMatrix, Matrix3, Point3, SymmetricEigen, Vector3};

use super::model::{Model, State};
use crate::geometry::{Transform, rotation};

/// How much more the square of an error through the hand-eye result counts than one of stereo or of a lens: it is what
/// the robot acts on.
const HAND_EYE: f64 = 4.0;
/// Points along each axis of an image at which its lens counts.
const GRID: usize = 5;

/// Predicted accuracy of a set of poses; systematic errors (square size, bent display, kinematics) come on top.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accuracy {
    /// Standard deviation of the stereo translation, all axes together, m; absent with one camera.
    pub stereo_m: Option<f64>,
    /// Standard deviation of the stereo rotation, all axes together, rad.
    pub stereo_rad: Option<f64>,
    /// Standard deviation of where the reference camera stands, all axes together, m.
    pub camera_m: f64,
    /// Standard deviation of its rotation, all axes together, rad.
    pub camera_rad: f64,
    /// The error that 19 of 20 calibrations keep at the worst corner of the workspace, through the hand-eye result, m.
    pub workspace_95_m: f64,
}

/// The quantities that count, as rows over the unknowns.
#[derive(Debug, Clone)]
pub(super) struct Wanted {
    stereo: Option<DMatrix<f64>>,
    camera: DMatrix<f64>,
    /// Three rows for each corner of the workspace.
    corners: DMatrix<f64>,
    /// The mean square of everything below is what poses are chosen by: `trace(criterion * covariance)`, m2.
    criterion: DMatrix<f64>,
}

impl Wanted {
    /// For a workspace between two distances from the reference camera, m.
    pub(super) fn of(model: &Model, depths_m: [f64; 2]) -> Self {
        let nominal = &model.nominal;
        let workspace = workspace(nominal, depths_m);
        let in_base =
            |state: &State| workspace.iter().flat_map(|p| <[f64; 3]>::from(state.seen_from_robot(*p))).collect();
        let corners = model.gradient(in_base);
        let through_stereo = |state: &State| {
            let points = workspace.iter().map(|p| state.event_from_rgb.map(|t| (t.iso() * Point3::from(*p)).coords));
            points.flatten().flat_map(<[f64; 3]>::from).collect()
        };
        let mut parts = vec![mean_square(&corners, 3) * HAND_EYE, mean_square(&model.gradient(through_stereo), 3)];
        let middle_m = 0.5 * (depths_m[0] + depths_m[1]);
        for index in 0..nominal.cameras.len() {
            parts.push(mean_square(&model.gradient(|state| aside_m(nominal, state, index, middle_m)), 2));
        }
        let size = model.size();
        let criterion = parts.into_iter().fold(DMatrix::zeros(size, size), |sum, part| sum + part);
        let stereo = nominal.event_from_rgb.map(|before| {
            model.gradient(|state| state.event_from_rgb.map_or_else(Vec::new, |now| apart(&(before.inverse() * now))))
        });
        let camera = model.gradient(|state| camera_apart(nominal, state));
        Self { stereo, camera, corners, criterion }
    }

    /// Mean square error, m2; infinite where the information is not positive definite.
    pub(super) fn mean_square_m2(&self, information: &DMatrix<f64>) -> f64 {
        information.clone().cholesky().map_or(f64::INFINITY, |c| self.criterion.component_mul(&c.inverse()).sum())
    }

    /// The errors in words of the user; `None` where the information is not positive definite.
    pub(super) fn accuracy(&self, information: &DMatrix<f64>) -> Option<Accuracy> {
        let covariance = information.clone().cholesky()?.inverse();
        let sigma = |rows: &DMatrix<f64>, first: usize| {
            let part = rows.rows(first, 3);
            (part * &covariance * part.transpose()).trace().sqrt()
        };
        let radii = (0..self.corners.nrows() / 3).map(|i| {
            let part = self.corners.rows(3 * i, 3);
            let all = part * &covariance * part.transpose();
            radius_95(&Matrix3::from_fn(|r, c| all[(r, c)]))
        });
        Some(Accuracy {
            stereo_m: self.stereo.as_ref().map(|rows| sigma(rows, 0)),
            stereo_rad: self.stereo.as_ref().map(|rows| sigma(rows, 3)),
            camera_m: sigma(&self.camera, 0),
            camera_rad: sigma(&self.camera, 3),
            workspace_95_m: radii.fold(0.0, f64::max),
        })
    }
}

/// `G^T G` over the number of points that its rows are for.
fn mean_square(rows: &DMatrix<f64>, per_point: usize) -> DMatrix<f64> {
    rows.transpose() * rows / (rows.nrows() / per_point).max(1) as f64
}

/// The corners of what the reference camera sees between two distances.
pub(super) fn workspace(nominal: &State, depths_m: [f64; 2]) -> Vec<Vector3<f64>> {
    let lens = nominal.cameras.iter().find(|(camera, _)| *camera == nominal.reference);
    let Some((_, lens)) = lens else { return Vec::new() };
    let sides = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
    let ray = |[x, y]: [f64; 2]| {
        let px = [x * f64::from(lens.width), y * f64::from(lens.height)];
        Vector3::new((px[0] - lens.cx) / lens.fx, (px[1] - lens.cy) / lens.fy, 1.0)
    };
    depths_m.into_iter().flat_map(|depth_m| sides.map(|side| ray(side) * depth_m)).collect()
}

/// How far aside the points of a grid over the image seem to lie at this distance, m.
fn aside_m(nominal: &State, state: &State, index: usize, depth_m: f64) -> Vec<f64> {
    let (lens, now) = (&nominal.cameras[index].1, &state.cameras[index].1);
    let at = |i: usize, length: u32| f64::from(length) * (i as f64 + 0.5) / GRID as f64;
    let places = (0..GRID).flat_map(|row| (0..GRID).map(move |column| (column, row)));
    let points = places.map(|(column, row)| {
        let ideal = [(at(column, lens.width) - lens.cx) / lens.fx, (at(row, lens.height) - lens.cy) / lens.fy];
        now.project(&Point3::new(ideal[0], ideal[1], 1.0)).unwrap_or_default()
    });
    points.flat_map(|[x, y]| [x * depth_m / lens.fx, y * depth_m / lens.fy]).collect()
}

/// Translation (m) and rotation vector (rad) of a small transform.
fn apart<A, B>(small: &Transform<A, B>) -> Vec<f64> {
    let turn = rotation::to_vector(&small.rotation());
    small.translation_m().into_iter().chain(<[f64; 3]>::from(turn)).collect()
}

fn camera_apart(nominal: &State, state: &State) -> Vec<f64> {
    use crate::config::Mount::{Cameras, Target};
    match (&nominal.mount, &state.mount) {
        (Target { base_from_camera: before, .. }, Target { base_from_camera: now, .. }) => {
            apart(&(before.inverse() * *now))
        }
        (Cameras { tcp_from_camera: before, .. }, Cameras { tcp_from_camera: now, .. }) => {
            apart(&(before.inverse() * *now))
        }
        (Target { .. }, Cameras { .. }) | (Cameras { .. }, Target { .. }) => vec![0.0; 6],
    }
}

/// Radius around zero that holds 95 % of a normal error in space.
///
/// The squared length is taken as a scaled chi-square of equal mean and variance (Satterthwaite), whose quantile is that
/// of Wilson and Hilferty: within 2 % for any shape.
pub(super) fn radius_95(covariance: &Matrix3<f64>) -> f64 {
    let values = SymmetricEigen::new(*covariance).eigenvalues.map(|v| v.max(0.0));
    let (sum, squares) = (values.sum(), values.norm_squared());
    if sum <= 0.0 {
        return 0.0;
    }
    let (scale, freedom) = (squares / sum, sum * sum / squares);
    let ninth = 2.0 / (9.0 * freedom);
    let quantile = freedom * (1.0 - ninth + 1.6449 * ninth.sqrt()).powi(3);
    (scale * quantile).sqrt()
}
