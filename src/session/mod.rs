//! The session: what to do next, given what has happened. Sans-IO state machines.
//!
//! No I/O, no clock, no threads: time arrives with each input. Uses `geometry` and `config`. Start at
//! [`types`], the words that are logged; [`Live`] walks a trajectory,
//! [`Imported`] only collects, [`Salvage`] reads what damage has left.

mod handheld;
mod imported;
mod live;
mod modes;
mod preflight;
mod route;
mod salvage;
mod stillness;
mod teach;
pub mod types;

pub use handheld::{Handheld, HandheldRules};
pub use imported::Imported;
pub use live::{Live, Options, Watch};
pub use modes::{robot_mode_name, runtime_state_name, safety_mode_name};
pub use preflight::{Expected, Finding, findings as preflight_findings, start_finding};
pub use route::{Route, Stop, Ways};
pub use salvage::Salvage;
pub use stillness::Evidence;
pub use teach::{Advice, Light, Taken, TeachError, Teacher};
pub use types::{
    Captured, Command, Declared, ExecutorState, Exposure, Input, Kinematics, Look, MoveTarget, RobotFacts, RobotSample,
    Stamp, Watched,
};

use crate::events::blink::DisplayProof;
use crate::geometry::{Base, Tcp, Transform, kinematics::Joints};

/// What a state machine must do to be run.
pub trait Machine {
    /// The first command, if any.
    fn start(&mut self) -> Option<Command>;
    /// Advances by one input.
    fn handle(&mut self, at: Stamp, input: &Input) -> Option<Command>;
    /// Whether nothing more is to come.
    fn is_done(&self) -> bool;
    /// What is known when the inputs have ended.
    fn into_outcome(self) -> Outcome;
}

/// What a session came to.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// How it ended.
    pub end: End,
    /// One record for each pose of the trajectory, in order.
    pub poses: Vec<PoseRecord>,
    /// Start of every exposure of every capture, also of those that were repeated, in order of time.
    pub captures: Vec<Captured>,
    /// The controller as it described itself; absent without a robot.
    pub facts: Option<RobotFacts>,
    /// How the display blinked when it was watched last; absent where it was not.
    pub display: Option<DisplayProof>,
}

/// How a session ended.
#[derive(Debug, Clone, PartialEq)]
pub enum End {
    /// Every pose was visited.
    Complete,
    /// Pre-flight refused; the arm has not been moved.
    PreflightFailed(Vec<Finding>),
    /// The arm may not move; an operator must look.
    OperatorNeeded(String),
    /// Something broke.
    Aborted(String),
    /// The operator stopped it.
    Interrupted,
    /// The inputs end before the session does: the recording was cut.
    Cut,
}

/// What happened at one pose.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseRecord {
    /// Index of the capture in [`Outcome::captures`] that counts; absent where none does.
    pub capture: Option<usize>,
    /// Mean pose of the TCP through the exposures; absent where no robot pose is known.
    pub base_from_tcp: Option<Transform<Base, Tcp>>,
    /// Mean joint positions through the exposures, rad; absent where they are not known.
    pub joints_rad: Option<Joints>,
    /// How still the arm was through the exposures.
    pub evidence: Option<Evidence>,
    /// Why there is no capture, in words.
    pub skipped: Option<String>,
}

impl PoseRecord {
    fn not_reached() -> Self {
        let (base_from_tcp, joints_rad, evidence) = (None, None, None);
        Self { capture: None, base_from_tcp, joints_rad, evidence, skipped: Some("not reached".into()) }
    }
}
