//! Exit codes: an interface.

use std::process::ExitCode;

use crate::calibration::gates::Status;
use crate::calibration::result::CalibrationResult;
use crate::config::ConfigError;
use crate::devices::RobotError;
use crate::devices::sim::cell::SimError;
use crate::plan::PlanError;
use crate::recording::import::ImportError;
use crate::runner::LiveError;
use crate::runner::setup::SetupError;
use crate::runner::solve::{SolveError, Solved};
use crate::session::End;

/// Printed under `--help`.
pub(super) const HELP: &str = "Exit codes: 0 ok, 1 error, 2 usage or configuration, 3 done with loss or warnings \
or inconclusive, 4 gate failed, 5 drift, 6 pre-flight failed, 7 locked, 8 operator needed, 130 interrupted";

/// How the program ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exit {
    /// All is well.
    Ok,
    /// Something broke.
    Error,
    /// The command or a file is wrong.
    Usage,
    /// Done, with loss or warnings, or inconclusive.
    Warnings,
    /// A gate failed.
    GateFailed,
    /// Pre-flight failed; the arm has not moved.
    PreflightFailed,
    /// An operator must look.
    OperatorNeeded,
    /// The user stopped it.
    Interrupted,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(match exit {
            Exit::Ok => 0,
            Exit::Error => 1,
            Exit::Usage => 2,
            Exit::Warnings => 3,
            Exit::GateFailed => 4,
            Exit::PreflightFailed => 6,
            Exit::OperatorNeeded => 8,
            Exit::Interrupted => 130,
        })
    }
}

/// A wrong file or option is a usage error, everything else an error.
pub(super) fn of_error(error: &anyhow::Error) -> Exit {
    let wrong = error.chain().any(|cause| {
        let setup = match cause.downcast_ref::<SolveError>() {
            Some(SolveError::Setup(setup)) => Some(setup),
            _ => cause.downcast_ref::<SetupError>(),
        };
        let of_user = setup.is_some_and(|s| !matches!(s, SetupError::Recording(_)));
        let of_map =
            matches!(cause.downcast_ref::<ImportError>(), Some(ImportError::Map(_) | ImportError::NoMap { .. }));
        of_user || of_map || cause.is::<ConfigError>() || cause.is::<PlanError>() || cause.is::<UsageError>()
    });
    // The arm stands where it was stopped.
    if error.chain().any(|cause| cause.is::<LiveError>()) {
        return Exit::OperatorNeeded;
    }
    let unconnected = error.chain().any(|cause| cause.is::<ConnectError>() || cause.is::<CameraOpenError>());
    match (wrong, unconnected) {
        (true, _) => Exit::Usage,
        (false, true) => Exit::PreflightFailed,
        (false, false) => Exit::Error,
    }
}

/// The user asked for something that cannot be.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(super) struct UsageError(pub(super) String);

/// The robot could not be connected: nothing has moved, which is what a failed pre-flight means.
#[derive(Debug, thiserror::Error)]
#[error("pre-flight failed; the arm has not been moved:\n  connection: {0}")]
pub(super) struct ConnectError(pub(super) RobotError);

/// A camera could not be opened: nothing has moved.
#[derive(Debug, thiserror::Error)]
#[error("pre-flight failed; nothing has been moved:\n  frame camera: {0}")]
pub(super) struct CameraOpenError(pub(super) String);

impl ConnectError {
    /// Of the simulated cell, whose other errors are its own.
    pub(super) fn of_sim(error: SimError) -> anyhow::Error {
        match error {
            SimError::Robot(error) => Self(error).into(),
            other => other.into(),
        }
    }
}

/// How a solved session ends: the worst of how it was run and what the gates say.
///
/// A replay says what the recording holds, not how the live session ended.
pub(super) fn of_session(solved: &Solved, live: bool) -> Exit {
    let ended = if live { of_end(&solved.end) } else { None };
    ended.unwrap_or_else(|| of_result(&solved.result))
}

/// How a session that did not run to its end ends the program.
pub(super) fn of_end(end: &End) -> Option<Exit> {
    match end {
        End::PreflightFailed(_) => Some(Exit::PreflightFailed),
        End::OperatorNeeded(_) => Some(Exit::OperatorNeeded),
        End::Interrupted => Some(Exit::Interrupted),
        End::Aborted(_) => Some(Exit::Error),
        End::Complete | End::Cut => None,
    }
}

/// What a result says by itself.
pub(super) fn of_result(result: &CalibrationResult) -> Exit {
    match result.verdict.status {
        Status::Fail => Exit::GateFailed,
        Status::Inconclusive => Exit::Warnings,
        Status::Pass if !result.warnings.is_empty() => Exit::Warnings,
        Status::Pass => Exit::Ok,
    }
}
