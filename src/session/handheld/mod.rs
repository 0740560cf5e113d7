//! A session without a robot: the cameras themselves show when the display is held still, then a capture is taken;
//! advice says where to hold it next.

mod coverage;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use super::types::{Captured, Command, Input, Look, Stamp};
use super::{End, Evidence, Machine, Outcome, PoseRecord};
use crate::board::View;
use crate::geometry::Camera;
use coverage::{Coverage, Place};

/// A capture during which the corners moved is repeated at most this often before the place is left.
const MAX_ATTEMPTS: u32 = 3;
/// Fewest corners by which two looks are compared.
const MIN_COMMON: usize = 4;

/// What counts as still and as enough.
#[derive(Debug, Clone, PartialEq)]
pub struct HandheldRules {
    /// Captures of a whole session.
    pub poses: usize,
    /// Largest motion of the corners from look to look, px: the median of each camera.
    pub motion_px: f64,
    /// They must be still for this long, s.
    pub hold_s: f64,
    /// Fewest corners that each camera must see.
    pub min_corners: usize,
    /// Image width and height of each camera, px.
    pub sizes: BTreeMap<Camera, [u32; 2]>,
}

/// Judges looks, asks for captures, gives advice. Feed it inputs; do what it says.
#[derive(Debug)]
pub struct Handheld {
    rules: HandheldRules,
    state: State,
    last: Option<Look>,
    coverage: Coverage,
    poses: Vec<PoseRecord>,
    captures: Vec<Captured>,
    advice: String,
}

#[derive(Debug)]
enum State {
    /// Still since, if so.
    Watching {
        still_since: Option<Stamp>,
        attempt: u32,
    },
    /// Asked for a capture; what was seen before it.
    Capturing {
        attempt: u32,
        since: Stamp,
        before: Look,
    },
    /// The capture is there; the next look shows whether anything moved meanwhile.
    Confirming {
        attempt: u32,
        since: Stamp,
        before: Look,
    },
    Done(End),
}

impl Handheld {
    /// A session that ends when it has all its captures.
    pub fn new(rules: HandheldRules) -> Self {
        let poses = vec![PoseRecord::not_reached(); rules.poses];
        Self {
            rules,
            state: State::Watching { still_since: None, attempt: 0 },
            last: None,
            coverage: Coverage::default(),
            poses,
            captures: Vec::new(),
            advice: String::new(),
        }
    }

    fn taken(&self) -> usize {
        self.poses.iter().filter(|pose| pose.capture.is_some()).count()
    }

    fn looked(&mut self, at: Stamp, look: &Look) -> Option<Command> {
        let before = self.last.replace(look.clone());
        match std::mem::replace(&mut self.state, State::Watching { still_since: None, attempt: 0 }) {
            State::Watching { still_since, attempt } => self.watched(at, look, before.as_ref(), still_since, attempt),
            State::Confirming { attempt, since, before } => Some(self.confirm(at, look, &before, since, attempt)),
            state @ (State::Capturing { .. } | State::Done(_)) => {
                self.state = state;
                None
            }
        }
    }

    fn watched(
        &mut self,
        at: Stamp,
        look: &Look,
        before: Option<&Look>,
        still_since: Option<Stamp>,
        attempt: u32,
    ) -> Option<Command> {
        let advice = match self.blind(look) {
            Some(advice) => advice,
            None if before.is_some_and(|before| self.is_still(before, look)) => {
                let since = still_since.unwrap_or(at);
                self.state = State::Watching { still_since: Some(since), attempt };
                let place = self.place(look)?;
                if !self.coverage.is_new(&place) {
                    return self.guide(self.coverage.advice(self.taken(), self.rules.poses));
                }
                let held = at.seconds() - since.seconds() >= self.rules.hold_s;
                if held {
                    let pose = self.taken();
                    self.state = State::Capturing { attempt, since, before: look.clone() };
                    return Some(Command::Capture { pose, attempt });
                }
                return None;
            }
            None => self.coverage.advice(self.taken(), self.rules.poses),
        };
        self.guide(advice)
    }

    /// The advice, if it is a new one.
    fn guide(&mut self, advice: String) -> Option<Command> {
        let is_new = advice != self.advice;
        self.advice.clone_from(&advice);
        is_new.then_some(Command::Guide { advice })
    }

    /// What is wrong where a camera does not see enough of the board.
    fn blind(&self, look: &Look) -> Option<String> {
        let blind = self.rules.sizes.keys().find(|camera| {
            let corners = look.views.get(camera).map_or(0, |view| view.corners.len());
            corners < self.rules.min_corners
        })?;
        Some(format!("hold the board into the view of both cameras; the {blind} camera does not see it"))
    }

    fn is_still(&self, before: &Look, now: &Look) -> bool {
        self.rules.sizes.keys().all(|camera| {
            let moved_px = moved_px(before.views.get(camera), now.views.get(camera));
            moved_px.is_some_and(|px| px <= self.rules.motion_px)
        })
    }

    fn place(&self, look: &Look) -> Option<Place> {
        let (camera, size) = self.rules.sizes.iter().next()?;
        Place::of(look.views.get(camera)?, *size)
    }

    fn captured(&mut self, captured: &Captured) -> Option<Command> {
        self.captures.push(captured.clone());
        if let State::Capturing { attempt, since, before } = &self.state {
            self.state = State::Confirming { attempt: *attempt, since: *since, before: before.clone() };
        }
        None
    }

    /// The board is where it was before the capture: it counts.
    fn confirm(&mut self, at: Stamp, look: &Look, before: &Look, since: Stamp, attempt: u32) -> Command {
        let pose = self.taken();
        if !self.is_still(before, look) {
            let attempt = if attempt + 1 < MAX_ATTEMPTS { attempt + 1 } else { 0 };
            self.state = State::Watching { still_since: None, attempt };
            return Command::Wait { pose, attempt };
        }
        if let Some(place) = self.place(before) {
            self.coverage.add(place);
        }
        let evidence = Evidence {
            source: "the corners kept still from look to look".into(),
            from_s: since.seconds(),
            to_s: at.seconds(),
            samples: None,
            max_joint_speed_rad_s: None,
            max_joint_spread_rad: None,
            max_tcp_speed_m_s: None,
        };
        if let Some(record) = self.poses.get_mut(pose) {
            let capture = self.captures.len().checked_sub(1);
            *record = PoseRecord { capture, evidence: Some(evidence), skipped: None, ..PoseRecord::not_reached() };
        }
        if self.taken() >= self.rules.poses {
            self.state = State::Done(End::Complete);
            return Command::Finish { load: None };
        }
        self.state = State::Watching { still_since: None, attempt: 0 };
        self.advice = self.coverage.advice(self.taken(), self.rules.poses);
        Command::Guide { advice: format!("captured {} of {}; {}", self.taken(), self.rules.poses, self.advice) }
    }
}

/// Median motion of the corners that both views have, px; `None` where they have too few in common.
fn moved_px(before: Option<&View>, now: Option<&View>) -> Option<f64> {
    let (before, now) = (before?, now?);
    let moved = |c: &crate::board::Corner| Some((c.px, before.px(c.id)?));
    let mut moved: Vec<f64> =
        now.corners.iter().filter_map(moved).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).collect();
    moved.sort_by(f64::total_cmp);
    (moved.len() >= MIN_COMMON).then(|| moved[moved.len() / 2])
}

impl Machine for Handheld {
    fn start(&mut self) -> Option<Command> {
        self.guide(self.coverage.advice(0, self.rules.poses))
    }

    fn handle(&mut self, at: Stamp, input: &Input) -> Option<Command> {
        match input {
            Input::Looked(look) => self.looked(at, look),
            Input::Captured(captured) => self.captured(captured),
            Input::CaptureFailed { .. } => {
                self.state = State::Watching { still_since: None, attempt: 0 };
                None
            }
            Input::Interrupted => {
                self.state = State::Done(End::Interrupted);
                Some(Command::Finish { load: None })
            }
            Input::Connected(_)
            | Input::Robot(_)
            | Input::RobotLost { .. }
            | Input::Confirmed
            | Input::Declined
            | Input::Resumed
            | Input::Watched(_) => None,
        }
    }

    fn is_done(&self) -> bool {
        matches!(self.state, State::Done(_))
    }

    fn into_outcome(self) -> Outcome {
        let end = match self.state {
            State::Done(end) => end,
            State::Watching { .. } | State::Capturing { .. } | State::Confirming { .. } => End::Cut,
        };
        Outcome { end, poses: self.poses, captures: self.captures, facts: None, display: None }
    }
}
