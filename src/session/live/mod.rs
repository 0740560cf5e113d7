//! A live session: pre-flight, start of the program, then for each pose move, wait for stillness, capture,
//! check again; at the end home. A session that ended early may be resumed.

mod arrival;
mod failing;
mod options;
mod position;
mod state;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use super::preflight::{self, Expected, Finding};
use super::route::{Leg, Node, Route};
use super::stillness::History;
use super::types::{Captured, Command, ExecutorState, Input, RobotFacts, RobotSample, Stamp, Watched};
use super::{End, Machine, Outcome, PoseRecord};
use crate::config::Stillness as Limits;
use crate::events::blink::DisplayProof;
use crate::geometry::Camera;
use arrival::has_arrived;
use failing::Failing;
pub use options::{Options, Watch};
use position::Position;
use state::{Moving, State};

/// A capture that the arm disturbed is repeated at most this often.
const MAX_ATTEMPTS: u32 = 3;
/// Samples that pre-flight looks at; all must pass.
const PREFLIGHT_SAMPLES: usize = 25;
/// Samples are kept this long for the evidence of a capture, s.
const KEEP_S: f64 = 30.0;
/// The program that moves the arm must say that it is there within this time, s.
const START_WITHIN_S: f64 = 5.0;
/// Walks one trajectory. Feed it inputs; do what it says.
#[derive(Debug)]
pub struct Live {
    route: Route,
    limits: Limits,
    expected: Expected,
    options: Options,
    load: Option<String>,
    state: State,
    history: History,
    poses: Vec<PoseRecord>,
    captures: Vec<Captured>,
    facts: Option<RobotFacts>,
    /// How the display blinked; absent until it was watched in this part of the session.
    display: Option<DisplayProof>,
    /// Findings about what has changed since the session began.
    changed: Vec<Finding>,
    position: Position,
    /// Moves to come before the next place is chosen.
    legs: VecDeque<Leg>,
    /// Poses that were given up in this part of the session.
    given_up: Vec<usize>,
    failing: Failing,
    confirmed: bool,
    resumed: bool,
    /// Whether the arm has been told to move.
    moved: bool,
    /// Sequence number of the last move; driver and controller count them alike.
    sequence: i32,
}

impl Live {
    /// A session over the poses of `route`; `load` names the program that is loaded when all is done.
    pub fn new(route: Route, limits: Limits, expected: Expected, options: Options, load: Option<String>) -> Self {
        let poses = vec![PoseRecord::not_reached(); route.stops.len()];
        let position = Position::at_start(route.start_joints_rad);
        Self {
            route,
            limits,
            expected,
            options,
            load,
            state: State::Preflight { seen: 0 },
            history: History::default(),
            poses,
            captures: Vec::new(),
            facts: None,
            display: None,
            changed: Vec::new(),
            position,
            legs: VecDeque::new(),
            given_up: Vec::new(),
            failing: Failing::default(),
            confirmed: false,
            resumed: false,
            moved: false,
            sequence: 0,
        }
    }

    /// How many poses have no capture yet.
    pub fn missing(&self) -> usize {
        self.poses.iter().filter(|p| p.capture.is_none()).count()
    }

    fn sample(&mut self, at: Stamp, sample: &RobotSample) -> Option<Command> {
        self.history.push(at, sample, KEEP_S);
        match self.state {
            State::Preflight { seen } => self.preflight(at, seen, sample),
            // Nothing of ours runs yet; pre-flight looks again after the answer.
            State::Asking(None) | State::Watching(None) => None,
            State::Starting { since } => self.starting(at, since, sample),
            State::Moving(_) | State::Capturing { .. } | State::Asking(Some(_)) | State::Watching(Some(_)) => {
                let fine = preflight::may_move(sample, &self.expected).and_then(|()| preflight::is_playing(sample));
                match fine {
                    Err(finding) => Some(self.stop(finding.message)),
                    Ok(()) => self.watch_motion(at, sample),
                }
            }
            State::Done(_) => None,
        }
    }

    fn preflight(&mut self, at: Stamp, seen: usize, sample: &RobotSample) -> Option<Command> {
        let Some(facts) = &self.facts else {
            return Some(self.refuse(vec![Finding::new("connection", "the robot did not describe itself")]));
        };
        let mut found = preflight::findings(facts, sample, &self.expected);
        found.extend(self.changed.iter().cloned());
        if found.is_empty() && seen + 1 < PREFLIGHT_SAMPLES {
            self.state = State::Preflight { seen: seen + 1 };
            return None;
        }
        match self.where_from(sample) {
            Ok(legs) => self.legs = legs,
            Err(Some(finding)) => found.push(finding),
            Err(None) if found.is_empty() => return Some(self.ask_to_approach(sample)),
            Err(None) => found.extend(preflight::start_finding(sample, &self.expected)),
        }
        if !found.is_empty() {
            return Some(self.refuse(found));
        }
        if self.options.watch == Watch::AtStart && self.display.is_none() {
            self.state = State::Watching(None);
            return Some(Command::Watch);
        }
        self.state = State::Starting { since: at };
        Some(Command::Start)
    }

    /// The display blinks: go on where it was watched. It does not: no capture is worth a move.
    fn watched(&mut self, watched: &Watched) -> Option<Command> {
        let State::Watching(moving) = &mut self.state else { return None };
        let moving = moving.take();
        match (watched, moving) {
            (Watched::Proof(proof), moving) => {
                self.display = Some(proof.clone());
                let again = |m: Moving| State::Moving(Moving { since: None, arrived: None, ..m });
                self.state = moving.map_or(State::Preflight { seen: 0 }, again);
                None
            }
            (Watched::Problem(why), None) => Some(self.refuse(vec![Finding::new("display", why.clone())])),
            (Watched::Problem(why), Some(_)) => Some(self.stop(format!("display: {why}"))),
        }
    }

    fn ask_to_approach(&mut self, sample: &RobotSample) -> Command {
        self.state = State::Asking(None);
        let far = preflight::start_finding(sample, &self.expected).map(|finding| finding.message).unwrap_or_default();
        Command::Confirm {
            question: format!("{far}. Drive there slowly from where it is? The way is clear by the cell file"),
        }
    }

    fn starting(&mut self, at: Stamp, since: Stamp, sample: &RobotSample) -> Option<Command> {
        if let Err(finding) = preflight::may_move(sample, &self.expected) {
            return Some(self.refuse(vec![finding]));
        }
        let runs = preflight::is_playing(sample).is_ok();
        if runs && sample.executor_state == ExecutorState::Idle {
            // The controller counts on from what it acknowledges now.
            self.sequence = sample.executor_sequence;
            return Some(self.next_leg(&sample.joints_rad));
        }
        let late = at.seconds() - since.seconds() > START_WITHIN_S;
        late.then(|| {
            let why = format!(
                "the program that moves the arm did not start within {START_WITHIN_S} s: {}",
                if runs { "it runs, but does not answer" } else { "the controller does not run it" }
            );
            self.refuse(vec![Finding::new("program", why)])
        })
    }

    /// The next pose that is to be visited.
    fn next_missing(&self) -> Option<usize> {
        (0..self.poses.len()).find(|i| self.poses[*i].capture.is_none() && !self.given_up.contains(i))
    }

    /// The next move, or the end.
    fn next_leg(&mut self, now: &[f64; 6]) -> Command {
        if self.legs.is_empty() {
            let legs = match self.next_missing() {
                // A program of the plant goes its own ways.
                Some(pose) if self.expected.external => self.route.planned(pose).map(|leg| vec![leg]),
                Some(pose) => self.route.to_pose(self.position.node, now, pose),
                None if self.position.node == Node::Home => Ok(Vec::new()),
                None => self.route.to_home(self.position.node, now),
            };
            match legs {
                Ok(legs) => self.legs.extend(legs),
                Err(why) => return self.stop(format!("no clear way onward: {why}")),
            }
        }
        match self.legs.pop_front() {
            None => self.finish(),
            Some(leg) if self.options.confirm_each => {
                let question = format!("next: {}. Move", leg.described());
                self.state = State::Asking(Some(Box::new(leg)));
                Command::Confirm { question }
            }
            Some(leg) => self.go(leg),
        }
    }

    fn go(&mut self, leg: Leg) -> Command {
        let command = match leg.to {
            Node::Pose(pose) if leg.capture => Command::Move { pose, target: leg.target },
            Node::Pose(_) | Node::Home | Node::Elsewhere => {
                Command::Travel { why: leg.described(), target: leg.target }
            }
        };
        self.history.clear();
        self.sequence = self.sequence.checked_add(1).unwrap_or(1);
        self.position.leaves_for(&leg);
        self.moved = true;
        self.state = State::Moving(Moving { leg, since: None, arrived: None, attempt: 0, slowest: 1.0 });
        command
    }

    fn finish(&mut self) -> Command {
        self.state = State::Done(End::Complete);
        Command::Finish { load: self.load.clone() }
    }

    /// Watches a move until the arm is still, then captures or goes on.
    fn watch_motion(&mut self, at: Stamp, sample: &RobotSample) -> Option<Command> {
        let State::Moving(moving) = &mut self.state else { return None };
        let started = *moving.since.get_or_insert(at);
        moving.slowest = moving.slowest.min(sample.target_speed_fraction);
        let ours = sample.executor_sequence == self.sequence;
        let place = moving.leg.described();
        if ours && sample.executor_state == ExecutorState::Refused {
            return Some(self.stop(format!("the controller refused the move ({place}) as outside its safety limits")));
        }
        let steady = ours && sample.executor_state == ExecutorState::Steady;
        if steady && moving.arrived.is_none() {
            // A program of the plant goes where it goes; what counts is what is measured there.
            if !self.expected.external
                && let Err(why) = has_arrived(&moving.leg.target, sample)
            {
                return Some(self.stop(format!("{place}: {why}")));
            }
            moving.arrived = Some(at);
        }
        let waited_s = |from: Stamp| at.seconds() - from.seconds();
        let deadline_s = 1.5 * moving.leg.move_s / moving.slowest.max(0.01) + self.options.patience_s;
        let late_move = moving.arrived.is_none() && waited_s(started) > deadline_s;
        let late_still = moving.arrived.is_some_and(|a| waited_s(a) > self.limits.timeout_s);
        if steady && (!moving.leg.capture || self.history.is_still(&self.limits)) {
            return Some(self.arrived(at, sample));
        }
        if late_move && self.expected.external {
            let why = format!("the program of the plant has not set at_pose within {deadline_s:.0} s ({place})");
            return Some(self.stop(why));
        }
        if late_move || late_still {
            let what = if late_move { "has not arrived" } else { "does not come to rest" };
            return Some(self.stop(format!("the arm {what} after {:.1} s ({place})", waited_s(started))));
        }
        None
    }

    fn arrived(&mut self, at: Stamp, sample: &RobotSample) -> Command {
        let State::Moving(Moving { leg, attempt, .. }) = &self.state else { return self.finish() };
        let (leg, attempt) = (leg.clone(), *attempt);
        self.position.reaches(leg.to, sample.joints_rad);
        match leg.to {
            Node::Pose(_) if leg.capture && self.options.watch != Watch::Never && self.display.is_none() => {
                self.state = State::Watching(Some(Moving { leg, since: None, arrived: None, attempt, slowest: 1.0 }));
                Command::Watch
            }
            Node::Pose(pose) if leg.capture => {
                self.state = State::Capturing { pose, attempt, decided: at };
                Command::Capture { pose, attempt }
            }
            Node::Pose(_) | Node::Home | Node::Elsewhere => self.next_leg(&sample.joints_rad),
        }
    }

    fn captured(&mut self, at: Stamp, captured: &Captured) -> Option<Command> {
        let index = self.captures.len();
        self.captures.push(captured.clone());
        let State::Capturing { pose, attempt, decided } = self.state else { return None };
        if captured.pose != pose || captured.attempt != attempt {
            return None;
        }
        let start_s = captured.exposures.first().map_or(decided.seconds(), |e| e.start_s);
        // Without a frame camera the events run from the decision to the delivery.
        let end_s = captured.exposures.last().map_or(at.seconds(), |e| e.end_s);
        let after_decision = start_s >= decided.seconds();
        if !after_decision {
            return Some(self.repeat(pose, attempt, "the exposure began before the arm was known to be still"));
        }
        let kept = self.history.kept_limits(&self.limits.through_capture(), decided.seconds(), end_s);
        if !(kept && self.history.stayed_steady(decided.seconds(), end_s)) {
            return Some(self.repeat(pose, attempt, "the arm moved during the exposure"));
        }
        // A short exposure lies between two samples: then the time since the decision speaks for it.
        let enough = self.history.count(start_s, end_s) >= 2;
        let start_s = if enough { start_s } else { decided.seconds() };
        self.poses[pose] = PoseRecord {
            capture: Some(index),
            base_from_tcp: self.history.mean_pose(start_s, end_s),
            joints_rad: self.history.mean_joints(start_s, end_s),
            evidence: Some(self.history.evidence(start_s, end_s)),
            skipped: None,
        };
        self.failing = Failing::default();
        let now = self.position.node_joints;
        Some(self.next_leg(&now))
    }

    fn repeat(&mut self, pose: usize, attempt: u32, why: &str) -> Command {
        self.try_again(pose, attempt, None, why)
    }

    /// `camera` failed, or something else was wrong.
    fn try_again(&mut self, pose: usize, attempt: u32, camera: Option<Camera>, why: &str) -> Command {
        if attempt + 1 >= MAX_ATTEMPTS {
            self.poses[pose].skipped = Some(format!("{why}, {MAX_ATTEMPTS} times"));
            self.given_up.push(pose);
            if let Some(why) = self.failing.gave_up(camera, why, self.options.failed_poses) {
                return self.stop(why);
            }
            let now = self.position.node_joints;
            return self.next_leg(&now);
        }
        // The window starts anew; the arm is where it is, so no move is commanded and no time counts yet.
        self.history.clear();
        let leg = self.position.leg.clone();
        let Some(leg) = leg else { return self.finish() };
        self.state = State::Moving(Moving { leg, since: None, arrived: None, attempt: attempt + 1, slowest: 1.0 });
        // The next still decision captures again; until then there is nothing to do but to wait.
        Command::Wait { pose, attempt: attempt + 1 }
    }

    /// Ends before any motion; afterwards an operator must look.
    fn refuse(&mut self, findings: Vec<Finding>) -> Command {
        if self.moved {
            let all: Vec<_> = findings.iter().map(ToString::to_string).collect();
            self.state = State::Done(End::OperatorNeeded(all.join("; ")));
        } else {
            self.state = State::Done(End::PreflightFailed(findings));
        }
        Command::Finish { load: None }
    }

    fn stop(&mut self, why: String) -> Command {
        if !self.moved {
            return self.refuse(vec![Finding::new("motion", why)]);
        }
        self.state = State::Done(End::OperatorNeeded(why.clone()));
        Command::Stop { why }
    }

    fn lost(&mut self, why: &str) -> Command {
        if !self.moved {
            return self.refuse(vec![Finding::new("connection", why)]);
        }
        // The heartbeats have ended with the connection: the watchdog of the controller stops our script.
        let then = if self.expected.external {
            "the program of the plant may go on: look at the arm"
        } else {
            "its watchdog stops the arm"
        };
        self.stop(format!("the robot was lost: {why}; {then}"))
    }

    fn interrupted(&mut self) -> Command {
        self.state = State::Done(End::Interrupted);
        if self.moved {
            Command::Stop { why: "interrupted by the operator".into() }
        } else {
            Command::Finish { load: None }
        }
    }

    fn answered(&mut self, yes: bool) -> Option<Command> {
        let State::Asking(leg) = &mut self.state else { return None };
        let leg = leg.take();
        match (yes, leg) {
            (true, None) => {
                self.confirmed = true;
                self.state = State::Preflight { seen: 0 };
                None
            }
            (true, Some(leg)) => Some(self.go(*leg)),
            (false, None) => {
                let far = "the arm is far from the start, and nobody has confirmed that it may drive there";
                Some(self.refuse(vec![Finding::new("start_pose", far)]))
            }
            (false, Some(_)) => Some(self.interrupted()),
        }
    }

    /// Begins a further part: pre-flight again, then only the missing poses.
    fn resume(&mut self) {
        self.state = State::Preflight { seen: 0 };
        self.history.clear();
        self.legs.clear();
        self.given_up.clear();
        self.failing = Failing::default();
        (self.confirmed, self.resumed, self.moved) = (false, true, false);
        self.display = None;
    }

    fn connected(&mut self, facts: &RobotFacts) {
        match &self.facts {
            None => self.facts = Some(facts.clone()),
            Some(before) => self.changed = preflight::changes(before, facts),
        }
    }
}

impl Machine for Live {
    fn start(&mut self) -> Option<Command> {
        None
    }

    fn handle(&mut self, at: Stamp, input: &Input) -> Option<Command> {
        if let Input::Resumed = input {
            self.resume();
            return None;
        }
        if self.is_done() {
            return None;
        }
        match input {
            Input::Connected(facts) => {
                self.connected(facts);
                None
            }
            Input::Robot(sample) => self.sample(at, sample),
            Input::Captured(captured) => self.captured(at, captured),
            Input::CaptureFailed { pose, camera, why } => {
                let State::Capturing { pose: now, attempt, .. } = self.state else { return None };
                (now == *pose).then(|| self.try_again(now, attempt, *camera, why))
            }
            Input::RobotLost { why } => Some(self.lost(why)),
            Input::Interrupted => Some(self.interrupted()),
            Input::Confirmed => self.answered(true),
            Input::Declined => self.answered(false),
            Input::Watched(watched) => self.watched(watched),
            Input::Resumed | Input::Looked(_) => None,
        }
    }

    fn is_done(&self) -> bool {
        matches!(self.state, State::Done(_))
    }

    fn into_outcome(self) -> Outcome {
        let end = match self.state {
            State::Done(end) => end,
            State::Preflight { .. }
            | State::Asking(_)
            | State::Watching(_)
            | State::Starting { .. }
            | State::Moving(_)
            | State::Capturing { .. } => End::Cut,
        };
        Outcome { end, poses: self.poses, captures: self.captures, facts: self.facts, display: self.display }
    }
}
