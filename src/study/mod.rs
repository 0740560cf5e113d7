//! Experiments on the simulator through the ordinary pipeline, judged by the truth that only a simulator knows.
//!
//! Uses everything but `cli`. Start at [`accuracy`]: sessions of both set-ups, each solved by both methods.

pub mod accuracy;
mod errors;
mod session;

/// Why an experiment cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// The cell is not one that can be simulated.
    #[error("{cell}: {why}; a study needs a cell whose robot and cameras are simulated")]
    Cell {
        /// Name of the cell.
        cell: String,
        /// What is in the way.
        why: String,
    },
    /// A session could not be planned.
    #[error(transparent)]
    Setup(#[from] crate::runner::setup::SetupError),
    /// The simulated cell did not start.
    #[error(transparent)]
    Sim(#[from] crate::devices::sim::cell::SimError),
    /// A session broke off.
    #[error(transparent)]
    Live(#[from] crate::runner::LiveError),
    /// A recording could not be written.
    #[error(transparent)]
    Recording(#[from] crate::recording::RecordingError),
    /// A recording could not be solved.
    #[error(transparent)]
    Solve(#[from] crate::runner::solve::SolveError),
    /// A session did not end as it should.
    #[error("{cell}, seed {seed}: the session ended early: {why}")]
    Ended {
        /// Name of the cell.
        cell: String,
        /// Seed of the session.
        seed: u64,
        /// How it ended.
        why: String,
    },
    /// A file of results cannot be read or written.
    #[error("{path}: {why}")]
    File {
        /// Which.
        path: std::path::PathBuf,
        /// What went wrong.
        why: String,
    },
}
