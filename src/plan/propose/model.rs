//! The joint problem as a state that can be moved along each of its unknowns.
//!
//! Everything is differentiated by moving the state and looking again, so that a pose, a point of the workspace and a
//! stereo transform all follow from the same few lines, for both set-ups.

use nalgebra::{DMatrix, Point3, Vector3};

use crate::board::Board;
use crate::config::{Cell, Mount};
use crate::geometry::{Base, Camera, Event, Pinhole, Point, Rgb, Sensor, Target, Tcp, Transform, rotation};

/// Accuracy of a corner in the frame camera, standard deviation along each axis, px.
const RGB_SIGMA_PX: f64 = 0.05;
/// The same for the event camera, px.
const EVENT_SIGMA_PX: f64 = 0.1;
/// How well the robot says where its TCP is, standard deviation along each axis, m and rad. A UR5e repeats to 0.03 mm;
/// its calibrated kinematics is a few times worse over a workspace.
const ROBOT_SIGMA: [f64; 2] = [0.1e-3, 0.2e-3];
/// Places are nominal: what is to be seen keeps this share of the image width from its border.
const BORDER: f64 = 0.005;
/// Share of the corners below which a view is not counted on: the rest of a board at the border is easily lost.
const FEW: f64 = 1.0 / 3.0;
/// A corner is found where its four squares are in the image: their markers are what it is found by.
const SQUARES_AROUND: [[f64; 2]; 4] = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]];

/// One unknown number.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Unknown {
    /// fx, fy, cx, cy, k1, k2, p1, p2 of the camera with this index.
    Lens(usize, usize),
    /// Translation and rotation of `event_from_rgb`, in `rgb`.
    Stereo(usize),
    /// Translation and rotation of the reference camera, in itself.
    Camera(usize),
    /// Translation and rotation of the target, in itself.
    Target(usize),
}

/// Everything that the joint problem asks for, with values.
#[derive(Debug, Clone)]
pub(super) struct State {
    pub(super) cameras: Vec<(Camera, Pinhole)>,
    pub(super) event_from_rgb: Option<Transform<Event, Rgb>>,
    pub(super) mount: Mount,
    pub(super) reference: Camera,
}

impl State {
    fn of(cell: &Cell) -> Self {
        let camera = |camera| Some((camera, cell.nominal_camera(camera)?));
        let cameras: Vec<_> = Camera::BOTH.into_iter().filter_map(camera).collect();
        let both = cameras.len() == 2;
        let event_from_rgb = cell.nominal.event_from_rgb.filter(|_| both);
        Self { cameras, event_from_rgb, mount: cell.nominal.mount, reference: cell.reference_camera() }
    }

    /// `camera` in the reference camera, turned round.
    pub(super) fn camera_from_reference(&self, camera: Camera) -> Transform<Sensor, Sensor> {
        let event_from_rgb = self.event_from_rgb.map_or_else(nalgebra::Isometry3::identity, |t| *t.iso());
        // Both ends are cameras that are known only as data here.
        Transform::assume_frames(match (camera, self.reference) {
            (Camera::Event, Camera::Rgb) => event_from_rgb,
            (Camera::Rgb, Camera::Event) => event_from_rgb.inverse(),
            (Camera::Rgb, Camera::Rgb) | (Camera::Event, Camera::Event) => nalgebra::Isometry3::identity(),
        })
    }

    /// The reference camera in `base`, or in `tcp` where it is carried.
    pub(super) fn seen_from_robot(&self, in_reference: Vector3<f64>) -> Vector3<f64> {
        let iso = match &self.mount {
            Mount::Target { base_from_camera, .. } => base_from_camera.iso(),
            Mount::Cameras { tcp_from_camera, .. } => tcp_from_camera.iso(),
        };
        (iso * Point3::from(in_reference)).coords
    }

    fn project(&self, index: usize, from_target: &Transform<Sensor, Target>, at: Point<Target>) -> Option<[f64; 2]> {
        self.cameras[index].1.project(&Point3::from((*from_target * at).coords_m()))
    }

    fn camera_from_target(&self, index: usize, base_from_tcp: Transform<Base, Tcp>) -> Transform<Sensor, Target> {
        self.camera_from_reference(self.cameras[index].0) * self.mount.camera_from_target(base_from_tcp)
    }

    fn moved(&self, unknown: Unknown, by: f64) -> Self {
        let mut state = self.clone();
        match unknown {
            Unknown::Lens(camera, k) => {
                let lens = &mut state.cameras[camera].1;
                let [k1, k2, p1, p2, _] = &mut lens.distortion;
                *[&mut lens.fx, &mut lens.fy, &mut lens.cx, &mut lens.cy, k1, k2, p1, p2][k] += by;
            }
            Unknown::Stereo(k) => state.event_from_rgb = state.event_from_rgb.map(|t| t * step(k, by)),
            Unknown::Camera(k) => match &mut state.mount {
                Mount::Target { base_from_camera, .. } => *base_from_camera = *base_from_camera * step(k, by),
                Mount::Cameras { tcp_from_camera, .. } => *tcp_from_camera = *tcp_from_camera * step(k, by),
            },
            Unknown::Target(k) => match &mut state.mount {
                Mount::Target { tcp_from_target, .. } => *tcp_from_target = *tcp_from_target * step(k, by),
                Mount::Cameras { base_from_target, .. } => *base_from_target = *base_from_target * step(k, by),
            },
        }
        state
    }
}

/// A small move along x, y, z (m) or turn about them (rad), in one frame.
fn step<F>(k: usize, by: f64) -> Transform<F, F> {
    let at = |first: usize| std::array::from_fn(|i| if first + i == k { by } else { 0.0 });
    Transform::from_parts(at(0), rotation::from_vector(at(3)))
}

/// The joint problem around the nominal places of a cell.
#[derive(Debug, Clone)]
pub(super) struct Model {
    pub(super) nominal: State,
    /// The state a thousandth of the prior sigma back and forth along each unknown.
    moved: Vec<[State; 2]>,
    board: Board,
    corners: Vec<Point<Target>>,
    min_corners: usize,
}

/// Share of a prior sigma by which a state is moved to differentiate.
const SHARE: f64 = 1e-3;

/// What the cameras see at a pose, and what it tells.
#[derive(Debug, Clone)]
pub(super) struct Sight {
    /// Corners that each camera finds, in the order of the cameras.
    pub(super) corners: Vec<usize>,
    /// Fisher information of the unknowns in units of their prior sigma, the board's place eliminated.
    pub(super) information: DMatrix<f64>,
}

impl Model {
    pub(super) fn of(cell: &Cell) -> Self {
        let nominal = State::of(cell);
        let unknowns = unknowns(&nominal);
        let moved = unknowns.iter().map(|(u, sigma)| [-1.0, 1.0].map(|side| nominal.moved(*u, side * SHARE * sigma)));
        let (board, min_corners) = (cell.board.clone(), cell.settings.min_corners);
        let corners: Vec<_> = (0..).map_while(|id| board.corner(id)).collect();
        let min_corners = min_corners.max((FEW * corners.len() as f64).ceil() as usize);
        Self { moved: moved.collect(), nominal, board, corners, min_corners }
    }

    /// Number of unknowns.
    pub(super) fn size(&self) -> usize {
        self.moved.len()
    }

    /// How numbers of a state change with the unknowns, in units of their prior sigma; one row for each number.
    pub(super) fn gradient(&self, numbers: impl Fn(&State) -> Vec<f64>) -> DMatrix<f64> {
        let columns: Vec<Vec<f64>> = self.moved.iter().map(|ends| slope(&ends.each_ref().map(&numbers))).collect();
        let rows = columns.first().map_or(0, Vec::len);
        DMatrix::from_fn(rows, columns.len(), |row, column| columns[column][row])
    }

    /// Ids of the corners that a camera finds.
    fn found(&self, index: usize, base_from_tcp: Transform<Base, Tcp>) -> Vec<usize> {
        let from_target = self.nominal.camera_from_target(index, base_from_tcp);
        let lens = &self.nominal.cameras[index].1;
        let square_m = self.board.square_m;
        let around = |corner: &Point<Target>| {
            let [x, y, _] = corner.xyz_m();
            SQUARES_AROUND.iter().all(|[dx, dy]| {
                let outer = Point::assume_frame([x + dx * square_m, y + dy * square_m, 0.0]);
                self.nominal.project(index, &from_target, outer).is_some_and(|px| well_inside(lens, px))
            })
        };
        (0..self.corners.len()).filter(|id| around(&self.corners[*id])).collect()
    }

    /// Which corners each camera finds; too few for a camera to use are none.
    pub(super) fn seen(&self, base_from_tcp: Transform<Base, Tcp>) -> Vec<Vec<usize>> {
        let of = |index| {
            let found = self.found(index, base_from_tcp);
            if found.len() >= self.min_corners { found } else { Vec::new() }
        };
        (0..self.nominal.cameras.len()).map(of).collect()
    }

    /// What a pose tells; `tied`: the robot's pose enters too, with its own error.
    pub(super) fn sight(&self, base_from_tcp: Transform<Base, Tcp>, tied: bool) -> Sight {
        let seen = self.seen(base_from_tcp);
        let numbers = |state: &State, base_from_tcp| self.pixels(state, &seen, base_from_tcp);
        let by_unknown = self.gradient(|state| numbers(state, base_from_tcp));
        let by_robot: Vec<Vec<f64>> = (0..6)
            .map(|k| {
                let sigma = ROBOT_SIGMA[k / 3];
                let ends = [-1.0, 1.0].map(|side| base_from_tcp * step(k, side * SHARE * sigma));
                slope(&ends.map(|at| numbers(&self.nominal, at)))
            })
            .collect();
        let by_robot = DMatrix::from_fn(by_unknown.nrows(), 6, |row, k| by_robot[k][row]);
        let corners = seen.iter().map(Vec::len).collect();
        Sight { corners, information: eliminated(&by_unknown, &by_robot, tied) }
    }

    /// Where these corners are seen, in units of their accuracy.
    fn pixels(&self, state: &State, seen: &[Vec<usize>], base_from_tcp: Transform<Base, Tcp>) -> Vec<f64> {
        let mut numbers = Vec::new();
        for (index, ids) in seen.iter().enumerate() {
            let from_target = state.camera_from_target(index, base_from_tcp);
            let sigma_px = match state.cameras[index].0 {
                Camera::Rgb => RGB_SIGMA_PX,
                Camera::Event => EVENT_SIGMA_PX,
            };
            for id in ids {
                let px = state.project(index, &from_target, self.corners[*id]);
                // A corner that is found lies far before the camera: a tiny move does not bring it behind.
                numbers.extend(px.unwrap_or_default().map(|v| v / sigma_px));
            }
        }
        numbers
    }
}

fn well_inside(lens: &Pinhole, px: [f64; 2]) -> bool {
    let border_px = BORDER * f64::from(lens.width);
    let [right, bottom] = [lens.width, lens.height].map(|length| f64::from(length) - 1.0 - border_px);
    (border_px..=right).contains(&px[0]) && (border_px..=bottom).contains(&px[1])
}

/// The information on the unknowns that is left when six numbers of the pose are unknown too.
fn eliminated(by_unknown: &DMatrix<f64>, by_robot: &DMatrix<f64>, tied: bool) -> DMatrix<f64> {
    let own = by_robot.transpose() * by_robot + DMatrix::identity(6, 6) * if tied { 1.0 } else { 0.0 };
    let mixed = by_robot.transpose() * by_unknown;
    // Without enough corners the place of the board stays unknown, and nothing is told.
    let Some(own) = own.cholesky() else { return DMatrix::zeros(by_unknown.ncols(), by_unknown.ncols()) };
    let all = by_unknown.transpose() * by_unknown;
    let left = all - mixed.transpose() * own.solve(&mixed);
    (&left + left.transpose()) * 0.5
}

/// Change per prior sigma, from the numbers a share of it back and forth.
fn slope([back, forth]: &[Vec<f64>; 2]) -> Vec<f64> {
    back.iter().zip(forth).map(|(a, b)| (b - a) / (2.0 * SHARE)).collect()
}

/// The unknowns with a mild prior: what a ruler and the data sheet of a lens tell.
fn unknowns(nominal: &State) -> Vec<(Unknown, f64)> {
    let mut all = Vec::new();
    for (index, (_, lens)) in nominal.cameras.iter().enumerate() {
        let centre_px = 0.05 * f64::from(lens.width);
        let sigmas = [0.05 * lens.fx, 0.05 * lens.fy, centre_px, centre_px, 0.5, 2.0, 0.01, 0.01];
        all.extend(sigmas.into_iter().enumerate().map(|(k, sigma)| (Unknown::Lens(index, k), sigma)));
    }
    let place = [0.05, 0.05, 0.05, 0.2, 0.2, 0.2].into_iter().enumerate();
    if nominal.event_from_rgb.is_some() {
        all.extend(place.clone().map(|(k, sigma)| (Unknown::Stereo(k), sigma)));
    }
    all.extend(place.clone().map(|(k, sigma)| (Unknown::Camera(k), sigma)));
    all.extend(place.map(|(k, sigma)| (Unknown::Target(k), sigma)));
    all
}
