//! Where a live session is.

use crate::session::End;
use crate::session::route::Leg;
use crate::session::types::Stamp;

/// Where a session is.
#[derive(Debug)]
pub(super) enum State {
    Preflight {
        seen: usize,
    },
    /// The operator is asked; then pre-flight goes on, or this leg.
    Asking(Option<Box<Leg>>),
    /// The display is watched: before anything moves, or at the first pose.
    Watching(Option<Moving>),
    Starting {
        since: Stamp,
    },
    Moving(Moving),
    Capturing {
        pose: usize,
        attempt: u32,
        decided: Stamp,
    },
    /// The last command was given; its end is recorded.
    Done(End),
}

/// A move and the rest after it.
#[derive(Debug)]
pub(super) struct Moving {
    pub(super) leg: Leg,
    pub(super) since: Option<Stamp>,
    pub(super) arrived: Option<Stamp>,
    pub(super) attempt: u32,
    /// Smallest position of the speed slider during the move.
    pub(super) slowest: f64,
}
