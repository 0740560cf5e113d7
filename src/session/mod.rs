//! The session: what to do next, given what has happened. A sans-IO state machine.
//!
//! No I/O, no clock, no threads: time arrives with each input. Uses `geometry`, `config`, `plan`.
//! Start at [`types`], the words that are logged.

pub mod types;

pub use types::{Command, ExecutorState, Input, MoveTarget, RobotSample, Stamp};
