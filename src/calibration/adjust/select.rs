//! Which terms of distortion and shape the data support.
//!
//! A pose is left out, its board pose is found again from every second corner, and the other corners are predicted;
//! then the other way round. Among nested models the simplest one counts that predicts as well as the best, within
//! one standard error of the difference between both over the poses.

use serde::{Deserialize, Serialize};

use super::data::{PoseSights, Sight};
use super::fit::Fit;
use super::lens::Distortion;
use super::shape::Shape;
use super::state::State;
use super::{leave_one_out, normal, pose};

/// A squared error counts as at most this many sigma squared, so that no single corner decides.
const SCORE_CAP: f64 = 25.0;
/// Fewest corners that a board pose is found from.
const MIN_HALF: usize = 5;

/// How well one model predicts corners that were left out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelScore {
    /// Its terms.
    pub model: String,
    /// Mean squared error of predicted corners over their variance; 1 and a little where the model is right.
    pub held_out: f64,
    /// How much worse than the best, and the standard error of that.
    pub worse_by: [f64; 2],
}

/// A model and what speaks for it.
pub(super) struct Choice<M> {
    pub(super) model: M,
    pub(super) scores: Vec<ModelScore>,
}

/// Predicts every pose from the others; the score of each pose, `None` where it cannot be predicted.
fn scores(fit: &mut Fit) -> Option<Vec<Option<f64>>> {
    fit.go().ok()?;
    let arrived = fit.arrived().ok()?;
    let steps = leave_one_out::steps(&arrived, &fit.active);
    let score = |(at, (step, sights)): (usize, (&Option<_>, &PoseSights))| {
        let state = leave_one_out::state_without(fit, step.as_ref()?);
        predicted(fit, &pose::alone(&state, state.poses[at]), sights)
    };
    Some(steps.iter().zip(&fit.sights).enumerate().map(score).collect())
}

/// Mean squared error of each half of the corners, predicted from the other; `None` for too few.
fn predicted(fit: &Fit, state: &State, sights: &PoseSights) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0);
    for half in 0..2 {
        let is_fitted = |s: &Sight| s.half == half;
        let fitted = sights.views.iter().flatten().filter(|s| s.used && is_fitted(s)).count();
        if fitted < MIN_HALF {
            return None;
        }
        let mut state = state.clone();
        let found = pose::fit(&mut state, sights, &fit.weights, &is_fitted)?;
        for (camera, view) in sights.views.iter().enumerate() {
            for sight in view.iter().filter(|s| s.used && !is_fitted(s)) {
                let error = normal::error(&state, &found, camera, sight)? / fit.weights.scale[camera];
                sum += error.norm_squared().min(SCORE_CAP);
                count += 2;
            }
        }
    }
    (count > 0).then(|| sum / f64::from(count))
}

/// The simplest of nested models that is within one standard error of the best.
///
/// `models` has each model with the scores of the poses; models that could not be solved are absent.
fn simplest<M: Copy>(models: &[(M, &'static str, Vec<Option<f64>>)]) -> Option<Choice<M>> {
    let known = |at: usize| models.iter().all(|(_, _, s)| s[at].is_some());
    let poses: Vec<usize> = (0..models.first()?.2.len()).filter(|at| known(*at)).collect();
    let of = |scores: &[Option<f64>]| -> Vec<f64> { poses.iter().filter_map(|at| scores[*at]).collect() };
    let all: Vec<Vec<f64>> = models.iter().map(|(_, _, s)| of(s)).collect();
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let best = (0..all.len()).min_by(|a, b| mean(&all[*a]).total_cmp(&mean(&all[*b])))?;
    let worse_by = |scores: &[f64]| {
        let off: Vec<f64> = scores.iter().zip(&all[best]).map(|(s, b)| s - b).collect();
        let (n, middle) = (off.len() as f64, mean(&off));
        let variance = off.iter().map(|d| (d - middle).powi(2)).sum::<f64>() / (n - 1.0);
        [middle, (variance / n).sqrt()]
    };
    let worse: Vec<[f64; 2]> = all.iter().map(|s| worse_by(s)).collect();
    let enough = poses.len() > 2;
    let chosen = if enough { worse.iter().position(|[by, error]| by <= error)? } else { 0 };
    let score = |(i, (_, name, _)): (usize, &(M, &'static str, _))| ModelScore {
        model: (*name).into(),
        held_out: mean(&all[i]),
        worse_by: worse[i],
    };
    let scores = if enough { models.iter().enumerate().map(score).collect() } else { Vec::new() };
    Some(Choice { model: models[chosen].0, scores })
}

/// Chooses the distortion of a camera; `fit` ends at the choice.
pub(super) fn distortion(fit: &mut Fit, camera: usize) -> Option<Choice<Distortion>> {
    let mut models = Vec::new();
    let mut trial = fit.clone();
    for model in Distortion::NESTED {
        set_distortion(&mut trial, camera, model);
        if let Some(scores) = scores(&mut trial) {
            models.push((model, model.name(), scores));
        }
    }
    let choice = simplest(&models)?;
    set_distortion(fit, camera, choice.model);
    fit.go().ok()?;
    Some(choice)
}

/// Chooses the shape of the board; `fit` ends at the choice.
pub(super) fn shape(fit: &mut Fit) -> Option<Choice<Shape>> {
    let mut models = Vec::new();
    let mut trial = fit.clone();
    for model in Shape::NESTED {
        set_shape(&mut trial, model);
        if let Some(scores) = scores(&mut trial) {
            models.push((model, model.name(), scores));
        }
    }
    let choice = simplest(&models)?;
    set_shape(fit, choice.model);
    fit.go().ok()?;
    Some(choice)
}

/// Solves these terms; the others are 0.
pub(super) fn set_distortion(fit: &mut Fit, camera: usize, model: Distortion) {
    fit.active.set_lens(camera, model);
    fit.state.lenses[camera][4 + model.terms()..].fill(0.0);
}

pub(super) fn set_shape(fit: &mut Fit, model: Shape) {
    fit.active.set_shape(model);
    fit.state.shape_m[model.terms()..].fill(0.0);
}
