//! `cellcal camera`: what a person uses who mounts cameras. Nothing moves, no robot is connected.

mod grab;
mod list;
mod shown;
mod source;
mod stream;
mod terminal;

use clap::{Subcommand, ValueEnum};

use super::Exit;
use crate::geometry;

/// Looks for cameras and through them; nothing moves.
#[derive(Debug, Subcommand)]
pub(super) enum Camera {
    /// Lists the cameras that this build and this machine can see.
    List(list::List),
    /// Takes one image and one window of events, and says what to turn.
    Grab(grab::Grab),
    /// Shows what the cameras see, live, with corners and what to turn.
    Stream(stream::Stream),
}

impl Camera {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        match self {
            Self::List(command) => command.execute(),
            Self::Grab(command) => command.execute(),
            Self::Stream(command) => command.execute(),
        }
    }
}

/// Which cameras to look through.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Which {
    /// The frame camera.
    Rgb,
    /// The event camera.
    Event,
    /// Those that the cell has.
    Both,
}

impl Which {
    fn has(self, camera: geometry::Camera) -> bool {
        match self {
            Self::Both => true,
            Self::Rgb => camera == geometry::Camera::Rgb,
            Self::Event => camera == geometry::Camera::Event,
        }
    }
}
