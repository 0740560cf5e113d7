//! How far a result is from the truth of the simulated cell that it was recorded on.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::session::Recorded;
use crate::calibration::result::CalibrationResult;
use crate::geometry::{Base, Camera, Flange, Pinhole, Point, Transform, rotation};
use crate::runner::solve::Solved;

/// Errors of one solve by name; what the session does not have is absent.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// Numbers by name; the unit is the end of the name.
    pub values: BTreeMap<String, f64>,
    /// Components whose 95 % interval holds the truth, and all components that have one.
    pub covered: [u32; 2],
}

/// Half a 95 % interval in standard deviations.
const Z_95: f64 = 1.959_964;
/// Pixels between the points of an image at which two cameras are compared.
const GRID_PX: usize = 40;
/// Nearer to the border of the image than a quarter of a square there is too little of a corner to find, squares.
const BORDER_SQUARES: f64 = 0.25;

/// Compares a solve with the truth.
pub(super) fn errors(recorded: &Recorded, solved: &Solved) -> Errors {
    let mut all = Errors::default();
    let truth = &recorded.sim.truth;
    for (camera, lens) in [(Camera::Rgb, truth.rgb), (Camera::Event, truth.event)] {
        if let (Some(lens), Some(found)) = (lens, solved.result.cameras.get(&camera)) {
            all.put(&format!("{camera}_model_px"), model_error_px(&lens, &found.pinhole()));
            all.put(&format!("{camera}_rms_px"), Some(found.rms_px));
        }
        corners(recorded, solved, camera, &mut all);
    }
    stereo(recorded, &solved.result, &mut all);
    hand_eye(recorded, &solved.result, &mut all);
    let checks = &solved.result.checks;
    all.put("base_distance_mae_mm", checks.base_distance.as_ref().map(|d| d.mae_m * 1e3));
    let held_out = checks.target_to_tcp.as_ref().and_then(|t| t.held_out.as_ref().or(t.leave_one_out.as_ref()));
    all.put("held_out_target_to_tcp_mm", held_out.and_then(|h| h.mae_m).map(|m| m * 1e3));
    all
}

impl Errors {
    fn put(&mut self, name: &str, value: Option<f64>) {
        self.values.extend(value.filter(|v| v.is_finite()).map(|v| (name.to_owned(), v)));
    }

    /// Counts the components whose interval holds the truth.
    fn judge(&mut self, error: [f64; 3], sigma: [f64; 3]) {
        for (error, sigma) in error.into_iter().zip(sigma) {
            let holds = error.abs() <= Z_95 * sigma;
            self.covered = [self.covered[0] + u32::from(holds), self.covered[1] + 1];
        }
    }
}

fn stereo(recorded: &Recorded, result: &CalibrationResult, all: &mut Errors) {
    let Some(found) = &result.stereo else { return };
    let truth = recorded.sim.truth.event_from_rgb;
    let off = found.event_from_rgb.iso().translation.vector - truth.iso().translation.vector;
    all.put("stereo_translation_mm", Some(off.norm() * 1e3));
    all.put("baseline_mm", Some((found.baseline_m - truth.iso().translation.vector.norm()).abs() * 1e3));
    all.put("stereo_rotation_deg", Some(found.event_from_rgb.angle_to_rad(&truth).to_degrees()));
    if let Some(sigma) = &found.sigma {
        let turn = found.event_from_rgb.iso().rotation * truth.iso().rotation.inverse();
        all.judge(off.into(), sigma.sigma.translation_m);
        all.judge(rotation::to_vector(&turn).into(), sigma.sigma.rotation_rad);
    }
}

fn hand_eye(recorded: &Recorded, result: &CalibrationResult, all: &mut Errors) {
    let Some(found) = &result.hand_eye else { return };
    let truth = recorded.sim.truth.mount_of_camera;
    let place = found.base_from_camera.map(|t| *t.iso()).or(found.tcp_from_camera.map(|t| *t.iso()));
    let Some(place) = place else { return };
    let off = place.translation.vector - truth.iso().translation.vector;
    let turn = place.rotation * truth.iso().rotation.inverse();
    all.put("hand_eye_translation_mm", Some(off.norm() * 1e3));
    all.put("hand_eye_rotation_deg", Some(rotation::to_vector(&turn).norm().to_degrees()));
    if let Some(refined) = &found.refined {
        all.judge(off.into(), refined.camera.sigma.translation_m);
        all.judge(rotation::to_vector(&turn).into(), refined.camera.sigma.rotation_rad);
    }
}

/// RMS of the corners of one camera, and the share of those in its image that were found.
fn corners(recorded: &Recorded, solved: &Solved, camera: Camera, all: &mut Errors) {
    let board = &recorded.planned.cell.board;
    let (mut squares, mut found, mut possible) = (0.0, 0_u32, 0_u32);
    for (pose, flange) in &recorded.base_from_flange {
        let Some(view) = solved.views.view(*pose, camera) else { continue };
        for id in 0..board.corner_count() as u32 {
            let Some(truth) = whole_corner(recorded, camera, flange, id) else { continue };
            possible += 1;
            if let Some(px) = view.px(id) {
                squares += (px[0] - truth[0]).powi(2) + (px[1] - truth[1]).powi(2);
                found += 1;
            }
        }
    }
    if found > 0 {
        all.put(&format!("{camera}_corner_px"), Some((squares / f64::from(found)).sqrt()));
        all.put(&format!("{camera}_corners_found"), Some(f64::from(found) / f64::from(possible)));
    }
}

/// Where a corner truly is, if enough around it is in the image.
fn whole_corner(
    recorded: &Recorded,
    camera: Camera,
    base_from_flange: &Transform<Base, Flange>,
    id: u32,
) -> Option<[f64; 2]> {
    let (scene, placement) = (recorded.sim.scene(), &recorded.sim.truth.placement);
    let board = &recorded.planned.cell.board;
    let [x, y, z] = board.corner(id)?.xyz_m();
    let project = |x: f64, y: f64| {
        let point = Point::assume_frame([x, y, z]);
        match camera {
            Camera::Rgb => scene.project_rgb(&placement.rgb_from_target(*base_from_flange), point),
            Camera::Event => scene.project_event(&placement.event_from_target(*base_from_flange), point),
        }
    };
    let room_m = BORDER_SQUARES * board.square_m;
    let around = [[-room_m, 0.0], [room_m, 0.0], [0.0, -room_m], [0.0, room_m]];
    around.iter().all(|d| project(x + d[0], y + d[1]).is_some()).then(|| project(x, y)).flatten()
}

/// RMS difference of two cameras over the image after the rotation that brings them together best, px.
pub(super) fn model_error_px(truth: &Pinhole, found: &Pinhole) -> Option<f64> {
    let (w, h) = (truth.width as usize, truth.height as usize);
    let grid = (0..h).step_by(GRID_PX).flat_map(|y| (0..w).step_by(GRID_PX).map(move |x| [x as f64, y as f64]));
    let rays: Vec<_> = grid.map(|px| Some((ray(truth, px)?, Vector2::from(px)))).collect::<Option<_>>()?;
    let mut turn = [0.0; 3];
    for _ in 0..10 {
        let (mut normal, mut right) = (Matrix3::<f64>::zeros(), Vector3::<f64>::zeros());
        for (direction, px) in &rays {
            let at = |turn: [f64; 3]| {
                let seen = found.project(&(rotation::from_vector(turn) * direction).into())?;
                Some(Vector2::from(seen) - px)
            };
            let here = at(turn)?;
            for i in 0..3 {
                let mut stepped = turn;
                stepped[i] += 1e-6;
                let column_i = (at(stepped)? - here) * 1e6;
                right[i] -= column_i.dot(&here);
                for j in 0..3 {
                    let mut other = turn;
                    other[j] += 1e-6;
                    normal[(i, j)] += column_i.dot(&((at(other)? - here) * 1e6));
                }
            }
        }
        let step = normal.try_inverse()? * right;
        turn = [0, 1, 2].map(|i| turn[i] + step[i]);
        if step.norm() < 1e-12 {
            break;
        }
    }
    let off = |(direction, px): &(Vector3<f64>, Vector2<f64>)| {
        Some((Vector2::from(found.project(&(rotation::from_vector(turn) * direction).into())?) - px).norm_squared())
    };
    let squares: f64 = rays.iter().map(off).sum::<Option<f64>>()?;
    Some((squares / rays.len() as f64).sqrt())
}

/// The direction that a pixel sees.
fn ray(camera: &Pinhole, px: [f64; 2]) -> Option<Vector3<f64>> {
    let bent = Vector2::new((px[0] - camera.cx) / camera.fx, (px[1] - camera.cy) / camera.fy);
    let mut ideal = bent;
    for _ in 0..200 {
        let off = camera.distort(ideal) - bent;
        ideal -= off;
        if off.norm() < 1e-13 {
            return Some(Vector3::new(ideal.x, ideal.y, 1.0));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Pinhole {
        Pinhole { distortion: [-0.2, 0.3, 2e-4, -3e-4, 0.0], ..Pinhole::centred(1280, 720, 2500.0) }
    }

    #[test]
    fn the_same_camera_has_no_error_and_a_turn_of_it_none_either() {
        assert!(model_error_px(&camera(), &camera()).unwrap() < 1e-6);
        // Without distortion a small turn is a shift of the principal point, to second order: 1 px in 2500.
        let plain = Pinhole::centred(1280, 720, 2500.0);
        let shifted = Pinhole { cx: plain.cx + 1.0, ..plain };
        assert!(model_error_px(&plain, &shifted).unwrap() < 0.05);
    }

    #[test]
    fn a_longer_lens_is_off_in_proportion_to_the_radius() {
        let plain = Pinhole::centred(1280, 720, 2500.0);
        let longer = Pinhole { fx: 2525.0, fy: 2525.0, ..plain };
        // RMS of 1 % of the distance from the centre over the image: 0.01 * sqrt((1280^2 + 720^2) / 12) = 4.24 px.
        let found = model_error_px(&plain, &longer).unwrap();
        assert!((found - 4.24).abs() < 0.15, "{found}");
    }
}
