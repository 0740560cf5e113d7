//! One least-squares problem over everything that was seen: `method: precise`.
//!
//! Lenses, the second camera, the shape of the display and the board at every pose follow together from all corners
//! of both cameras, weighted by their covariance; where robot poses are known, both ends of the robot's loop too.
//! Distortion and shape have as many terms as predict corners that were left out. Nothing runs in parallel and all
//! sums have one order, so the answer has the same bytes on any number of threads. Uses `cameras`, `arm`, `geometry`
//! and `board`. Start at [`adjust`]; the unknowns are in `state`, the equations in `normal`.

mod data;
mod fit;
mod gate;
mod leave_one_out;
mod lens;
mod loops;
mod normal;
mod outcome;
mod pose;
mod propagate;
mod rig;
mod robot;
mod se3;
mod select;
mod shape;
mod start;
mod state;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

pub use lens::Distortion;
pub use loops::{Ends, Refined};
pub use outcome::{
    AdjustedLens, DisplayShape, ImageError, LensSigma, LoopFacts, Parameters, PlaceSigma, PointError, RobotTie, Sigmas,
    Uncertain,
};
pub use select::ModelScore;
pub use shape::Shape;

use super::cameras::{SolvedCamera, SolvedStereo};
use super::hand_eye::Pair;
use super::problem::Problem;
use crate::board::Board;
use crate::geometry::{Camera, Point, Target};
use rig::Rig;

/// The adjusted session: one rig of two cameras, or rigs of one.
#[derive(Debug)]
pub struct Adjusted {
    rigs: Vec<Rig>,
    /// What could not be adjusted and why, in words.
    pub warnings: Vec<String>,
}

/// Adjusts everything that was seen; `cameras` are the start, and stay where a rig cannot be adjusted.
pub fn adjust(problem: &Problem, cameras: &BTreeMap<Camera, SolvedCamera>) -> Adjusted {
    let mut adjusted = Adjusted { rigs: Vec::new(), warnings: Vec::new() };
    for start in start::rigs(problem, cameras) {
        let names = start.names();
        match Rig::solve(problem, start) {
            Ok(rig) => adjusted.rigs.push(rig),
            Err(why) => adjusted.warnings.push(format!("{names}: not adjusted, the first solve stands: {why}")),
        }
    }
    adjusted
}

impl Adjusted {
    fn rig(&self, camera: Camera) -> Option<&Rig> {
        self.rigs.iter().find(|r| r.place(camera).is_some())
    }

    /// Brings the robot's poses in, for the reference camera; `None` where it was not adjusted.
    pub fn with_robot<S: Ends>(&mut self, problem: &Problem, reference: Camera) -> Option<Result<Refined<S>, String>> {
        let rig = self.rigs.iter_mut().find(|r| r.place(reference).is_some())?;
        Some(loops::refine(rig, problem, reference))
    }

    /// The cameras as adjusted, in place of those that were the start.
    pub fn cameras(&self, before: &BTreeMap<Camera, SolvedCamera>) -> BTreeMap<Camera, SolvedCamera> {
        let after = |(camera, solved): (&Camera, &SolvedCamera)| {
            (*camera, self.rig(*camera).map_or_else(|| solved.clone(), |rig| rig.solved_camera(*camera, solved)))
        };
        before.iter().map(after).collect()
    }

    /// What is known about the lens of a camera beyond its numbers.
    pub fn lens(&self, camera: Camera) -> Option<AdjustedLens> {
        self.rig(camera)?.lens(camera)
    }

    /// The pair, with the uncertainty of `event_from_rgb`; `None` where there is no rig of two.
    pub fn stereo(&self, problem: &Problem) -> Option<(SolvedStereo, Uncertain<PlaceSigma>)> {
        self.rigs.iter().find_map(|rig| rig.stereo(problem))
    }

    /// The shape of the display, from the rig of the reference camera or the only one.
    pub fn shape(&self, reference: Option<Camera>) -> Option<DisplayShape> {
        reference.and_then(|c| self.rig(c)).or(self.rigs.first()).map(Rig::display_shape)
    }

    /// All shared numbers with their covariance, one entry a rig.
    pub fn parameters(&self) -> Vec<Parameters> {
        self.rigs.iter().map(Rig::parameters).collect()
    }

    /// Robot pose and board pose, from corners alone, of every pose that has both; by index of the pose.
    pub fn pairs(&self, problem: &Problem, camera: Camera) -> Option<BTreeMap<usize, Pair>> {
        self.rig(camera).map(|rig| rig.pairs(problem, camera))
    }

    /// Where corner `id` is on the display as it is bent.
    pub fn corner(&self, board: &Board, camera: Camera, id: u32) -> Option<Point<Target>> {
        self.rig(camera)?.corner(board, id)
    }
}
