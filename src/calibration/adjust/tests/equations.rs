//! The equations against small differences, and the one-step jackknife against true solves.

use nalgebra::Vector6;

use super::scene::Scene;
use crate::calibration::adjust::fit::Fit;
use crate::calibration::adjust::leave_one_out;
use crate::calibration::adjust::lens::Distortion;
use crate::calibration::adjust::normal::{PoseNormal, Weights, cost, pose_normal};
use crate::calibration::adjust::robot::Ties;
use crate::calibration::adjust::select;
use crate::calibration::adjust::shape::Shape;
use crate::calibration::adjust::start;
use crate::calibration::adjust::state::{Active, LEFT, LENSES, Loop, RIGHT, SECOND, SHARED, SharedVector, moved};
use crate::calibration::settings::Carried;

/// A fit of everything, at a start that is off.
fn fit(scene: &Scene, seed: u64) -> Fit {
    let (problem, _) = scene.problem(seed);
    let start = start::rigs(&problem, &scene.start(&problem)).remove(0);
    let mut active = Active::nothing();
    [SECOND, LEFT, RIGHT].into_iter().for_each(|range| active.set(range, true));
    let kind = if scene.carried == Carried::Target { Loop::Target } else { Loop::Cameras };
    // A wide noise of the arm, so that every term weighs about the same.
    let ties = Some(Ties { kind, sigma_m: 0.5e-3, sigma_rad: 1e-3 });
    let mut fit = Fit { state: start.state, sights: start.sights, weights: Weights { scale: [20.0; 2], ties }, active };
    (0..2).for_each(|camera| select::set_distortion(&mut fit, camera, Distortion::All));
    select::set_shape(&mut fit, Shape::Cubic);
    fit.sights.iter_mut().for_each(|s| s.tied = s.base_from_tcp.is_some());
    [fit.state.left, fit.state.right] = scene.ends;
    fit
}

#[test]
fn the_pull_is_the_slope_of_the_cost() {
    for carried in [Carried::Target, Carried::Cameras] {
        let scene = Scene { carried, poses: [3, 3], ..Scene::paper() };
        let mut fit = fit(&scene, 11);
        fit.state.shape_m = [30e-6, -20e-6, 10e-6, 5e-6, -5e-6, 8e-6, -8e-6];
        fit.state.left = moved(&fit.state.left, &Vector6::new(2e-4, -3e-4, 1e-4, 5e-4, 2e-4, -4e-4));
        let mut total = SharedVector::zeros();
        let mut pose_pulls = Vec::new();
        for (at, sights) in fit.sights.iter().enumerate() {
            let mut normal = PoseNormal::zeros();
            pose_normal(&mut normal, &fit.state, at, sights, &fit.weights, &fit.active);
            total += normal.pull;
            pose_pulls.push(normal.pose_pull);
        }
        let without_prior = Active::nothing();
        let cost_of = |state: &_| cost(state, &fit.sights, &fit.weights, &without_prior);
        let check = |slope: f64, pull: f64, size: f64, what: String| {
            // The cost is a sum of squares: its slope is -2 times the pull.
            assert!((slope + 2.0 * pull).abs() < 2e-4 * (pull.abs() + size), "{what}: {slope} {pull}");
        };
        for i in 0..SHARED {
            let pixels = LENSES.iter().any(|l| (l.start..l.start + 4).contains(&i));
            let step = if pixels { 1e-3 } else { 1e-7 };
            let ends = [1.0, -1.0].map(|sign| {
                let mut state = fit.state.clone();
                state.step_shared(&(SharedVector::ith(i, sign * step)));
                cost_of(&state)
            });
            check((ends[0] - ends[1]) / (2.0 * step), total[i], 1e-6 / step, format!("{carried:?} {i}"));
        }
        for (at, k) in (0..6).flat_map(|at| (0..6).map(move |k| (at, k))) {
            let step = 1e-8;
            let ends = [1.0, -1.0].map(|sign| {
                let mut state = fit.state.clone();
                state.poses[at] = moved(&state.poses[at], &Vector6::ith(k, sign * step));
                cost_of(&state)
            });
            let slope = (ends[0] - ends[1]) / (2.0 * step);
            check(slope, pose_pulls[at][k], 1e-6 / step, format!("{carried:?} pose {at} {k}"));
        }
    }
}

#[test]
fn one_step_without_a_pose_is_nearly_a_true_solve() {
    let scene = Scene { poses: [14, 10], ..Scene::paper() };
    let mut fit = fit(&scene, 12);
    fit.weights.scale = [1.0; 2];
    fit.weights.ties = fit.weights.ties.map(|t| Ties { sigma_m: 0.05e-3, sigma_rad: 0.1e-3, ..t });
    (0..2).for_each(|camera| select::set_distortion(&mut fit, camera, Distortion::K1));
    select::set_shape(&mut fit, Shape::Flat);
    fit.go().unwrap();
    let arrived = fit.arrived().unwrap();
    let steps = leave_one_out::steps(&arrived, &fit.active);
    for at in [0, 7, 16, 23] {
        let mut other = fit.clone();
        other.sights.remove(at);
        other.state.poses.remove(at);
        other.go().unwrap();
        let one_step = leave_one_out::state_without(&fit, &steps[at].unwrap());
        let true_change = other.state.lenses[0][0] - fit.state.lenses[0][0];
        for (camera, lens) in LENSES.iter().enumerate() {
            for k in 0..4 {
                let i = lens.start + k;
                let sigma = arrived.covariance[(i, i)].sqrt();
                let off = one_step.lenses[camera][k] - other.state.lenses[camera][k];
                assert!(
                    off.abs() < 0.1 * sigma,
                    "pose {at}, camera {camera}, {k}: {off}, sigma {sigma}, {true_change}"
                );
            }
        }
        let sigma = (0..3).map(|k| arrived.covariance[(LEFT.start + k, LEFT.start + k)].sqrt()).fold(0.0, f64::max);
        let off = (one_step.left.translation.vector - other.state.left.translation.vector).norm();
        assert!(off < 0.15 * sigma, "pose {at}: {off}, sigma {sigma}");
    }
}
