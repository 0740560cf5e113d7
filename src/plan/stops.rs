//! From patterns to single stops: where, how and under which id.

use std::collections::BTreeSet;

use nalgebra::{UnitQuaternion, Vector3};

use super::PairRef;
use crate::config::{BoardView, Cell, Motion, Pattern, PoseKind, Ring, Segment, Start, Trajectory};
use crate::geometry::{Base, Camera, Tcp, Transform, kinematics::Joints, rotation};

/// Where a stop is.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Goal {
    Joints(Joints),
    Tcp(Transform<Base, Tcp>),
}

/// One stop of a trajectory.
#[derive(Debug, Clone)]
pub(super) struct Stop {
    pub(super) id: String,
    /// What it is for, where the trajectory says so.
    pub(super) purpose: Option<PoseKind>,
    pub(super) pair: Option<PairRef>,
    pub(super) motion: Motion,
    pub(super) goal: Goal,
}

/// The stops of a trajectory, in order.
pub(super) fn of(cell: &Cell, trajectory: &Trajectory) -> Vec<Stop> {
    let mut stops = Vec::new();
    for segment in &trajectory.segments {
        for place in places(cell, segment) {
            let number = stops.len() + 1;
            let id = match (&place.id, &place.pair) {
                (Some(id), None) => id.clone(),
                (Some(id), Some(_)) => format!("{}-{id}", trajectory.name),
                (None, _) => format!("{}-{number:02}", trajectory.name),
            };
            let (purpose, motion) = (segment.purpose, place.motion);
            stops.push(Stop { id, purpose, pair: place.pair, motion, goal: place.goal });
        }
    }
    stops
}

/// A stop before it has its id.
struct Place {
    id: Option<String>,
    pair: Option<PairRef>,
    motion: Motion,
    goal: Goal,
}

fn places(cell: &Cell, segment: &Segment) -> Vec<Place> {
    let &Segment { motion, camera, ref pattern, .. } = segment;
    let place = |id: &Option<String>, goal| Place { id: id.clone(), pair: None, motion, goal };
    let seen = |view: &BoardView| Goal::Tcp(tcp_of(cell, camera, view));
    let unnamed = |views: Vec<BoardView>| views.iter().map(|view| place(&None, seen(view))).collect();
    match pattern {
        Pattern::Joints(stops) => stops.iter().map(|s| place(&s.id, Goal::Joints(s.at))).collect(),
        Pattern::Tcp(stops) => stops.iter().map(|s| place(&s.id, Goal::Tcp(s.at))).collect(),
        Pattern::Views(stops) => stops.iter().map(|s| place(&s.id, seen(&s.at))).collect(),
        Pattern::Grid { view, columns, rows, step_m } => unnamed(grid(view, *columns, *rows, *step_m)),
        Pattern::Depth { view, count, step_m } => {
            unnamed(centred(*count).map(|i| view.moved([0.0, 0.0, i * step_m])).collect())
        }
        Pattern::Roll { view, count, step_rad } => {
            unnamed(centred(*count).map(|i| view.turned(&about_z(i * step_rad))).collect())
        }
        Pattern::Sweep { from, to, count } => unnamed(sweep(from, to, *count)),
        Pattern::Orbit { rings } => unnamed(rings.iter().flat_map(ring).collect()),
        Pattern::Translate(pairs) => pairs
            .iter()
            .flat_map(|pair| {
                let start = match &pair.start {
                    Start::View(view) => tcp_of(cell, camera, view),
                    Start::Tcp(base_from_tcp) => *base_from_tcp,
                };
                let end = moved_in_base(&start, pair.displacement_m);
                // Both poses go to the controller as TCP poses where the move is linear: its own calibrated
                // kinematics then makes the displacement, not our nominal model of the arm.
                [("a", start), ("b", end)].map(|(letter, goal)| Place {
                    id: Some(format!("{}-{letter}", pair.name)),
                    pair: Some(PairRef { name: pair.name.clone(), truth_m: pair.truth_m() }),
                    motion,
                    goal: Goal::Tcp(goal),
                })
            })
            .collect(),
    }
}

fn moved_in_base(base_from_tcp: &Transform<Base, Tcp>, by_m: [f64; 3]) -> Transform<Base, Tcp> {
    let from = base_from_tcp.translation_m();
    Transform::from_parts(std::array::from_fn(|i| from[i] + by_m[i]), base_from_tcp.rotation())
}

/// The pose of the arm at which `camera` sees the board so; a camera that the cell lacks gives way to its reference.
fn tcp_of(cell: &Cell, camera: Option<Camera>, view: &BoardView) -> Transform<Base, Tcp> {
    let there = camera.filter(|camera| cell.nominal_camera(*camera).is_some());
    let camera_from_reference = there.and_then(|camera| cell.camera_from_reference(camera));
    let reference_from_camera = camera_from_reference.map_or_else(Transform::identity, Transform::inverse);
    cell.nominal.mount.base_from_tcp(reference_from_camera * view.camera_from_target(&cell.board))
}

/// One line for each camera that views of the trajectory are for and that the cell lacks.
pub(super) fn warnings(cell: &Cell, trajectory: &Trajectory) -> Vec<String> {
    let named: BTreeSet<Camera> = trajectory.segments.iter().filter_map(|s| s.camera).collect();
    let lacking = named.into_iter().filter(|camera| cell.nominal_camera(*camera).is_none());
    let (file, reference) = (&trajectory.file, cell.reference_camera());
    let line = |camera| {
        format!("{file}: its views are for the {camera} camera, which the cell does not have; taken for {reference}")
    };
    lacking.map(line).collect()
}

/// `count` numbers, one apart, around 0.
fn centred(count: u32) -> impl Iterator<Item = f64> {
    (0..count).map(move |i| f64::from(i) - f64::from(count - 1) / 2.0)
}

fn about_z(angle_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_rad)
}

fn grid(view: &BoardView, columns: u32, rows: u32, step_m: [f64; 2]) -> Vec<BoardView> {
    let mut views = Vec::new();
    for (row, y) in centred(rows).enumerate() {
        let mut xs: Vec<f64> = centred(columns).collect();
        if row % 2 == 1 {
            xs.reverse();
        }
        views.extend(xs.iter().map(|x| view.moved([x * step_m[0], y * step_m[1], 0.0])));
    }
    views
}

fn sweep(from: &BoardView, to: &BoardView, count: u32) -> Vec<BoardView> {
    let at = |i: u32| {
        let fraction = f64::from(i) / f64::from(count.max(2) - 1);
        BoardView {
            centre_m: std::array::from_fn(|k| from.centre_m[k] + fraction * (to.centre_m[k] - from.centre_m[k])),
            rotation: rotation::interpolate(&from.rotation, &to.rotation, fraction),
        }
    };
    (0..count).map(at).collect()
}

/// The board turned in its own plane, then tilted about an axis in the image plane.
fn ring(ring: &Ring) -> Vec<BoardView> {
    let rolls = ring.rolls_rad.iter().cycle();
    let at = |(i, roll_rad): (u32, &f64)| {
        let azimuth_rad = ring.first_azimuth_rad + std::f64::consts::TAU * f64::from(i) / f64::from(ring.count);
        let axis = Vector3::new(azimuth_rad.cos(), azimuth_rad.sin(), 0.0);
        let rotation = UnitQuaternion::from_scaled_axis(axis * ring.tilt_rad) * about_z(*roll_rad);
        BoardView { centre_m: ring.centre_m, rotation }
    };
    (0..ring.count).zip(rolls).map(at).collect()
}
