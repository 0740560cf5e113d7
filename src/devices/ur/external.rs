//! The handshake with a program of the plant that moves the arm: a sans-IO state machine.

use crate::config::{External, Line};
use crate::devices::rtde::Value;
use crate::session::{ExecutorState, RobotSample};

/// Who is waiting for whom.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// Nothing has been asked for.
    Idle,
    /// We have said `captured`; their program has not left the pose yet.
    Leaving,
    /// Their program is on its way.
    Arriving,
    /// Their program says that the arm is at the pose.
    AtPose,
}

/// Follows `at_pose` and says what `captured` must be.
#[derive(Debug)]
pub(super) struct Handshake {
    at_pose: Line,
    state: State,
    /// The pose that was asked for last, and the last that was reached.
    asked: i32,
    reached: i32,
}

impl Handshake {
    pub(super) fn new(external: &External) -> Self {
        Self { at_pose: external.at_pose, state: State::Idle, asked: 0, reached: 0 }
    }

    /// Asks for the next pose.
    pub(super) fn next(&mut self) -> i32 {
        self.asked = self.asked.checked_add(1).unwrap_or(1);
        self.state = match self.state {
            State::Idle => State::Arriving,
            State::Leaving | State::Arriving | State::AtPose => State::Leaving,
        };
        self.asked
    }

    /// Whether a pose has been asked for.
    pub(super) fn has_begun(&self) -> bool {
        self.state != State::Idle
    }

    /// Takes a sample in, and puts what the handshake says about the program into it.
    pub(super) fn judge(&mut self, sample: &mut RobotSample, extra: &[Value]) {
        let at_pose = match self.at_pose {
            Line::DigitalOutput(number) => sample.digital_outputs >> number & 1 == 1,
            Line::BitRegister(_) => extra.first() == Some(&Value::Bool(true)),
        };
        match (self.state, at_pose) {
            (State::Leaving, false) => self.state = State::Arriving,
            (State::Arriving, true) => (self.state, self.reached) = (State::AtPose, self.asked),
            (State::Idle | State::AtPose, _) | (State::Leaving, true) | (State::Arriving, false) => {}
        }
        sample.executor_sequence = self.reached;
        sample.executor_state = match (self.state, at_pose) {
            (State::Idle, _) => ExecutorState::Idle,
            (State::AtPose, true) => ExecutorState::Steady,
            // Left before we were done: never a pose to capture at.
            (State::AtPose, false) | (State::Leaving | State::Arriving, _) => ExecutorState::Moving,
        };
    }

    /// What `captured` must be now.
    pub(super) fn captured(&self) -> bool {
        self.state == State::Leaving
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::devices::ur::fields::tests::sample;

    fn external() -> External {
        External { at_pose: Line::DigitalOutput(5), captured: Line::DigitalOutput(2), patience_s: 60.0 }
    }

    fn judged(handshake: &mut Handshake, at_pose: bool) -> (i32, ExecutorState, bool) {
        let mut sample = sample();
        sample.digital_outputs = u64::from(at_pose) << 5;
        handshake.judge(&mut sample, &[]);
        (sample.executor_sequence, sample.executor_state, handshake.captured())
    }

    #[test]
    fn each_pose_is_entered_captured_and_left() {
        let mut handshake = Handshake::new(&external());
        assert_eq!(judged(&mut handshake, true), (0, ExecutorState::Idle, false));
        assert_eq!(handshake.next(), 1);
        assert_eq!(judged(&mut handshake, false), (0, ExecutorState::Moving, false));
        assert_eq!(judged(&mut handshake, true), (1, ExecutorState::Steady, false));
        assert_eq!(handshake.next(), 2);
        assert_eq!(judged(&mut handshake, true), (1, ExecutorState::Moving, true), "still at the pose before");
        assert_eq!(judged(&mut handshake, false), (1, ExecutorState::Moving, false));
        assert_eq!(judged(&mut handshake, true), (2, ExecutorState::Steady, false));
        assert_eq!(judged(&mut handshake, false), (2, ExecutorState::Moving, false), "it left without us");
    }

    #[test]
    fn a_register_stands_in_for_an_output() {
        let mut handshake = Handshake::new(&External { at_pose: Line::BitRegister(80), ..external() });
        handshake.next();
        let mut sample = sample();
        handshake.judge(&mut sample, &[Value::Bool(true)]);
        assert_eq!(sample.executor_state, ExecutorState::Steady);
    }
}
