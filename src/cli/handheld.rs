//! `cellcal run` for a cell without a robot: an operator moves the display or the cameras by hand.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use super::cameras;
use super::exit::UsageError;
use super::progress::say;
use crate::config::{Cell, EventDriver, FrameDriver};
use crate::devices::sim::hand::SimHand;
use crate::devices::{Clock, EventCamera, FrameCamera, WallClock, pause};
use crate::runner::{Rest, Told};
use crate::session::{Command, Stamp};

/// Rings the bell of the terminal: whoever holds the board may look elsewhere.
const BELL: &str = "\u{7}";

/// How long to wait before real cameras are asked again.
const REST: Duration = Duration::from_millis(5);

/// The cameras of a cell without a robot.
pub(super) struct Held {
    pub(super) frame: Option<Box<dyn FrameCamera>>,
    pub(super) event: Option<Box<dyn EventCamera>>,
    pub(super) clock: Arc<dyn Clock>,
    pub(super) rest: Rest,
}

/// Opens the cameras that the cell names.
pub(super) fn open(file: &Path, cell: &Cell, seed: Option<u64>, time_scale: Option<f64>) -> anyhow::Result<Held> {
    let event = cell.event.as_ref().map(|c| c.driver);
    let frame = cell.rgb.as_ref().filter(|c| c.driver != FrameDriver::Sim);
    cameras::refuse_other_times(file, frame, time_scale)?;
    if let (Some(rgb), None) = (frame, event) {
        let clock: Arc<dyn Clock> = Arc::new(WallClock::starting_at(Stamp::default()));
        let frame = Some(cameras::open_frame(file, rgb, Arc::clone(&clock))?);
        return Ok(Held { frame, event: None, clock, rest: Box::new(|| pause(REST)) });
    }
    if frame.is_some() || event.is_some_and(|driver| driver != EventDriver::Sim) {
        let why = "without a robot either all cameras are simulated or none, and this version has no driver for real event cameras yet; `driver: sim` for both simulates them and the operator";
        return Err(UsageError(format!("{}: {why}", file.display())).into());
    }
    let sim = SimHand::start(cell, seed, time_scale.unwrap_or(1.0))?;
    let clock = Arc::new(sim.clock.clone());
    Ok(Held { frame: sim.frame(), event: sim.event(), clock, rest: sim.rest() })
}

/// Tells the operator what to do, and by a bell that a capture begins and has ended.
pub(super) fn hear(told: &Told<'_>) {
    match told {
        Told::Command(Command::Guide { advice }) => say(&format!("{BELL}{advice}")),
        Told::Command(Command::Capture { .. }) => say("keep still, capturing"),
        Told::Command(Command::Wait { .. }) => say("it moved during the capture: keep it still once more"),
        Told::Note(note) => say(&format!("warning: {note}")),
        Told::Command(
            Command::Confirm { .. }
            | Command::Start
            | Command::Watch
            | Command::Travel { .. }
            | Command::Move { .. }
            | Command::Stop { .. }
            | Command::Finish { .. },
        ) => {}
    }
}
