//! A trajectory: the stops to visit, or the patterns that make them. Metres and radians.

use nalgebra::{UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::board::Board;
use crate::calibration::settings::PoseKind;
use crate::geometry::{Base, Camera, Sensor, Target, Tcp, Transform, kinematics::Joints};

/// A trajectory, as its file describes it.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// Letters, digits, `-` and `_`; the ids of its poses begin with it.
    pub name: String,
    /// The file as the caller named it, for messages.
    pub file: String,
    /// The parts, in order; at least one stop altogether.
    pub segments: Vec<Segment>,
}

/// A part of a trajectory.
#[derive(Debug, Clone, PartialEq)]
pub struct Segment {
    /// How its stops are approached.
    pub motion: Motion,
    /// What its stops are for; absent: what the cell says of the file.
    pub purpose: Option<PoseKind>,
    /// The camera that its views are for; absent, or not in the cell: the reference camera.
    pub camera: Option<Camera>,
    /// Its stops.
    pub pattern: Pattern,
}

/// How a stop is approached.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Motion {
    /// Each joint on its shortest way.
    #[default]
    Joint,
    /// The TCP on a straight line.
    Linear,
}

/// How the board lies before a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardView {
    /// Centre of the board in the camera, metres.
    pub centre_m: [f64; 3],
    /// Rotation of `camera_from_target`; none: square to the camera and upright.
    pub rotation: UnitQuaternion<f64>,
}

impl BoardView {
    /// The pose of the board's frame, whose origin is its top-left corner.
    pub fn camera_from_target(&self, board: &Board) -> Transform<Sensor, Target> {
        let centre_from_origin = self.rotation * board.centre().coords_m();
        Transform::from_parts((Vector3::from(self.centre_m) - centre_from_origin).into(), self.rotation)
    }

    /// The board turned by `turn` about its centre, in the axes of the camera.
    pub fn turned(&self, turn: &UnitQuaternion<f64>) -> Self {
        Self { rotation: turn * self.rotation, ..*self }
    }

    /// The board moved in the axes of the camera, metres.
    pub fn moved(&self, by_m: [f64; 3]) -> Self {
        Self { centre_m: std::array::from_fn(|i| self.centre_m[i] + by_m[i]), ..*self }
    }
}

/// A stop with an id of its own, if the file gives one.
#[derive(Debug, Clone, PartialEq)]
pub struct Stop<T> {
    /// Id from the file.
    pub id: Option<String>,
    /// Where.
    pub at: T,
}

/// How a segment makes its stops.
#[derive(Debug, Clone, PartialEq)]
pub enum Pattern {
    /// Joint positions, rad.
    Joints(Vec<Stop<Joints>>),
    /// Poses of the TCP.
    Tcp(Vec<Stop<Transform<Base, Tcp>>>),
    /// Views of the board.
    Views(Vec<Stop<BoardView>>),
    /// The board over a grid in the image plane, row by row, every second row backwards, around `view`.
    Grid {
        /// The middle.
        view: BoardView,
        /// Stops along x.
        columns: u32,
        /// Stops along y.
        rows: u32,
        /// Distance along x and y, metres.
        step_m: [f64; 2],
    },
    /// The board along the optical axis, nearest first for a positive step, around `view`.
    Depth {
        /// The middle.
        view: BoardView,
        /// Number of stops.
        count: u32,
        /// Distance, metres.
        step_m: f64,
    },
    /// The board turned about the optical axis, around `view`.
    Roll {
        /// The middle.
        view: BoardView,
        /// Number of stops.
        count: u32,
        /// Angle, rad.
        step_rad: f64,
    },
    /// From one view to another, both included: straight in position, on the group in rotation.
    Sweep {
        /// First view.
        from: BoardView,
        /// Last view.
        to: BoardView,
        /// Number of stops.
        count: u32,
    },
    /// The board tilted to all sides while its centre stays in place.
    Orbit {
        /// Rings of equal tilt, in order.
        rings: Vec<Ring>,
    },
    /// Two stops each, apart by a known displacement.
    Translate(Vec<Pair>),
}

/// Stops of equal tilt, one for each azimuth.
#[derive(Debug, Clone, PartialEq)]
pub struct Ring {
    /// Centre of the board in the camera, metres.
    pub centre_m: [f64; 3],
    /// Angle between optical axis and the normal of the board, rad.
    pub tilt_rad: f64,
    /// Number of azimuths, spread evenly.
    pub count: u32,
    /// First azimuth: the axis of the tilt, from x towards y, rad.
    pub first_azimuth_rad: f64,
    /// Turns of the board in its own plane, one after the other and again from the first, rad.
    pub rolls_rad: Vec<f64>,
}

/// Two stops for the distance check.
#[derive(Debug, Clone, PartialEq)]
pub struct Pair {
    /// Name of the pair.
    pub name: String,
    /// Where it begins.
    pub start: Start,
    /// From the first TCP position to the second, in `base`, metres; the rotation stays.
    pub displacement_m: [f64; 3],
    /// The distance as something better than the robot measured it, metres; absent: that of the displacement.
    pub known_m: Option<f64>,
}

impl Pair {
    /// The distance that the check compares with, metres.
    pub fn truth_m(&self) -> f64 {
        self.known_m.unwrap_or_else(|| Vector3::from(self.displacement_m).norm())
    }
}

/// Where a pair begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Start {
    /// At a view.
    View(BoardView),
    /// At a pose of the TCP.
    Tcp(Transform<Base, Tcp>),
}
