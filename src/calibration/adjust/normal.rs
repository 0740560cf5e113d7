//! Normal equations: each pose by itself, its own six unknowns eliminated, then summed in the order of the poses.

use nalgebra::{Isometry3, Matrix6, SMatrix, Vector2, Vector6};

use super::data::{PoseSights, Sight};
use super::lens::{self, LENS};
use super::robot::{self, Ties};
use super::se3;
use super::shape::TERMS;
use super::state::{
    Active, LEFT, LENSES, RIGHT, SECOND, SHAPE, SHARED, SharedMatrix, SharedVector, State, shape_prior,
};

/// Beyond this many sigma a corner pulls no harder (Huber).
pub(super) const HUBER_SIGMA: f64 = 2.5;

/// Unknowns of one camera at one pose: lens, second camera, shape, pose.
const LOCAL: usize = LENS + 6 + TERMS + 6;
const LOCAL_SECOND: usize = LENS;
const LOCAL_SHAPE: usize = LENS + 6;
const LOCAL_POSE: usize = LENS + 6 + TERMS;

/// Derivatives of one error by the unknowns of its camera and pose.
type Slopes = SMatrix<f64, 2, LOCAL>;
/// Normal equations of one camera at one pose; the upper triangle counts.
type LocalMatrix = SMatrix<f64, LOCAL, LOCAL>;
/// By the shared numbers and the pose.
pub(super) type Mixed = SMatrix<f64, SHARED, 6>;

/// What weighs the errors, apart from each corner's own covariance.
#[derive(Debug, Clone)]
pub(super) struct Weights {
    /// How much worse than their covariance says the corners of each camera are.
    pub(super) scale: [f64; 2],
    /// The loop of the robot; absent while it does not enter.
    pub(super) ties: Option<Ties>,
}

/// Normal equations of one pose.
#[derive(Debug, Clone)]
pub(super) struct PoseNormal {
    /// Among the shared numbers.
    pub(super) shared: SharedMatrix,
    /// What pulls at them.
    pub(super) pull: SharedVector,
    /// Between them and the pose.
    pub(super) mixed: Mixed,
    /// Among the pose's six.
    pub(super) pose: Matrix6<f64>,
    /// What pulls at them.
    pub(super) pose_pull: Vector6<f64>,
}

impl PoseNormal {
    pub(super) fn zeros() -> Self {
        Self {
            shared: SharedMatrix::zeros(),
            pull: SharedVector::zeros(),
            mixed: Mixed::zeros(),
            pose: Matrix6::zeros(),
            pose_pull: Vector6::zeros(),
        }
    }
}

/// The error of one corner over its sigma, not yet scaled; `None` where it lies behind the camera.
pub(super) fn error(state: &State, pose: &Isometry3<f64>, camera: usize, sight: &Sight) -> Option<Vector2<f64>> {
    let in_rig = pose.rotation * sight.on_shape(&state.shape_m) + pose.translation.vector;
    let in_camera = if camera == 0 {
        in_rig
    } else {
        state.second_from_first.rotation * in_rig + state.second_from_first.translation.vector
    };
    let px = lens::project(&state.lenses[camera], &in_camera)?;
    Some(sight.whiten(&(sight.px - px)))
}

/// The same in px.
pub(super) fn error_px(state: &State, pose: &Isometry3<f64>, camera: usize, sight: &Sight) -> Option<Vector2<f64>> {
    let in_rig = pose * nalgebra::Point3::from(sight.on_shape(&state.shape_m));
    let in_camera = if camera == 0 { in_rig } else { state.second_from_first * in_rig };
    lens::project(&state.lenses[camera], &in_camera.coords).map(|px| sight.px - px)
}

/// Huber's cost of a squared error.
pub(super) fn huber(squared: f64) -> f64 {
    let d = squared.sqrt();
    if d <= HUBER_SIGMA { squared } else { HUBER_SIGMA * (2.0 * d - HUBER_SIGMA) }
}

fn huber_weight(squared: f64) -> f64 {
    let d = squared.sqrt();
    if d <= HUBER_SIGMA { 1.0 } else { HUBER_SIGMA / d }
}

/// Cost of everything that was seen at one pose; infinite where a corner lies behind a camera.
pub(super) fn pose_cost(state: &State, at: usize, sights: &PoseSights, weights: &Weights) -> f64 {
    let pose = &state.poses[at];
    let mut cost = 0.0;
    for (camera, view) in sights.views.iter().enumerate() {
        let per_scale = 1.0 / (weights.scale[camera] * weights.scale[camera]);
        for sight in view.iter().filter(|s| s.used) {
            let squared = error(state, pose, camera, sight).map_or(f64::INFINITY, |e| e.norm_squared());
            cost += huber(squared * per_scale);
        }
    }
    cost + weights.ties.as_ref().map_or(0.0, |ties| robot::cost(state, at, sights, ties))
}

/// Cost of everything.
pub(super) fn cost(state: &State, sights: &[PoseSights], weights: &Weights, active: &Active) -> f64 {
    let seen: f64 = sights.iter().enumerate().map(|(at, s)| pose_cost(state, at, s, weights)).sum();
    let solved = |(i, _): &(usize, &f64)| active.0[SHAPE.start + i];
    let shape: f64 = state.shape_m.iter().enumerate().filter(solved).map(|(_, z)| z * z).sum();
    seen + shape * shape_prior()
}

/// Error over its sigma, and the derivatives of the position in px; `None` behind the camera.
fn slopes(
    state: &State,
    pose: &Isometry3<f64>,
    turn: &nalgebra::Matrix3<f64>,
    camera: usize,
    sight: &Sight,
) -> Option<(Vector2<f64>, Slopes)> {
    let in_rig = pose.rotation * sight.on_shape(&state.shape_m) + pose.translation.vector;
    let second = &state.second_from_first;
    let in_camera = if camera == 0 { in_rig } else { second.rotation * in_rig + second.translation.vector };
    let seen = lens::project_with_slopes(&state.lenses[camera], &in_camera)?;
    let mut all = Slopes::zeros();
    all.fixed_columns_mut::<LENS>(0).copy_from(&seen.by_lens);
    let by_rig = if camera == 0 {
        seen.by_point
    } else {
        all.fixed_columns_mut::<6>(LOCAL_SECOND).copy_from(&by_step(&seen.by_point, &in_camera));
        seen.by_point * second.rotation.to_rotation_matrix().matrix()
    };
    all.fixed_columns_mut::<6>(LOCAL_POSE).copy_from(&by_step(&by_rig, &in_rig));
    let by_height = by_rig * turn.column(2);
    for (k, basis) in sight.basis.iter().enumerate() {
        all.set_column(LOCAL_SHAPE + k, &(by_height * *basis));
    }
    Some((sight.whiten(&(sight.px - seen.px)), all))
}

/// `by_point` times the derivative of the point by a step: `[I, -[p]x]`.
fn by_step(by_point: &nalgebra::Matrix2x3<f64>, p: &nalgebra::Vector3<f64>) -> SMatrix<f64, 2, 6> {
    let turned = by_point * se3::hat(p) * -1.0;
    let mut all = SMatrix::<f64, 2, 6>::zeros();
    all.fixed_columns_mut::<3>(0).copy_from(by_point);
    all.fixed_columns_mut::<3>(3).copy_from(&turned);
    all
}

/// Unknowns of one camera at one pose that are solved: the active shared ones, and the pose.
struct Columns {
    list: [usize; LOCAL],
    count: usize,
}

impl Columns {
    fn of(camera: usize, active: &Active) -> Self {
        let (mut list, mut count) = ([0; LOCAL], 0);
        for i in (0..LOCAL).filter(|i| *i >= LOCAL_POSE || active.0[shared_index(camera, *i)]) {
            list[count] = i;
            count += 1;
        }
        Self { list, count }
    }

    fn all(&self) -> &[usize] {
        &self.list[..self.count]
    }
}

/// Normal equations of one camera at one pose.
struct Local {
    matrix: LocalMatrix,
    pull: SMatrix<f64, LOCAL, 1>,
    columns: Columns,
}

impl Local {
    fn of(state: &State, pose: &Isometry3<f64>, camera: usize, view: &[Sight], scale: f64, active: &Active) -> Self {
        let columns = Columns::of(camera, active);
        let mut local = Self { matrix: LocalMatrix::zeros(), pull: SMatrix::zeros(), columns };
        let turn = *pose.rotation.to_rotation_matrix().matrix();
        let per_scale = 1.0 / (scale * scale);
        for sight in view.iter().filter(|s| s.used) {
            let Some((error, slopes)) = slopes(state, pose, &turn, camera, sight) else { continue };
            local.add(sight, &slopes, &error, per_scale * huber_weight(error.norm_squared() * per_scale));
        }
        local
    }

    fn add(&mut self, sight: &Sight, slopes: &Slopes, error: &Vector2<f64>, weight: f64) {
        let (mut white, count) = ([[0.0; 2]; LOCAL], self.columns.count);
        for (to, column) in white.iter_mut().zip(self.columns.all()) {
            let one = sight.whiten(&Vector2::new(slopes[(0, *column)], slopes[(1, *column)]));
            *to = [one.x, one.y];
        }
        for (k, column) in self.columns.list[..count].iter().enumerate() {
            let [a, b] = white[k].map(|v| v * weight);
            self.pull[*column] += a * error.x + b * error.y;
            for (row, [x, y]) in self.columns.list[..=k].iter().zip(&white[..=k]) {
                self.matrix[(*row, *column)] += x * a + y * b;
            }
        }
    }

    fn at(&self, i: usize, j: usize) -> f64 {
        self.matrix[(i.min(j), i.max(j))]
    }
}

/// Where the unknowns of a camera stand in the shared vector; the pose's own are not there.
fn shared_index(camera: usize, local: usize) -> usize {
    match local {
        0..LOCAL_SECOND => LENSES[camera].start + local,
        LOCAL_SECOND..LOCAL_SHAPE => SECOND.start + local - LOCAL_SECOND,
        _ => SHAPE.start + local - LOCAL_SHAPE,
    }
}

/// Normal equations of one pose, written over `normal`.
pub(super) fn pose_normal(
    normal: &mut PoseNormal,
    state: &State,
    at: usize,
    sights: &PoseSights,
    weights: &Weights,
    active: &Active,
) {
    *normal = PoseNormal::zeros();
    for (camera, view) in sights.views.iter().enumerate().filter(|(_, v)| !v.is_empty()) {
        let local = Local::of(state, &state.poses[at], camera, view, weights.scale[camera], active);
        scatter(normal, &local, camera);
    }
    if let Some(ties) = &weights.ties {
        robot::add(normal, state, at, sights, ties, active);
    }
}

fn scatter(normal: &mut PoseNormal, local: &Local, camera: usize) {
    let pose = |k: usize| LOCAL_POSE + k;
    let shared = || local.columns.all().iter().copied().filter(|i| *i < LOCAL_POSE);
    for i in shared() {
        let to = shared_index(camera, i);
        normal.pull[to] += local.pull[i];
        for j in shared() {
            normal.shared[(to, shared_index(camera, j))] += local.at(i, j);
        }
        for k in 0..6 {
            normal.mixed[(to, k)] += local.at(i, pose(k));
        }
    }
    for k in 0..6 {
        normal.pose_pull[k] += local.pull[pose(k)];
        for l in 0..6 {
            normal.pose[(k, l)] += local.at(pose(k), pose(l));
        }
    }
}

/// Trace of covariance times normal equations, by camera: how many unknowns its corners pay for.
pub(super) fn unknowns_paid(
    state: &State,
    at: usize,
    sights: &PoseSights,
    weights: &Weights,
    active: &Active,
    joint: &JointCovariance<'_>,
) -> [f64; 2] {
    std::array::from_fn(|camera| {
        let view = &sights.views[camera];
        let local = Local::of(state, &state.poses[at], camera, view, weights.scale[camera], active);
        let mut sum = 0.0;
        for &i in local.columns.all() {
            for &j in local.columns.all() {
                sum += local.at(i, j) * joint.at(camera, i, j);
            }
        }
        sum
    })
}

/// Covariance of the shared numbers and one pose.
pub(super) struct JointCovariance<'a> {
    /// Of the shared numbers.
    pub(super) shared: &'a SharedMatrix,
    /// Between them and the pose.
    pub(super) mixed: Mixed,
    /// Of the pose.
    pub(super) pose: Matrix6<f64>,
}

impl<'a> JointCovariance<'a> {
    /// `None` where the pose hangs free.
    pub(super) fn of(shared: &'a SharedMatrix, normal: &PoseNormal) -> Option<Self> {
        let inverse = normal.pose.cholesky()?.inverse();
        let gain = normal.mixed * inverse;
        let mixed = -(shared * gain);
        let pose = inverse - gain.transpose() * mixed;
        Some(Self { shared, mixed, pose })
    }

    fn at(&self, camera: usize, i: usize, j: usize) -> f64 {
        match (i < LOCAL_POSE, j < LOCAL_POSE) {
            (true, true) => self.shared[(shared_index(camera, i), shared_index(camera, j))],
            (true, false) => self.mixed[(shared_index(camera, i), j - LOCAL_POSE)],
            (false, true) => self.mixed[(shared_index(camera, j), i - LOCAL_POSE)],
            (false, false) => self.pose[(i - LOCAL_POSE, j - LOCAL_POSE)],
        }
    }
}

/// One pose with its own unknowns eliminated.
#[derive(Debug, Clone)]
pub(super) struct Reduced {
    /// What is left among the shared numbers.
    pub(super) matrix: SharedMatrix,
    /// What pulls at them.
    pub(super) pull: SharedVector,
    gain: Mixed,
    pose_step: Vector6<f64>,
}

impl Reduced {
    /// Eliminates the pose, damped; `None` where it hangs free.
    pub(super) fn of(normal: &PoseNormal, damping: f64) -> Option<Self> {
        let mut pose = normal.pose;
        (0..6).for_each(|k| pose[(k, k)] *= 1.0 + damping);
        let inverse = pose.cholesky()?.inverse();
        let gain = normal.mixed * inverse;
        let mut matrix = normal.shared;
        matrix.gemm(-1.0, &gain, &normal.mixed.transpose(), 1.0);
        let pull = normal.pull - gain * normal.pose_pull;
        Some(Self { matrix, pull, gain, pose_step: inverse * normal.pose_pull })
    }

    /// The step of the pose that goes with a step of the shared numbers.
    pub(super) fn pose_step(&self, shared: &SharedVector) -> Vector6<f64> {
        self.pose_step - self.gain.transpose() * shared
    }
}

/// Solves or inverts the shared equations, of which only the active rows count.
pub(super) struct Factor {
    cholesky: nalgebra::Cholesky<f64, nalgebra::Const<SHARED>>,
    size: SharedVector,
}

impl Factor {
    /// `None` where the data do not determine every active number.
    pub(super) fn of(matrix: &SharedMatrix, active: &Active, damping: f64) -> Option<Self> {
        // Scaled to a unit diagonal: the numbers are pixels, metres and radians.
        let size = SharedVector::from_fn(|i, _| if active.0[i] { 1.0 / matrix[(i, i)].sqrt() } else { 1.0 });
        if !size.iter().all(|s| s.is_finite()) {
            return None;
        }
        let scaled = SharedMatrix::from_fn(|i, j| match (active.0[i] && active.0[j], i == j) {
            (true, true) => 1.0 + damping,
            (true, false) => matrix[(i, j)] * size[i] * size[j],
            (false, same) => f64::from(u8::from(same)),
        });
        let cholesky = scaled.cholesky()?;
        // A pivot this small is rounding: the number is not determined.
        let determined = (0..SHARED).all(|i| cholesky.l_dirty()[(i, i)] > 1e-7);
        determined.then_some(Self { cholesky, size })
    }

    pub(super) fn solve(&self, pull: &SharedVector, active: &Active) -> SharedVector {
        let masked = SharedVector::from_fn(|i, _| if active.0[i] { pull[i] * self.size[i] } else { 0.0 });
        self.cholesky.solve(&masked).component_mul(&self.size)
    }

    /// Covariance; rows of numbers that are not solved are 0.
    pub(super) fn covariance(&self, active: &Active) -> SharedMatrix {
        let inverse = self.cholesky.inverse();
        SharedMatrix::from_fn(|i, j| {
            if active.0[i] && active.0[j] { inverse[(i, j)] * self.size[i] * self.size[j] } else { 0.0 }
        })
    }
}

/// The shape's prior on top of the sum over the poses.
pub(super) fn add_prior(matrix: &mut SharedMatrix, pull: &mut SharedVector, state: &State, active: &Active) {
    for (k, i) in SHAPE.enumerate().filter(|(_, i)| active.0[*i]) {
        matrix[(i, i)] += shape_prior();
        pull[i] -= shape_prior() * state.shape_m[k];
    }
}

/// Where the ends of the loop stand in the shared vector.
pub(super) const LOOP: [usize; 2] = [LEFT.start, RIGHT.start];
