//! Devices at the edge: the traits, one folder per driver, and the simulated cell.
//!
//! Drivers never name each other; traits carry no vendor words. Uses `session` for the words that are
//! logged. Start at [`Robot`].

use crate::session::{MoveTarget, RobotSample, Stamp};

/// A robot arm.
///
/// The caller must call [`Robot::heartbeat`] after judging every sample: when heartbeats stop, the
/// controller stops the arm by itself.
pub trait Robot: Send {
    /// Waits for the next sample.
    fn next_sample(&mut self) -> Result<(Stamp, RobotSample), RobotError>;
    /// Starts a move and returns its sequence number at once; progress arrives through the samples.
    fn start_move(&mut self, target: &MoveTarget) -> Result<i32, RobotError>;
    /// Says that the caller has judged the last sample and is alive.
    fn heartbeat(&mut self) -> Result<(), RobotError>;
    /// Stops as fast as the controller safely allows. Must work in every state.
    fn stop(&mut self) -> Result<(), RobotError>;
    /// Stops our program on the controller; the arm stays where it is.
    fn finish(&mut self) -> Result<(), RobotError>;
}

/// The session's clock.
pub trait Clock: Send + Sync {
    /// Time since the session began.
    fn now(&self) -> Stamp;
}

/// What a robot driver can fail with.
#[derive(Debug, thiserror::Error)]
pub enum RobotError {
    /// The connection could not be opened.
    #[error("cannot reach the robot at {address}: {why}; is the controller on, and is the service enabled?")]
    Unreachable {
        /// Where.
        address: String,
        /// The reason of the system.
        why: String,
    },
    /// Nothing new for too long.
    #[error("no state from the robot for {silent_s:.3} s; is the controller on and reachable?")]
    Silent {
        /// For how long, seconds.
        silent_s: f64,
    },
    /// The peer does not speak the protocol.
    #[error("the robot at {address} broke the protocol: {what}")]
    Protocol {
        /// Where.
        address: String,
        /// What was found and what was expected.
        what: String,
    },
    /// The controller said no.
    #[error("the controller refused {what}: {why}")]
    Refused {
        /// What was asked.
        what: String,
        /// The answer.
        why: String,
    },
    /// The connection broke.
    #[error("the connection to the robot at {address} broke: {why}")]
    Broken {
        /// Where.
        address: String,
        /// The reason of the system.
        why: String,
    },
}
