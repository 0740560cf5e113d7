//! The one loop and its two worlds; then vision and calibration on what the session saw.
//!
//! [`run`] is the only loop: live it drives devices, in a replay it compares with the recording. `run` of
//! the program records, closes the file and solves by reading it back, as a replay does. Uses everything
//! above it.

mod capture;
mod event_windows;
mod handheld;
mod live;
mod look;
mod options;
mod past;
mod pixels;
mod replay;
pub mod setup;
pub mod solve;

pub use handheld::{CameraDevices, HandheldLive, Rest};
pub use live::{Devices, Live, LiveError, Nobody, Operator, Told};
pub use look::{EventLook, Looked, Looking};
pub use options::RunOptions;
pub use past::{Past, PastError};
pub use pixels::accumulated;
pub use replay::{Diverged, Replay};

use crate::session::{Command, Input, Machine, Outcome, Stamp};

/// Where inputs come from and where commands go.
pub trait World {
    /// Why it can fail.
    type Error;
    /// Carries out a command, or, in a replay, checks that it is the recorded one.
    fn execute(&mut self, command: &Command) -> Result<(), Self::Error>;
    /// The next input, stamped since the session began; `None` when the world has ended.
    fn next_input(&mut self) -> Result<Option<(Stamp, Input)>, Self::Error>;
    /// Whether inputs follow although the machine is done: a session that was resumed.
    fn goes_on(&self) -> bool {
        false
    }
    /// Called once at the end; a replay fails here where recorded commands are left over.
    fn finish(&mut self) -> Result<(), Self::Error>;
}

/// Runs a session to its end in `world`.
pub fn run<M: Machine, W: World>(mut machine: M, world: &mut W) -> Result<Outcome, W::Error> {
    drive(&mut machine, world)?;
    Ok(machine.into_outcome())
}

/// Runs a session as far as `world` goes; another world may follow.
pub fn drive<M: Machine, W: World>(machine: &mut M, world: &mut W) -> Result<(), W::Error> {
    let mut due = machine.start();
    loop {
        if let Some(command) = due.take() {
            world.execute(&command)?;
        }
        if machine.is_done() && !world.goes_on() {
            break;
        }
        let Some((at, input)) = world.next_input()? else { break };
        due = machine.handle(at, &input);
    }
    world.finish()
}
