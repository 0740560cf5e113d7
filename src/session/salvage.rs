//! A live session whose recording is damaged in the middle: what each capture still proves.
//!
//! The decisions of the session cannot be repeated where inputs are lost, so none are: a capture counts
//! where the samples around it are there and were still.

use super::stillness::History;
use super::types::{Captured, Command, Input, RobotFacts, Stamp, Watched};
use super::{End, Machine, Outcome, PoseRecord};
use crate::config::Stillness as Limits;
use crate::events::blink::DisplayProof;

/// Samples are kept this long, s.
const KEEP_S: f64 = 30.0;

/// Collects the captures of a damaged session.
#[derive(Debug)]
pub struct Salvage {
    limits: Limits,
    history: History,
    poses: Vec<PoseRecord>,
    captures: Vec<Captured>,
    facts: Option<RobotFacts>,
    display: Option<DisplayProof>,
}

impl Salvage {
    /// A session of `poses` poses.
    pub fn new(poses: usize, limits: &Limits) -> Self {
        let poses = vec![PoseRecord::not_reached(); poses];
        let (limits, history, captures) = (limits.through_capture(), History::default(), Vec::new());
        Self { limits, history, poses, captures, facts: None, display: None }
    }

    fn captured(&mut self, at: Stamp, captured: &Captured) {
        let index = self.captures.len();
        self.captures.push(captured.clone());
        let Some(record) = self.poses.get_mut(captured.pose) else { return };
        let start_s = captured.exposures.first().map_or(at.seconds() - self.limits.window_s, |e| e.start_s);
        let end_s = captured.exposures.last().map_or(at.seconds(), |e| e.end_s);
        if !self.history.kept_limits(&self.limits, start_s, end_s) {
            let why = "the samples that prove that the arm stood still are lost";
            *record = PoseRecord { skipped: Some(why.into()), ..PoseRecord::not_reached() };
            return;
        }
        *record = PoseRecord {
            capture: Some(index),
            base_from_tcp: self.history.mean_pose(start_s, end_s),
            joints_rad: self.history.mean_joints(start_s, end_s),
            evidence: Some(self.history.evidence(start_s, end_s)),
            skipped: None,
        };
    }
}

impl Machine for Salvage {
    fn start(&mut self) -> Option<Command> {
        None
    }

    fn handle(&mut self, at: Stamp, input: &Input) -> Option<Command> {
        match input {
            Input::Robot(sample) => self.history.push(at, sample, KEEP_S),
            Input::Captured(captured) => self.captured(at, captured),
            Input::Connected(facts) => self.facts = Some((**facts).clone()),
            Input::RobotLost { .. }
            | Input::CaptureFailed { .. }
            | Input::Interrupted
            | Input::Confirmed
            | Input::Declined
            | Input::Resumed
            | Input::Looked(_)
            | Input::Watched(Watched::Problem(_)) => {}
            Input::Watched(Watched::Proof(proof)) => self.display = Some(proof.clone()),
        }
        None
    }

    fn is_done(&self) -> bool {
        false
    }

    fn into_outcome(self) -> Outcome {
        Outcome { end: End::Cut, poses: self.poses, captures: self.captures, facts: self.facts, display: self.display }
    }
}
