//! What each camera should see of the board at a pose, by the nominal places.

use nalgebra::Point3;

use super::{PlannedPose, Refusal};
use crate::config::Cell;
use crate::geometry::{Base, Camera, Point, Sensor, Target, Tcp, Transform, kinematics::Arm};

/// Number of inner corners inside each image; refused where none is, or where a camera sees the back.
pub(super) fn corners_in_view(
    cell: &Cell,
    base_from_tcp: Transform<Base, Tcp>,
) -> Result<Vec<(Camera, usize)>, Refusal> {
    let reference_from_target = cell.nominal.mount.camera_from_target(base_from_tcp);
    let mut seen = Vec::new();
    for camera in Camera::BOTH {
        let Some(model) = cell.nominal_camera(camera) else { continue };
        let Some(camera_from_reference) = cell.camera_from_reference(camera) else { continue };
        let camera_from_target: Transform<Sensor, Target> = camera_from_reference * reference_from_target;
        // z of `target` points into the board: a camera before it is at negative z.
        let in_front = camera_from_target.inverse().translation_m()[2] < 0.0;
        if !in_front {
            return Err(Refusal::FromBehind(camera));
        }
        let corners = (0..).map_while(|id| cell.board.corner(id));
        let inside = |corner: Point<Target>| {
            let at = camera_from_target * corner;
            model.project(&Point3::from(at.coords_m())).is_some_and(|px| model.sees(px))
        };
        seen.push((camera, corners.filter(|corner| inside(*corner)).count()));
    }
    if seen.iter().all(|(_, corners)| *corners == 0) { Err(Refusal::OutOfView) } else { Ok(seen) }
}

/// Whether the event camera should see at least half of the corners from home.
pub(super) fn from_home(cell: &Cell, arm: &Arm) -> bool {
    let base_from_tcp = arm.forward(&cell.robot.home_joints_rad) * cell.robot.tcp_offset;
    let seen = corners_in_view(cell, base_from_tcp).unwrap_or_default();
    seen.iter().any(|(camera, corners)| *camera == Camera::Event && 2 * corners >= cell.board.corner_count())
}

/// One line for each camera that misses corners at poses of a trajectory.
pub(super) fn warnings(cell: &Cell, file: &str, poses: &[PlannedPose]) -> Vec<String> {
    let all = cell.board.corner_count();
    let of = |pose: &PlannedPose, camera| pose.corners_in_view.iter().find(|(c, _)| *c == camera).map(|(_, n)| *n);
    let mut lines = Vec::new();
    for camera in Camera::BOTH {
        let partial: Vec<_> =
            poses.iter().filter_map(|p| of(p, camera).filter(|n| *n < all).map(|n| (n, &p.id))).collect();
        if let Some((fewest, id)) = partial.iter().min_by_key(|(n, _)| *n) {
            let (some, total) = (partial.len(), poses.len());
            lines.push(format!(
                "{file}: the {camera} camera should see all {all} corners at {} of {total} poses; fewest at {id}: {fewest}",
                total - some
            ));
        }
    }
    lines
}
