//! Exit codes: an interface.

use std::process::ExitCode;

use crate::calibration::gates::Status;
use crate::config::ConfigError;
use crate::plan::PlanError;
use crate::runner::setup::SetupError;
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

/// A wrong file is a usage error, everything else an error.
pub(super) fn of_error(error: &anyhow::Error) -> Exit {
    let wrong_file = error.chain().any(|cause| {
        cause.is::<ConfigError>() || cause.is::<PlanError>() || cause.is::<UsageError>() || is_setup_of_files(cause)
    });
    if wrong_file { Exit::Usage } else { Exit::Error }
}

fn is_setup_of_files(cause: &(dyn std::error::Error + 'static)) -> bool {
    let Some(setup) = cause.downcast_ref::<SetupError>() else { return false };
    match setup {
        SetupError::Config(_)
        | SetupError::Plan(_)
        | SetupError::Model { .. }
        | SetupError::Intrinsics { .. }
        | SetupError::Override { .. } => true,
        SetupError::Recording(_) => false,
    }
}

/// The user asked for something that cannot be.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(super) struct UsageError(pub(super) String);

/// How a solved session ends: the worst of how it was run and what the gates say.
pub(super) fn of_session(end: &End, status: Status, damaged: bool) -> Exit {
    match end {
        End::PreflightFailed(_) => return Exit::PreflightFailed,
        End::OperatorNeeded(_) => return Exit::OperatorNeeded,
        End::Interrupted => return Exit::Interrupted,
        End::Aborted(_) => return Exit::Error,
        End::Complete | End::Cut => {}
    }
    match status {
        Status::Fail => Exit::GateFailed,
        Status::Inconclusive => Exit::Warnings,
        Status::Pass if damaged || *end == End::Cut => Exit::Warnings,
        Status::Pass => Exit::Ok,
    }
}
