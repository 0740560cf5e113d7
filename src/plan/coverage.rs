//! Whether planned views can tell what the cameras are: over the whole image, near and far, tilted to all sides.
//!
//! Judged by the nominal places, before any motion, and said in sentences that name the poses to add.

use nalgebra::{Point3, Vector3};
use serde::Serialize;

use super::Plan;
use crate::config::Cell;
use crate::geometry::{Camera, Pinhole, Point, Sensor, Target, Transform};

/// Columns and rows of the parts of an image that are looked at one by one.
const PARTS: [usize; 2] = [6, 4];
/// Smallest share of these parts with a corner in at least one view. The calibrator of ROS (camera_calibration) wants
/// the board's places to span 0.7 of the image along x and along y; what lies outside is extrapolated distortion.
pub const MIN_COVERED: f64 = 0.7;
/// Smallest ratio of the farthest to the nearest distance. The published 39 poses have 1.28 with a fixed lens at f/11;
/// ROS wants more (0.4 of the image in size), which such a lens does not keep sharp.
pub const MIN_DEPTH_RATIO: f64 = 1.15;
/// Smallest sum of the largest tilts to both sides of an axis, rad (40 deg). Boards parallel to the image tell nothing of
/// the focal length; its error is smallest around 45 deg (Zhang 2000), where displays lose their contrast.
pub const MIN_TILT_RAD: f64 = 40.0 * std::f64::consts::PI / 180.0;

/// What the planned views show one camera.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Coverage {
    /// The camera.
    pub camera: Camera,
    /// Poses at which it sees enough of the board.
    pub poses: usize,
    /// Share of the parts of its image with a corner in at least one view, 0 to 1.
    pub covered: f64,
    /// Region of the image with the most parts without a corner; absent where all have one.
    pub emptiest: Option<&'static str>,
    /// Nearest and farthest distance of the board's centre, m; zeros without any view.
    pub depths_m: [f64; 2],
    /// Largest tilt of the board with its left, right, upper and lower edge turned away, rad.
    pub tilts_rad: [f64; 4],
}

const SIDES: [&str; 4] = ["left", "right", "upper", "lower"];

/// Looks at the views of each camera of the cell.
pub fn coverage(cell: &Cell, plan: &Plan) -> Vec<Coverage> {
    Camera::BOTH.into_iter().filter_map(|camera| of(cell, plan, camera)).collect()
}

fn of(cell: &Cell, plan: &Plan, camera: Camera) -> Option<Coverage> {
    let (lens, camera_from_reference) = (cell.nominal_camera(camera)?, cell.camera_from_reference(camera)?);
    let mut hit = [[false; PARTS[0]]; PARTS[1]];
    let (mut poses, mut depths_m, mut tilts_rad) = (0, None::<[f64; 2]>, [0.0_f64; 4]);
    for pose in &plan.poses {
        let from_target: Transform<Sensor, Target> =
            camera_from_reference * cell.nominal.mount.camera_from_target(pose.base_from_tcp);
        let corners = corners_px(cell, &lens, &from_target);
        if corners.len() < cell.settings.min_corners {
            continue;
        }
        poses += 1;
        for px in &corners {
            let [column, row] = part_of(&lens, *px);
            hit[row][column] = true;
        }
        let depth_m = (from_target * cell.board.centre()).xyz_m()[2];
        depths_m = Some(depths_m.map_or([depth_m; 2], |[near, far]| [near.min(depth_m), far.max(depth_m)]));
        let tilts = tilts_of(&from_target);
        tilts_rad = std::array::from_fn(|side| tilts_rad[side].max(tilts[side]));
    }
    let seen = hit.iter().flatten().filter(|h| **h).count();
    let covered = seen as f64 / (PARTS[0] * PARTS[1]) as f64;
    Some(Coverage {
        camera,
        poses,
        covered,
        emptiest: emptiest(&hit),
        depths_m: depths_m.unwrap_or_default(),
        tilts_rad,
    })
}

fn corners_px(cell: &Cell, lens: &Pinhole, from_target: &Transform<Sensor, Target>) -> Vec<[f64; 2]> {
    let corners = (0..).map_while(|id| cell.board.corner(id));
    let at = |corner: Point<Target>| lens.project(&Point3::from((*from_target * corner).coords_m()));
    corners.filter_map(at).filter(|px| lens.sees(*px)).collect()
}

/// Column and row of the part of the image that holds a pixel.
fn part_of(lens: &Pinhole, px: [f64; 2]) -> [usize; 2] {
    let lengths = [lens.width, lens.height].map(f64::from);
    std::array::from_fn(|i| (((px[i] + 0.5) / lengths[i] * PARTS[i] as f64) as usize).min(PARTS[i] - 1))
}

/// Tilt with the left, right, upper and lower edge turned away from the camera, rad; zero on the other side.
fn tilts_of(from_target: &Transform<Sensor, Target>) -> [f64; 4] {
    // z of the target points away from the camera: where it leans to the right, the left edge is turned away.
    let normal = from_target.rotation() * Vector3::z();
    let [x, y] = [normal.x, normal.y].map(|side| side.atan2(normal.z));
    [x, -x, y, -y].map(|tilt| tilt.max(0.0))
}

/// The ninth of the image with the most parts without a corner; of equals one at a corner of the image.
fn emptiest(hit: &[[bool; PARTS[0]]; PARTS[1]]) -> Option<&'static str> {
    const NAMES: [[&str; 3]; 3] = [
        ["the upper left", "the upper middle", "the upper right"],
        ["the left", "the middle", "the right"],
        ["the lower left", "the lower middle", "the lower right"],
    ];
    let mut missing = [[0_usize; 3]; 3];
    for (row, parts) in hit.iter().enumerate() {
        for (column, _) in parts.iter().enumerate().filter(|(_, hit)| !**hit) {
            missing[row * 3 / PARTS[1]][column * 3 / PARTS[0]] += 1;
        }
    }
    let corner_first = [[0, 0], [0, 2], [2, 0], [2, 2], [1, 0], [1, 2], [0, 1], [2, 1], [1, 1]];
    let most = corner_first.into_iter().rev().max_by_key(|[row, column]| missing[*row][*column])?;
    (missing[most[0]][most[1]] > 0).then_some(NAMES[most[0]][most[1]])
}

impl Coverage {
    /// One line of numbers.
    pub fn summary(&self) -> String {
        let Self { camera, poses, covered, depths_m, tilts_rad, .. } = self;
        let [near_mm, far_mm] = depths_m.map(|m| m * 1e3);
        let tilts: Vec<_> = SIDES.iter().zip(tilts_rad).map(|(s, t)| format!("{s} {:.0}", t.to_degrees())).collect();
        format!(
            "{camera}: {poses} poses with corners in {:.0} % of the image, board at {near_mm:.0} to {far_mm:.0} mm, edge turned \
             away by at most (deg) {}",
            covered * 100.0,
            tilts.join(", ")
        )
    }

    /// What is short, and which poses to add.
    pub fn advice(&self) -> Vec<String> {
        let Self { camera, covered, emptiest, depths_m: [near_m, far_m], tilts_rad, .. } = self;
        let mut lines = Vec::new();
        let is_covered = *covered >= MIN_COVERED;
        if let (false, Some(region)) = (is_covered, emptiest) {
            let (found, wanted) = (covered * 100.0, MIN_COVERED * 100.0);
            lines.push(format!(
                "{camera}: corners reach {found:.0} % of the image, {wanted:.0} % are wanted: add poses with the board in \
                 {region} of its image"
            ));
        }
        let deep = far_m / near_m >= MIN_DEPTH_RATIO;
        if !deep {
            lines.push(format!(
                "{camera}: the board stays at {:.0} to {:.0} mm: add poses nearer or farther, so that the farthest is at \
                 least {MIN_DEPTH_RATIO} times the nearest",
                near_m * 1e3,
                far_m * 1e3
            ));
        }
        for axis in [0, 2] {
            let [one_rad, other_rad] = [tilts_rad[axis], tilts_rad[axis + 1]];
            let is_tilted = one_rad + other_rad >= MIN_TILT_RAD;
            if !is_tilted {
                let flatter = if one_rad <= other_rad { SIDES[axis] } else { SIDES[axis + 1] };
                lines.push(format!(
                    "{camera}: add poses with the {flatter} edge of the board turned away by 20 to 40 deg"
                ));
            }
        }
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{PoseKind, parse_cell, parse_trajectory};
    use crate::plan::expand;

    fn sim() -> Cell {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("cells/sim.yaml");
        parse_cell(&std::fs::read_to_string(path).unwrap(), "sim.yaml").unwrap()
    }

    /// What the event camera is shown by views with these centres (mm) and rotation vectors (deg).
    fn shown(views: &[([f64; 3], [f64; 3])]) -> Coverage {
        let mut yaml = String::from("name: t\nsegments:\n  - pattern: views\n    camera: event\n    poses:\n");
        for (centre, turn) in views {
            yaml.push_str(&format!("      - view: {{centre_mm: {centre:?}, rotvec_deg: {turn:?}}}\n"));
        }
        let plan = expand(&sim(), &[(PoseKind::HandEye, parse_trajectory(&yaml, "t.yaml").unwrap())]).unwrap();
        let found = coverage(&sim(), &plan);
        found.into_iter().find(|c| c.camera == Camera::Event).unwrap()
    }

    #[test]
    fn tilts_are_told_by_the_edge_that_is_turned_away() {
        // Turned about y, the right edge comes nearer; turned about x, the lower one goes away.
        for (turn, side) in
            [([0.0, 25.0, 0.0], 0), ([0.0, -25.0, 0.0], 1), ([-25.0, 0.0, 0.0], 2), ([25.0, 0.0, 0.0], 3)]
        {
            let found = shown(&[([17.2, 0.0, 300.0], turn)]);
            let wanted: [f64; 4] = std::array::from_fn(|i| if i == side { 25.0_f64.to_radians() } else { 0.0 });
            for (a, b) in found.tilts_rad.iter().zip(wanted) {
                assert!((a - b).abs() < 1e-9, "{turn:?}: {found:?}");
            }
        }
    }

    #[test]
    fn what_is_short_is_named_with_the_poses_to_add() {
        let flat = shown(&[([17.2, 0.0, 300.0], [0.0; 3]), ([0.0, -10.0, 310.0], [0.0, 30.0, 0.0])]);
        let advice = flat.advice();
        assert_eq!(advice.len(), 4, "{advice:?}");
        assert!(
            advice[0].starts_with("event: corners reach") && advice[0].contains("are wanted: add poses"),
            "{advice:?}"
        );
        assert!(advice[1].starts_with("event: the board stays at 300 to 310 mm"), "{advice:?}");
        assert_eq!(advice[2], "event: add poses with the right edge of the board turned away by 20 to 40 deg");
        assert!(flat.summary().contains("board at 300 to 310 mm"), "{}", flat.summary());
        assert!((flat.depths_m[0] - 0.3).abs() < 1e-9 && flat.poses == 2);
    }

    #[test]
    fn without_a_view_everything_is_wanted() {
        let found = coverage(&sim(), &Plan::default());
        assert!(found.iter().all(|c| c.poses == 0 && c.covered == 0.0 && c.advice().len() == 4), "{found:?}");
    }
}
