//! A live session: pre-flight, then for each pose move, wait for stillness, capture, check again.

use super::preflight::{self, Expected, Finding};
use super::stillness::History;
use super::types::{Captured, Command, ExecutorState, Input, MoveTarget, RobotSample, Stamp};
use super::{End, Machine, Outcome, PoseRecord};
use crate::config::Stillness as Limits;

/// A capture that the arm disturbed is repeated at most this often.
const MAX_ATTEMPTS: u32 = 3;
/// Samples that pre-flight looks at; all must pass.
const PREFLIGHT_SAMPLES: usize = 25;
/// Samples are kept this long for the evidence of a capture, s.
const KEEP_S: f64 = 30.0;

/// One stop of the trajectory.
#[derive(Debug, Clone, PartialEq)]
pub struct Stop {
    /// Where to.
    pub target: MoveTarget,
    /// Give up when the arm has not arrived after this long, s.
    pub deadline_s: f64,
}

/// Walks one trajectory. Feed it inputs; do what it says.
#[derive(Debug)]
pub struct Live {
    stops: Vec<Stop>,
    limits: Limits,
    expected: Expected,
    state: State,
    history: History,
    poses: Vec<PoseRecord>,
    captures: Vec<Captured>,
    /// Sequence number of the last move; driver and controller count them alike.
    sequence: i32,
}

#[derive(Debug)]
enum State {
    Preflight {
        seen: usize,
    },
    Moving {
        pose: usize,
        since: Option<Stamp>,
        arrived: Option<Stamp>,
        attempt: u32,
    },
    Capturing {
        pose: usize,
        attempt: u32,
        decided: Stamp,
    },
    /// The last command was given; its end is recorded.
    Done(End),
}

impl Live {
    /// A session over `stops`.
    pub fn new(stops: Vec<Stop>, limits: Limits, expected: Expected) -> Self {
        let poses = vec![PoseRecord::not_reached(); stops.len()];
        let state = State::Preflight { seen: 0 };
        Self { stops, limits, expected, state, history: History::default(), poses, captures: Vec::new(), sequence: 0 }
    }

    fn sample(&mut self, at: Stamp, sample: &RobotSample) -> Option<Command> {
        self.history.push(at, sample, KEEP_S);
        match self.state {
            State::Preflight { seen } => self.preflight(seen, sample),
            State::Moving { .. } | State::Capturing { .. } => {
                if let Err((_, why)) = preflight::may_move(sample, self.expected.allow_reduced) {
                    return Some(self.stop(End::OperatorNeeded(why.clone()), why));
                }
                self.watch_motion(at, sample)
            }
            State::Done(_) => None,
        }
    }

    fn preflight(&mut self, seen: usize, sample: &RobotSample) -> Option<Command> {
        let findings = preflight::findings(sample, &self.expected);
        if !findings.is_empty() {
            self.state = State::Done(End::PreflightFailed(findings));
            return Some(Command::Finish);
        }
        if seen + 1 < PREFLIGHT_SAMPLES {
            self.state = State::Preflight { seen: seen + 1 };
            return None;
        }
        // The controller counts on from what it acknowledges now.
        self.sequence = sample.executor_sequence;
        Some(self.go_to(0))
    }

    fn go_to(&mut self, pose: usize) -> Command {
        let Some(stop) = self.stops.get(pose) else {
            self.state = State::Done(End::Complete);
            return Command::Finish;
        };
        let command = Command::Move { pose, target: stop.target };
        self.history.clear();
        self.sequence = self.sequence.checked_add(1).unwrap_or(1);
        self.state = State::Moving { pose, since: None, arrived: None, attempt: 0 };
        command
    }

    /// Watches a move until the arm is still, then captures.
    fn watch_motion(&mut self, at: Stamp, sample: &RobotSample) -> Option<Command> {
        let State::Moving { pose, since, arrived, attempt } = &mut self.state else { return None };
        let (pose, attempt) = (*pose, *attempt);
        let started = *since.get_or_insert(at);
        let ours = sample.executor_sequence == self.sequence;
        if ours && sample.executor_state == ExecutorState::Refused {
            let why = format!("the controller refused the move to pose {} as outside its safety limits", pose + 1);
            return Some(self.stop(End::Aborted(why.clone()), why));
        }
        let steady = ours && sample.executor_state == ExecutorState::Steady;
        if steady && arrived.is_none() {
            *arrived = Some(at);
        }
        let waited_s = |from: Stamp| at.seconds() - from.seconds();
        let late_move = arrived.is_none() && waited_s(started) > self.stops[pose].deadline_s;
        let late_still = arrived.is_some_and(|a| waited_s(a) > self.limits.timeout_s);
        if steady && self.history.is_still(&self.limits) {
            self.state = State::Capturing { pose, attempt, decided: at };
            return Some(Command::Capture { pose, attempt });
        }
        if late_move || late_still {
            let what = if late_move { "has not arrived" } else { "does not come to rest" };
            let why = format!("the arm {what} at pose {} after {:.1} s", pose + 1, waited_s(started));
            return Some(self.stop(End::OperatorNeeded(why.clone()), why));
        }
        None
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
        if !self.history.kept_limits(&self.limits.through_capture(), decided.seconds(), end_s) {
            return Some(self.repeat(pose, attempt, "the arm moved during the exposure"));
        }
        // A short exposure lies between two samples: then the time since the decision speaks for it.
        let enough = self.history.count(start_s, end_s) >= 2;
        let start_s = if enough { start_s } else { decided.seconds() };
        self.poses[pose] = PoseRecord {
            capture: Some(index),
            base_from_tcp: self.history.mean_pose(start_s, end_s),
            evidence: Some(self.history.evidence(start_s, end_s)),
            skipped: None,
        };
        Some(self.go_to(pose + 1))
    }

    fn repeat(&mut self, pose: usize, attempt: u32, why: &str) -> Command {
        if attempt + 1 >= MAX_ATTEMPTS {
            self.poses[pose].skipped = Some(format!("{why}, {MAX_ATTEMPTS} times"));
            return self.go_to(pose + 1);
        }
        // The window starts anew; the arm is where it is, so no move is commanded and no time counts yet.
        self.history.clear();
        self.state = State::Moving { pose, since: None, arrived: None, attempt: attempt + 1 };
        // The next still decision captures again; until then there is nothing to do but to wait.
        Command::Wait { pose, attempt: attempt + 1 }
    }

    fn stop(&mut self, end: End, why: String) -> Command {
        self.state = State::Done(end);
        Command::Stop { why }
    }
}

impl Machine for Live {
    fn start(&mut self) -> Option<Command> {
        None
    }

    fn handle(&mut self, at: Stamp, input: &Input) -> Option<Command> {
        if self.is_done() {
            return None;
        }
        match input {
            Input::Robot(sample) => self.sample(at, sample),
            Input::Captured(captured) => self.captured(at, captured),
            Input::CaptureFailed { pose, why } => match self.state {
                State::Capturing { pose: now, attempt, .. } if now == *pose => Some(self.repeat(now, attempt, why)),
                State::Preflight { .. } | State::Moving { .. } | State::Capturing { .. } | State::Done(_) => None,
            },
            Input::RobotLost { why } => Some(self.stop(End::Aborted(why.clone()), why.clone())),
            Input::Interrupted => Some(self.stop(End::Interrupted, "interrupted by the operator".into())),
        }
    }

    fn is_done(&self) -> bool {
        matches!(self.state, State::Done(_))
    }

    fn into_outcome(self) -> Outcome {
        let end = match self.state {
            State::Done(end) => end,
            State::Preflight { .. } | State::Moving { .. } | State::Capturing { .. } => End::Cut,
        };
        Outcome { end, poses: self.poses, captures: self.captures }
    }
}

/// The findings as one line each.
impl std::fmt::Display for Finding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.id, self.message)
    }
}

#[cfg(test)]
mod tests {
    use super::super::stillness::tests::{limits, still_sample};
    use super::super::types::Exposure;
    use super::*;

    fn expected() -> Expected {
        Expected {
            tcp_offset: [0.0; 6],
            payload_kg: 0.5,
            payload_cog_m: [0.0; 3],
            allow_reduced: false,
            start_joints_rad: [0.1; 6],
            start_within_rad: 0.2,
        }
    }

    fn session(poses: usize) -> Live {
        let target = MoveTarget::Joint { joints_rad: [0.1; 6], speed_rad_s: 1.0, acceleration_rad_s2: 1.0 };
        Live::new(vec![Stop { target, deadline_s: 4.0 }; poses], limits(), expected())
    }

    /// Runs a session against an arm that moves for 0.5 s and a camera that needs 0.2 s.
    fn walk(live: &mut Live, spoil: impl Fn(f64, &mut RobotSample)) -> Vec<(f64, Command)> {
        let (mut commands, mut sequence, mut moving_until) = (Vec::new(), 0, 0.0);
        let mut due: Option<(f64, Captured)> = None;
        for i in 0..4000 {
            let at_s = f64::from(i) * 0.008;
            let mut sample = still_sample();
            sample.executor_sequence = sequence;
            if at_s < moving_until {
                sample.executor_state = ExecutorState::Moving;
                sample.target_joint_speeds_rad_s = [0.3; 6];
            }
            spoil(at_s, &mut sample);
            let mut inputs = vec![Input::Robot(Box::new(sample))];
            if due.as_ref().is_some_and(|(when, _)| at_s >= *when) {
                inputs.extend(due.take().map(|(_, captured)| Input::Captured(captured)));
            }
            for input in inputs {
                let Some(command) = live.handle(Stamp::from_seconds(at_s), &input) else { continue };
                match &command {
                    Command::Move { .. } => (sequence, moving_until) = (sequence + 1, at_s + 0.5),
                    Command::Capture { pose, attempt } => {
                        let exposures = vec![Exposure { start_s: at_s + 0.02, end_s: at_s + 0.12, image: true }];
                        let (pose, attempt) = (*pose, *attempt);
                        due = Some((at_s + 0.2, Captured { pose, attempt, exposures, event_bytes: 0, declared: None }));
                    }
                    Command::Wait { .. } | Command::Stop { .. } | Command::Finish => {}
                }
                commands.push((at_s, command));
            }
        }
        commands
    }

    #[test]
    fn every_pose_is_moved_to_awaited_and_captured() {
        let mut live = session(3);
        let commands = walk(&mut live, |_, _| ());
        let names: Vec<_> = commands.iter().map(|(_, c)| std::mem::discriminant(c)).collect();
        assert_eq!(names.len(), 7);
        let (moved, captured) = (commands[0].0, commands[1].0);
        assert!(captured - moved >= 0.5 + limits().window_s, "{moved} {captured}");
        let outcome = live.into_outcome();
        assert_eq!(outcome.end, End::Complete);
        assert!(outcome.poses.iter().all(|p| p.capture.is_some() && p.base_from_tcp.is_some()));
    }

    #[test]
    fn no_motion_without_preflight() {
        type Spoil = fn(&mut RobotSample);
        let faults: [(&str, Spoil); 8] = [
            ("robot_mode", |s| s.robot_mode = 5),
            ("safety_mode", |s| s.safety_mode = 3),
            ("safety_mode", |s| s.safety_mode = 2),
            ("program", |s| s.runtime_state = 4),
            ("teach_button", |s| s.robot_status_bits = 7),
            ("tcp_offset", |s| s.tcp_offset[2] = 0.001),
            ("payload", |s| s.payload_kg = f64::NAN),
            ("start_pose", |s| s.joints_rad[2] = 1.0),
        ];
        for (id, spoil) in faults {
            let mut live = session(3);
            let commands = walk(&mut live, |_, s| spoil(s));
            assert!(commands.iter().all(|(_, c)| *c == Command::Finish), "{id}: {commands:?}");
            let End::PreflightFailed(findings) = live.into_outcome().end else { panic!("{id} passed") };
            assert!(findings.iter().any(|f| f.id == id), "{id}: {findings:?}");
        }
    }

    #[test]
    fn a_protective_stop_ends_the_session_and_needs_an_operator() {
        let mut live = session(3);
        let commands = walk(&mut live, |at, s| s.safety_mode = if at > 1.2 { 3 } else { 1 });
        assert!(matches!(commands.last(), Some((_, Command::Stop { .. }))));
        assert!(matches!(live.into_outcome().end, End::OperatorNeeded(_)));
    }

    #[test]
    fn a_shaken_exposure_is_repeated() {
        let mut live = session(1);
        let undisturbed = walk(&mut session(1), |_, _| ());
        let shake_at = undisturbed[1].0 + 0.06;
        let commands =
            walk(&mut live, |at, s| s.joint_speeds_rad_s[2] = if (at - shake_at).abs() < 0.005 { 0.02 } else { 0.0 });
        let captures = commands.iter().filter(|(_, c)| matches!(c, Command::Capture { .. })).count();
        assert_eq!(captures, 2, "{commands:?}");
        let outcome = live.into_outcome();
        assert_eq!(outcome.poses[0].capture, Some(1));
        assert_eq!(outcome.captures.len(), 2);
    }

    #[test]
    fn an_arm_that_never_rests_is_reported_not_photographed() {
        let mut live = session(1);
        let commands = walk(&mut live, |at, s| s.joint_speeds_rad_s[0] = if at > 0.3 { 0.02 } else { 0.0 });
        assert!(!commands.iter().any(|(_, c)| matches!(c, Command::Capture { .. })));
        let End::OperatorNeeded(why) = live.into_outcome().end else { panic!("no refusal") };
        assert!(why.contains("does not come to rest"), "{why}");
    }
}
