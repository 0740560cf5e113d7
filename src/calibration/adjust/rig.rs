//! A rig that was solved, and what it says about cameras, pair, shape and board poses.

use std::collections::BTreeMap;

use nalgebra::Isometry3;

use super::fit::{Arrived, Fit};
use super::lens::{self, Distortion};
use super::normal::{self, Weights};
use super::outcome::{AdjustedLens, DisplayShape, LensSigma, Parameters, PlaceSigma, Sigmas, Uncertain};
use super::select::{self, Choice, ModelScore};
use super::shape::{Basis, Shape};
use super::start::Start;
use super::state::{Active, LENSES, Loop, SECOND, SHAPE, SharedMatrix, SharedVector};
use super::{gate, leave_one_out, pose};
use crate::board::Board;
use crate::calibration::cameras::{self, SolvedCamera, SolvedStereo, ViewFit};
use crate::calibration::hand_eye::Pair;
use crate::calibration::problem::Problem;
use crate::geometry::{Camera, Pinhole, Point, Target, Transform};

/// Cameras that were solved together.
#[derive(Debug)]
pub(super) struct Rig {
    pub(super) cameras: Vec<Camera>,
    pinholes: Vec<Pinhole>,
    pub(super) fit: Fit,
    pub(super) arrived: Arrived,
    /// What each shared number would change without each pose, in the order of `fit.sights`.
    pub(super) steps: Vec<Option<SharedVector>>,
    /// Distortion and the evidence; absent for a camera that was taken over.
    distortion: Vec<Option<(Distortion, Vec<ModelScore>)>>,
    shape: (Shape, Vec<ModelScore>),
    /// Views of which nothing is used, by pose and place of the camera.
    whole: BTreeMap<(usize, usize), String>,
}

impl Rig {
    /// Solves the cameras of a rig, without the robot.
    pub(super) fn solve(problem: &Problem, start: Start) -> Result<Self, String> {
        let Start { cameras, pinholes, sights, state } = start;
        let known = |c: &Camera| problem.known.as_ref().is_some_and(|k| k.cameras.contains_key(c));
        let solved: Vec<usize> = (0..cameras.len()).filter(|i| !known(&cameras[*i])).collect();
        let stereo_known = problem.known.as_ref().is_some_and(|k| k.event_from_rgb.is_some());
        let mut active = Active::nothing();
        active.set(SECOND, cameras.len() == 2 && !stereo_known);
        let mut fit = Fit { state, sights, weights: Weights { scale: [1.0; 2], ties: None }, active };
        for camera in &solved {
            select::set_distortion(&mut fit, *camera, Distortion::K1K2P1P2);
        }
        select::set_shape(&mut fit, Shape::Quadratic);
        let mut whole = BTreeMap::new();
        gate::settle(&mut fit, &mut |index, camera, why| drop(whole.insert((index, camera), why)))?;
        let (distortion, shape) = choose(&mut fit, &solved, cameras.len())?;
        gate::settle(&mut fit, &mut |index, camera, why| drop(whole.insert((index, camera), why)))?;
        let arrived = fit.arrived()?;
        let steps = leave_one_out::steps(&arrived, &fit.active);
        Ok(Self { cameras, pinholes, fit, arrived, steps, distortion, shape: (shape.model, shape.scores), whole })
    }

    /// Which camera of the rig this is.
    pub(super) fn place(&self, camera: Camera) -> Option<usize> {
        self.cameras.iter().position(|c| *c == camera)
    }

    /// Covariance of the shared numbers by the weights, and by leaving poses out.
    pub(super) fn covariances(&self) -> (SharedMatrix, Option<SharedMatrix>) {
        (self.arrived.covariance, leave_one_out::covariance(&self.steps))
    }

    /// The larger standard deviation of each number, with both.
    pub(super) fn uncertain<S: Sigmas>(&self, of: impl Fn(&SharedMatrix) -> S) -> Uncertain<S> {
        let (formal, jackknife) = self.covariances();
        Uncertain::of(of(&formal), jackknife.as_ref().map(of))
    }

    pub(super) fn solved_camera(&self, camera: Camera, before: &SolvedCamera) -> SolvedCamera {
        let Some(place) = self.place(camera) else { return before.clone() };
        let mut views = before.views.clone();
        for fit in views.values_mut().filter(|f| f.rejected.is_none()) {
            fit.rejected = Some("no board pose".into());
        }
        let (mut sum, mut points) = (0.0, 0);
        for (at, sights) in self.fit.sights.iter().enumerate().filter(|(_, s)| !s.views[place].is_empty()) {
            let errors = self.squared_px2(at, place);
            sum += errors.iter().sum::<f64>();
            points += errors.len();
            let rms_px = (errors.iter().sum::<f64>() / errors.len() as f64).sqrt();
            views.insert(sights.index, ViewFit { rms_px: Some(rms_px), rejected: None, note: self.note(at, place) });
        }
        for ((index, _), why) in self.whole.iter().filter(|((_, c), _)| *c == place) {
            let rms_px = before.views.get(index).and_then(|v| v.rms_px);
            views.insert(*index, ViewFit { rms_px, rejected: Some(why.clone()), note: None });
        }
        if points == 0 {
            return before.clone();
        }
        let pinhole = lens::to_pinhole(&self.fit.state.lenses[place], &self.pinholes[place]);
        SolvedCamera { pinhole, rms_px: (sum / points as f64).sqrt(), points, views }
    }

    fn squared_px2(&self, at: usize, place: usize) -> Vec<f64> {
        let Fit { state, sights, .. } = &self.fit;
        let used = sights[at].views[place].iter().filter(|s| s.used);
        used.filter_map(|s| normal::error_px(state, &state.poses[at], place, s).map(|e| e.norm_squared())).collect()
    }

    /// The corners of a view that were left out, in words.
    fn note(&self, at: usize, place: usize) -> Option<String> {
        let out = gate::left_out(&self.fit, at, place);
        let each = out.iter().map(|(id, px, limit)| format!("{id} ({px:.2} px off, limit {limit:.2} px)"));
        (!out.is_empty()).then(|| format!("corners left out: {}", each.collect::<Vec<_>>().join(", ")))
    }

    pub(super) fn lens(&self, camera: Camera) -> Option<AdjustedLens> {
        let place = self.place(camera)?;
        let (model, scores) = self.distortion[place].as_ref()?;
        let corners = || self.fit.sights.iter().flat_map(|s| &s.views[place]);
        Some(AdjustedLens {
            distortion_model: model.name().into(),
            chosen_by: chosen_by(scores),
            models: scores.clone(),
            sigma: self.uncertain(|c| LensSigma::of(c, &LENSES[place])),
            corner_noise_factor: self.fit.weights.scale[place],
            corners_used: corners().filter(|s| s.used).count(),
            corners_left_out: corners().filter(|s| !s.used).count(),
        })
    }

    pub(super) fn stereo(&self, problem: &Problem) -> Option<(SolvedStereo, Uncertain<PlaceSigma>)> {
        let both = self.cameras.len() == 2;
        let shared: Vec<usize> = self
            .fit
            .sights
            .iter()
            .enumerate()
            .filter(|(_, s)| s.views.iter().all(|v| !v.is_empty()))
            .map(|(at, _)| at)
            .collect();
        let errors: Vec<f64> =
            shared.iter().flat_map(|at| (0..2).flat_map(|place| self.squared_px2(*at, place))).collect();
        let rms_px = (errors.iter().sum::<f64>() / errors.len() as f64).sqrt();
        let (corner_rate, pairs) = cameras::pair_corner_rate(problem)?;
        let stereo = SolvedStereo {
            event_from_rgb: Transform::assume_frames(self.fit.state.second_from_first),
            rms_px,
            pairs_used: shared.len(),
            pairs_rejected: pairs.saturating_sub(shared.len()),
            corner_rate,
        };
        let sigma = self.uncertain(|c| {
            let step = c.fixed_view::<6, 6>(SECOND.start, SECOND.start).into_owned();
            PlaceSigma::of_step(&step, &self.fit.state.second_from_first.translation.vector)
        });
        (both && rms_px.is_finite()).then_some((stereo, sigma))
    }

    pub(super) fn display_shape(&self) -> DisplayShape {
        let (model, scores) = &self.shape;
        let sigma = |c: &SharedMatrix| SHAPE.take(model.terms()).map(|i| c[(i, i)].sqrt()).collect::<Vec<_>>();
        let terms_m = &self.fit.state.shape_m;
        DisplayShape {
            model: model.name().into(),
            terms: ["X2", "Y2", "XY", "X3", "X2Y", "XY2", "Y3"][..model.terms()].iter().map(|t| (*t).into()).collect(),
            terms_m: terms_m[..model.terms()].to_vec(),
            sigma_m: self.uncertain(sigma),
            meaning: "height along z of target over its best plane; X, Y from -1 to 1 over the inner corners".into(),
            chosen_by: chosen_by(scores),
            models: scores.clone(),
        }
    }

    pub(super) fn parameters(&self) -> Parameters {
        Parameters::of(self)
    }

    /// The board before the rig at every pose, from corners alone.
    pub(super) fn board_poses(&self) -> BTreeMap<usize, Isometry3<f64>> {
        let Fit { state, sights, weights, .. } = &self.fit;
        let from_corners = |(at, s): (usize, &super::data::PoseSights)| {
            let mut alone = pose::alone(state, state.poses[at]);
            pose::fit(&mut alone, s, weights, &|_| true).map(|found| (s.index, found))
        };
        sights.iter().enumerate().filter_map(from_corners).collect()
    }

    /// A camera of the rig before its first.
    pub(super) fn camera_from_rig(&self, place: usize) -> Isometry3<f64> {
        if place == 0 { Isometry3::identity() } else { self.fit.state.second_from_first }
    }

    /// Names of both ends of the robot's loop.
    pub(super) fn ends(&self) -> [String; 2] {
        let rig = self.cameras[0];
        match self.fit.weights.ties.map(|t| t.kind) {
            Some(Loop::Cameras) => ["base_from_target".into(), format!("tcp_from_{rig}")],
            Some(Loop::Target) | None => [format!("base_from_{rig}"), "tcp_from_target".into()],
        }
    }

    pub(super) fn pairs(&self, problem: &Problem, camera: Camera) -> BTreeMap<usize, Pair> {
        let camera_from_rig = self.camera_from_rig(self.place(camera).unwrap_or(0));
        let pair = |(index, rig_from_target): (usize, Isometry3<f64>)| {
            let base_from_tcp = problem.poses[index].base_from_tcp?;
            let camera_from_target = Transform::assume_frames(camera_from_rig * rig_from_target);
            Some((index, Pair { base_from_tcp, camera_from_target }))
        };
        self.board_poses().into_iter().filter_map(pair).collect()
    }

    pub(super) fn corner(&self, board: &Board, id: u32) -> Option<Point<Target>> {
        let [x, y, z] = board.corner(id)?.xyz_m();
        Some(Point::assume_frame([x, y, z + Basis::of(board).height_m(&self.fit.state.shape_m, id)]))
    }
}

type Chosen = (Vec<Option<(Distortion, Vec<ModelScore>)>>, Choice<Shape>);

/// Chooses the terms of each lens, then of the shape.
fn choose(fit: &mut Fit, solved: &[usize], cameras: usize) -> Result<Chosen, String> {
    let none = "no model of the lens can be solved from these views";
    let mut distortion: Vec<_> = (0..cameras).map(|_| None).collect();
    for camera in solved {
        let Choice { model, scores } = select::distortion(fit, *camera).ok_or(none)?;
        distortion[*camera] = Some((model, scores));
    }
    let shape = select::shape(fit).ok_or("the board's pose cannot be found from these views")?;
    Ok((distortion, shape))
}

fn chosen_by(scores: &[ModelScore]) -> String {
    if scores.is_empty() {
        return "too few views to compare models".into();
    }
    "the simplest that predicts left-out corners as well as the best, within one standard error".into()
}
