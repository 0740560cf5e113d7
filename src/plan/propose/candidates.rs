//! Views that may be chosen: drawn at random, and kept where the cameras see them and the arm gets there.

use nalgebra::{DMatrix, UnitQuaternion, Vector3};
use rand::{Rng as _, SeedableRng as _};
use rand_pcg::Pcg64;
use rayon::prelude::*;

use super::super::Clearance;
use super::super::motion;
use super::super::reach::{distance_rad, joints_at};
use super::super::stops::Goal;
use super::model::{Model, Sight};
use crate::config::{BoardView, Cell, Motion, Mount};
use crate::geometry::{
    Base, Camera, Pinhole, Point, Sensor, Target, Tcp, Transform,
    kinematics::{Arm, Joints},
    rotation,
};

/// Farthest that a display is looked at from above or below, rad: published corner rates are whole to 60 deg, but the
/// corners get worse from 50 deg on.
pub(super) const MAX_VERTICAL_RAD: f64 = 45.0 * std::f64::consts::PI / 180.0;
/// Farthest that it is looked at from the left or right, rad: published corner rates fall from 50 deg on.
pub(super) const MAX_HORIZONTAL_RAD: f64 = 40.0 * std::f64::consts::PI / 180.0;
/// Largest turn of the board in its own plane, rad: a quarter turn tells the centre of the image from a tilted camera.
const MAX_ROLL_RAD: f64 = 95.0 * std::f64::consts::PI / 180.0;
/// Farthest that a joint is from home, rad: moves stay short, and the arm keeps its configuration.
const NEAR_HOME_RAD: f64 = 1.8;
/// Share of the corners that at least one camera must find.
const MIN_SHARE: f64 = 0.6;
/// Share of the corners that the reference camera must find at both stops of a pair.
const PAIR_SHARE: f64 = 0.75;
/// Length of the displacement of a pair, m: shorter ones are lost in the noise, longer ones leave the view.
const PAIR_M: [f64; 2] = [0.03, 0.06];

/// A place that the arm may visit.
#[derive(Debug, Clone)]
pub(super) struct Stand {
    pub(super) joints_rad: Joints,
    pub(super) base_from_tcp: Transform<Base, Tcp>,
}

/// What may be chosen: a stop, or a pair of stops a known displacement apart.
#[derive(Debug, Clone)]
pub(super) struct Item {
    /// The view at the first stop, for the reference camera.
    pub(super) view: BoardView,
    pub(super) first: Stand,
    /// The second stop of a pair with its displacement in `base`, m, and the time of the move between them, s.
    pub(super) second: Option<(Stand, [f64; 3], f64)>,
    /// What it tells.
    pub(super) information: DMatrix<f64>,
    /// Share of the corners that each camera misses, summed over its stops.
    pub(super) missed: Vec<f64>,
    /// Whether the hand-eye fit can use it: the reference camera sees enough.
    pub(super) for_arm: bool,
}

impl Item {
    pub(super) fn stops(&self) -> usize {
        if self.second.is_some() { 2 } else { 1 }
    }

    /// Where the arm is afterwards.
    pub(super) fn exit(&self) -> &Stand {
        self.second.as_ref().map_or(&self.first, |(stand, ..)| stand)
    }
}

/// Draws views and looks at them.
pub(super) struct Draw<'a> {
    pub(super) cell: &'a Cell,
    pub(super) arm: &'a Arm,
    pub(super) clearance: &'a Clearance,
    pub(super) model: &'a Model,
    /// Nearest and farthest distance of the board from the reference camera, m.
    pub(super) depths_m: [f64; 2],
}

impl Draw<'_> {
    /// The single stops among so many draws, in the order of the draws.
    pub(super) fn singles(&self, count: usize, seed: u64) -> Vec<Item> {
        let mut rng = Pcg64::seed_from_u64(seed);
        let views: Vec<_> = (0..count).map(|_| self.view(&mut rng)).collect();
        views.into_par_iter().filter_map(|view| self.single(view?)).collect()
    }

    /// The pairs among so many draws whose displacement lies along the optical axis, or across it.
    pub(super) fn pairs(&self, count: usize, seed: u64, along: bool) -> Vec<Item> {
        let mut rng = Pcg64::seed_from_u64(seed);
        let drawn = |_| {
            let view = self.view(&mut rng);
            let length_mm = (1e3 * rng.random_range(PAIR_M[0]..PAIR_M[1])).round();
            let angle_rad = rng.random_range(0.0..std::f64::consts::TAU);
            let unit: Vector3<f64> =
                if along { Vector3::z() } else { Vector3::new(angle_rad.cos(), angle_rad.sin(), 0.0) };
            (view, unit * length_mm)
        };
        let drawn: Vec<_> = (0..count).map(drawn).collect();
        drawn.into_par_iter().filter_map(|(view, displacement_mm)| self.pair(view?, displacement_mm)).collect()
    }

    /// A view of one of the cameras, as the reference camera has it, rounded as it is written.
    fn view(&self, rng: &mut Pcg64) -> Option<BoardView> {
        let cameras = &self.model.nominal.cameras;
        let (camera, lens) = cameras.get(rng.random_range(0..cameras.len()))?;
        let seen = self.before(lens, rng);
        let reference_from_camera = self.model.nominal.camera_from_reference(*camera).inverse();
        let centre = reference_from_camera * Point::<Sensor>::assume_frame(seen.centre_m);
        let turned = reference_from_camera.rotation() * seen.rotation;
        let rounded = |v: f64, steps: f64| (v * steps).round() / steps;
        let degrees = rotation::to_vector(&turned).map(|v| rounded(v.to_degrees(), 10.0).to_radians());
        let centre_m = centre.xyz_m().map(|v| rounded(v * 1e3, 10.0) / 1e3);
        (centre_m[2] > 0.0).then(|| BoardView { centre_m, rotation: rotation::from_vector(degrees.into()) })
    }

    /// The board anywhere in an image, tilted and turned.
    fn before(&self, lens: &Pinhole, rng: &mut Pcg64) -> BoardView {
        let depth_m = rng.random_range(self.depths_m[0]..=self.depths_m[1]);
        let px = [lens.width, lens.height].map(|length| rng.random_range(0.0..f64::from(length)));
        let ray = Vector3::new((px[0] - lens.cx) / lens.fx, (px[1] - lens.cy) / lens.fy, 1.0);
        let azimuth_rad = rng.random_range(0.0..std::f64::consts::TAU);
        // The root makes all directions inside the largest tilt equally likely.
        let tilt_rad = MAX_VERTICAL_RAD * rng.random_range(0.0..1.0_f64).sqrt();
        let roll_rad = rng.random_range(-MAX_ROLL_RAD..=MAX_ROLL_RAD);
        let axis = Vector3::new(azimuth_rad.cos(), azimuth_rad.sin(), 0.0);
        let towards = UnitQuaternion::rotation_between(&Vector3::z(), &ray).unwrap_or_default();
        let roll = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), roll_rad);
        let rotation = towards * UnitQuaternion::from_scaled_axis(axis * tilt_rad) * roll;
        BoardView { centre_m: (ray * depth_m).into(), rotation }
    }

    fn single(&self, view: BoardView) -> Option<Item> {
        let first = self.stand(&view)?;
        let for_arm = self.reference_finds(&first);
        let sight = self.model.sight(first.base_from_tcp, for_arm);
        let missed = self.missed(&sight);
        Some(Item { view, first, second: None, information: sight.information, missed, for_arm })
    }

    /// The reference camera sees nearly the whole board at both stops: the check compares positions through it.
    fn pair(&self, view: BoardView, displacement_mm: Vector3<f64>) -> Option<Item> {
        let first = self.stand(&view)?;
        let in_base = self.base_from_reference(&first) * displacement_mm;
        let displacement_m: [f64; 3] = in_base.map(|v: f64| v.round() / 1e3).into();
        let from = first.base_from_tcp.translation_m();
        let to = std::array::from_fn(|i| from[i] + displacement_m[i]);
        let goal = Goal::Tcp(Transform::from_parts(to, first.base_from_tcp.rotation()));
        let Self { cell, arm, clearance, .. } = self;
        let leg = motion::leg(cell, arm, clearance, &first.joints_rad, &goal, Motion::Linear).ok()?;
        let second = Stand { joints_rad: leg.joints_rad, base_from_tcp: leg.base_from_tcp };
        let fits = self.looked_at_well(&second.base_from_tcp) && self.near_home(&second.joints_rad);
        let sights = [&first, &second].map(|stand| self.model.sight(stand.base_from_tcp, false));
        let misses = sights.each_ref().map(|sight| self.missed(sight));
        let reference = self.model.nominal.cameras.iter().position(|(c, _)| *c == self.model.nominal.reference)?;
        let whole = misses.iter().all(|missed| missed[reference] <= 1.0 - PAIR_SHARE);
        let missed = misses[0].iter().zip(&misses[1]).map(|(a, b)| a + b).collect();
        let [a, b] = sights.map(|sight| sight.information);
        let second = Some((second, displacement_m, leg.duration_s));
        (fits && whole).then(|| Item { view, first, second, information: a + b, missed, for_arm: false })
    }

    /// Directions of the reference camera in `base`.
    fn base_from_reference(&self, at: &Stand) -> UnitQuaternion<f64> {
        match self.cell.nominal.mount {
            Mount::Target { base_from_camera, .. } => base_from_camera.rotation(),
            Mount::Cameras { tcp_from_camera, .. } => (at.base_from_tcp * tcp_from_camera).rotation(),
        }
    }

    /// Where the arm shows this view, if it may stand there near home and the display is not looked at too flatly.
    fn stand(&self, view: &BoardView) -> Option<Stand> {
        let Self { cell, arm, clearance, .. } = self;
        let base_from_tcp = cell.nominal.mount.base_from_tcp(view.camera_from_target(&cell.board));
        let well = self.looked_at_well(&base_from_tcp) && self.seen_by_any(base_from_tcp);
        if !well {
            return None;
        }
        let joints_rad = joints_at(cell, arm, &base_from_tcp, &cell.robot.home_joints_rad).ok()?;
        let stands = self.near_home(&joints_rad) && clearance.at(&joints_rad).is_ok();
        stands.then_some(Stand { joints_rad, base_from_tcp })
    }

    fn near_home(&self, joints_rad: &Joints) -> bool {
        distance_rad(joints_rad, &self.cell.robot.home_joints_rad) <= NEAR_HOME_RAD
    }

    /// Cheap, before any joint position is looked for.
    fn seen_by_any(&self, base_from_tcp: Transform<Base, Tcp>) -> bool {
        let wanted = MIN_SHARE * self.cell.board.corner_count() as f64;
        self.model.seen(base_from_tcp).iter().any(|ids| ids.len() as f64 >= wanted)
    }

    /// Whether each camera looks at the display within its angles.
    fn looked_at_well(&self, base_from_tcp: &Transform<Base, Tcp>) -> bool {
        let nominal = &self.model.nominal;
        let reference_from_target = nominal.mount.camera_from_target(*base_from_tcp);
        nominal.cameras.iter().all(|(camera, _)| {
            let from_target = nominal.camera_from_reference(*camera) * reference_from_target;
            let [x, y] = looking_angles_rad(&from_target, self.cell.board.centre().coords_m());
            (x / MAX_HORIZONTAL_RAD).hypot(y / MAX_VERTICAL_RAD) <= 1.0
        })
    }

    fn reference_finds(&self, at: &Stand) -> bool {
        let seen = self.model.seen(at.base_from_tcp);
        let of = |camera: Camera| self.model.nominal.cameras.iter().position(|(c, _)| *c == camera);
        of(self.model.nominal.reference).and_then(|i| seen.get(i)).is_some_and(|ids| !ids.is_empty())
    }

    fn missed(&self, sight: &Sight) -> Vec<f64> {
        let all = self.cell.board.corner_count() as f64;
        sight.corners.iter().map(|found| 1.0 - *found as f64 / all).collect()
    }
}

/// From the left or right, and from above or below, the angles at which a camera looks at a point of the display, rad;
/// a half turn where it looks at its back.
pub(super) fn looking_angles_rad(camera_from_target: &Transform<Sensor, Target>, at_m: Vector3<f64>) -> [f64; 2] {
    let eye = Vector3::from(camera_from_target.inverse().translation_m()) - at_m;
    // z of the target points away from who looks at it.
    [eye.x, eye.y].map(|side| side.abs().atan2(-eye.z))
}
