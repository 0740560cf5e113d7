//! The minimum: Levenberg and Marquardt at fixed weights, then the weights again from what is left.

use nalgebra::Vector6;

use super::data::PoseSights;
use super::normal::{self, Factor, HUBER_SIGMA, JointCovariance, PoseNormal, Reduced, Weights, add_prior, pose_normal};
use super::robot;
use super::state::{Active, SharedMatrix, SharedVector, State, moved};

const MAX_STEPS: usize = 60;
/// The last step was this small against the uncertainty: squared, in sigma.
const ARRIVED: f64 = 1e-8;
/// Corners cannot be better than this times what their detector says.
const SCALE_FLOOR: f64 = 1e-4;
/// Median of the squared length of two normal numbers.
const MEDIAN_OF_TWO: f64 = 1.386_294_361_119_890_6;
/// Times that the weights are found again.
const REWEIGHTED: usize = 40;
/// The noise of the arm is stretched by at most this: where the cameras are noisier, plain steps creep.
const STRETCH: f64 = 10.0;

/// A problem under way: what was seen, the unknowns, their weights.
#[derive(Debug, Clone)]
pub(super) struct Fit {
    pub(super) state: State,
    pub(super) sights: Vec<PoseSights>,
    pub(super) weights: Weights,
    pub(super) active: Active,
}

/// The normal equations where a fit has arrived.
#[derive(Debug, Clone)]
pub(super) struct Arrived {
    /// By pose, without damping.
    pub(super) normals: Vec<PoseNormal>,
    /// The same with the poses eliminated.
    pub(super) reduced: Vec<Reduced>,
    /// Their sum and the prior.
    pub(super) matrix: SharedMatrix,
    /// What still pulls.
    pub(super) pull: SharedVector,
    /// Covariance of the shared numbers.
    pub(super) covariance: SharedMatrix,
}

/// Finds where a number no longer pulls; where the cameras are noisier than the arm, plain steps creep.
#[derive(Debug, Clone, Copy, Default)]
struct Secant {
    before: Option<(f64, f64)>,
}

impl Secant {
    /// The step from `at`, where the number is pulled by `pull`.
    fn next(&mut self, at: f64, pull: f64) -> f64 {
        let slope = self.before.map_or(-1.0, |(then, pulled)| (pull - pulled) / (at - then));
        self.before = Some((at, pull));
        let sensible = (-1.5..0.0).contains(&slope);
        let step = if sensible { pull / (-slope).max(1.0 / STRETCH) } else { pull };
        step.clamp(-1.5, 1.5)
    }
}

/// A step of everything.
struct Step {
    shared: SharedVector,
    poses: Vec<Vector6<f64>>,
    /// How far it leads, in squared sigma.
    length: f64,
}

impl Fit {
    fn cost(&self, state: &State) -> f64 {
        normal::cost(state, &self.sights, &self.weights, &self.active)
    }

    fn normals(&self, normals: &mut Vec<PoseNormal>) {
        normals.resize_with(self.sights.len(), PoseNormal::zeros);
        for (at, (normal, sights)) in normals.iter_mut().zip(&self.sights).enumerate() {
            pose_normal(normal, &self.state, at, sights, &self.weights, &self.active);
        }
    }

    fn reduce(&self, normals: &[PoseNormal], damping: f64) -> Result<Vec<Reduced>, String> {
        let free = |s: &PoseSights| format!("pose {}: its corners do not determine the board's pose", s.id);
        normals.iter().zip(&self.sights).map(|(n, s)| Reduced::of(n, damping).ok_or_else(|| free(s))).collect()
    }

    fn sum(&self, reduced: &[Reduced]) -> (SharedMatrix, SharedVector) {
        let (mut matrix, mut pull) = (SharedMatrix::zeros(), SharedVector::zeros());
        for one in reduced {
            matrix += one.matrix;
            pull += one.pull;
        }
        add_prior(&mut matrix, &mut pull, &self.state, &self.active);
        (matrix, pull)
    }

    fn step(&self, normals: &[PoseNormal], damping: f64) -> Result<Option<Step>, String> {
        let reduced = self.reduce(normals, damping)?;
        let (matrix, pull) = self.sum(&reduced);
        let Some(factor) = Factor::of(&matrix, &self.active, damping) else { return Ok(None) };
        let shared = factor.solve(&pull, &self.active);
        let poses: Vec<_> = reduced.iter().map(|r| r.pose_step(&shared)).collect();
        let by_poses: f64 = poses.iter().zip(normals).map(|(step, n)| step.dot(&n.pose_pull)).sum();
        let by_shared: f64 = normals.iter().map(|n| n.pull.dot(&shared)).sum();
        Ok(Some(Step { shared, poses, length: by_poses + by_shared }))
    }

    fn after(&self, step: &Step) -> State {
        let mut state = self.state.clone();
        state.step_shared(&step.shared);
        for (pose, by) in state.poses.iter_mut().zip(&step.poses) {
            *pose = moved(pose, by);
        }
        state
    }

    /// Goes to the minimum at these weights.
    pub(super) fn go(&mut self) -> Result<(), String> {
        let mut damping = 1e-4;
        let mut cost = self.cost(&self.state);
        let mut normals = Vec::new();
        for _ in 0..MAX_STEPS {
            self.normals(&mut normals);
            loop {
                let step = self.step(&normals, damping)?;
                let next = step.as_ref().map(|s| self.after(s));
                let next_cost = next.as_ref().map_or(f64::INFINITY, |n| self.cost(n));
                let better = next_cost <= cost * (1.0 + 1e-13);
                if let (true, Some(next), Some(step)) = (better, next, step) {
                    (self.state, cost) = (next, next_cost);
                    let arrived = step.length.abs() < ARRIVED && damping < 1e-2;
                    damping = (damping * 0.1).max(1e-12);
                    if arrived {
                        return Ok(());
                    }
                    break;
                }
                damping = (damping * 10.0).max(1e-6);
                if damping > 1e10 {
                    return self.stuck(cost);
                }
            }
        }
        Ok(())
    }

    /// No step is better: either this is the minimum, to rounding, or the problem has none.
    fn stuck(&self, cost: f64) -> Result<(), String> {
        if cost.is_finite() { Ok(()) } else { Err("a corner lies behind its camera".into()) }
    }

    /// The normal equations here; the error says that the data do not determine the unknowns.
    pub(super) fn arrived(&self) -> Result<Arrived, String> {
        let mut normals = Vec::new();
        self.normals(&mut normals);
        let reduced = self.reduce(&normals, 0.0)?;
        let (matrix, pull) = self.sum(&reduced);
        let factor = Factor::of(&matrix, &self.active, 0.0)
            .ok_or("the views do not determine the cameras: more tilted and more distant views are needed")?;
        let covariance = factor.covariance(&self.active);
        Ok(Arrived { normals, reduced, matrix, pull, covariance })
    }

    /// Errors of the corners of one camera over their sigma, squared, not scaled.
    fn squared_errors(&self, camera: usize) -> Vec<f64> {
        let mut all = Vec::new();
        for (at, sights) in self.sights.iter().enumerate() {
            let used = sights.views[camera].iter().filter(|s| s.used);
            all.extend(used.filter_map(|s| {
                normal::error(&self.state, &self.state.poses[at], camera, s).map(|e| e.norm_squared())
            }));
        }
        all
    }

    /// Scales from the median: right even where a third of the corners is wrong.
    pub(super) fn rough_scales(&mut self) {
        for camera in 0..2 {
            let mut squared = self.squared_errors(camera);
            squared.sort_by(f64::total_cmp);
            if let Some(median) = squared.get(squared.len() / 2) {
                self.weights.scale[camera] = (median / MEDIAN_OF_TWO).sqrt().max(SCALE_FLOOR);
            }
        }
    }

    /// Scales and the robot's noise from what is left over the unknowns; whether they are as before.
    fn reweight(&mut self, with_scale: bool, last: &mut [Secant; 2]) -> Result<bool, String> {
        let arrived = self.arrived()?;
        let (mut paid, mut robot_paid) = ([0.0; 2], [0.0; 2]);
        for (at, (normal, sights)) in arrived.normals.iter().zip(&self.sights).enumerate() {
            let free = || format!("pose {}: its corners do not determine the board's pose", sights.id);
            let joint = JointCovariance::of(&arrived.covariance, normal).ok_or_else(free)?;
            let here = normal::unknowns_paid(&self.state, at, sights, &self.weights, &self.active, &joint);
            (0..2).for_each(|k| paid[k] += here[k]);
            if let Some(ties) = &self.weights.ties {
                let here = robot::unknowns_paid(&self.state, at, sights, ties, &joint);
                (0..2).for_each(|k| robot_paid[k] += here[k]);
            }
        }
        let mut same = true;
        for camera in (0..2).filter(|_| with_scale) {
            same &= self.rescale(camera, paid[camera]);
        }
        Ok(same & self.reweight_robot(robot_paid, last))
    }

    /// Huber's second proposal: the scale at which clipped errors have the variance that they should.
    fn rescale(&mut self, camera: usize, paid: f64) -> bool {
        let squared = self.squared_errors(camera);
        let left = 2.0 * squared.len() as f64 - paid;
        let old = self.weights.scale[camera];
        let counts = left >= 8.0;
        if !counts {
            return true;
        }
        let clipped = 1.0 - (-HUBER_SIGMA * HUBER_SIGMA / 2.0).exp();
        let mut scale = old;
        for _ in 0..20 {
            let limit = HUBER_SIGMA * HUBER_SIGMA * scale * scale;
            let sum: f64 = squared.iter().map(|d| d.min(limit)).sum();
            scale = (sum / (clipped * left)).sqrt().max(SCALE_FLOOR);
        }
        self.weights.scale[camera] = scale;
        (scale / old - 1.0).abs() < 2e-3
    }

    fn reweight_robot(&mut self, paid: [f64; 2], last: &mut [Secant; 2]) -> bool {
        let Some(ties) = self.weights.ties else { return true };
        let errors: Vec<_> = self.robot_errors().into_iter().filter(|(tied, _)| *tied).map(|(_, e)| e).collect();
        let mut sigma = |k: usize, floor: f64, old: f64| {
            let sum: f64 = errors.iter().map(|e| robot::lengths(e)[k].powi(2)).sum();
            let left = 3.0 * errors.len() as f64 - paid[k];
            let plain = if left > 1e-3 { (sum / left).sqrt() } else { old };
            let (at, pull) = (old.ln(), (plain / old).ln());
            (pull, (at + last[k].next(at, pull)).exp().max(floor))
        };
        let (pull_m, sigma_m) = sigma(0, robot::FLOOR_M, ties.sigma_m);
        let (pull_rad, sigma_rad) = sigma(1, robot::FLOOR_RAD, ties.sigma_rad);
        self.weights.ties = Some(robot::Ties { sigma_m, sigma_rad, ..ties });
        let at_floor = |pull: f64, old: f64, floor: f64| pull < 0.0 && old <= floor;
        (pull_m.abs() < 1e-3 || at_floor(pull_m, ties.sigma_m, robot::FLOOR_M))
            && (pull_rad.abs() < 1e-3 || at_floor(pull_rad, ties.sigma_rad, robot::FLOOR_RAD))
    }

    /// Errors of the robot's poses, and whether each enters; poses without one are left out.
    pub(super) fn robot_errors(&self) -> Vec<(bool, Vector6<f64>)> {
        let Some(ties) = &self.weights.ties else { return Vec::new() };
        let of = |(at, s): (usize, &PoseSights)| Some((s.tied, robot::error(&self.state, at, s, ties.kind)?));
        self.sights.iter().enumerate().filter_map(of).collect()
    }

    /// Goes to the minimum, with weights that fit what is left there; scales of corners only where said.
    pub(super) fn go_and_reweight(&mut self, with_scale: bool) -> Result<Arrived, String> {
        self.go()?;
        let mut last = [Secant::default(); 2];
        for _ in 0..REWEIGHTED {
            let same = self.reweight(with_scale, &mut last)?;
            self.go()?;
            if same {
                break;
            }
        }
        self.arrived()
    }
}
