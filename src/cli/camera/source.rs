//! Opens the cameras of a cell for looking: no robot is connected, a simulated arm stands still.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use super::Which;
use crate::cli::exit::UsageError;
use crate::cli::progress::say;
use crate::cli::{cameras, cell};
use crate::config::{Cell, EventDriver, FrameDriver, FrameTrigger, RobotDriver};
use crate::devices::sim::hand::SimHand;
use crate::devices::sim::still::SimStill;
use crate::devices::{CameraFacts, Clock, EventCamera, FrameCamera, WallClock, pause};
use crate::geometry::Camera;
use crate::geometry::kinematics::Joints;
use crate::runner::setup::CellTexts;
use crate::runner::{Looking, Rest, RunOptions};
use crate::session::Stamp;

/// How long to wait before real cameras are asked again.
const REST: Duration = Duration::from_millis(5);

/// The cameras of a cell, for looking.
pub(super) struct Source {
    pub(super) cell: Cell,
    /// The cameras that are there, as they described themselves.
    pub(super) facts: Vec<(Camera, CameraFacts)>,
    pub(super) looking: Looking,
}

/// What simulated cameras give.
struct Simulated {
    frame: Option<Box<dyn FrameCamera>>,
    event: Option<Box<dyn EventCamera>>,
    clock: Arc<dyn Clock>,
    rest: Rest,
}

impl Source {
    /// Opens those cameras of the cell that are asked for.
    pub(super) fn open(file: &Path, which: Which) -> anyhow::Result<Self> {
        let texts = cell::load(file)?;
        let mut cell = crate::config::parse_cell(&texts.cell.1, &texts.cell.0)?;
        free_running(&mut cell);
        let wants_frame = which.has(Camera::Rgb) && cell.rgb.is_some();
        let wants_event = which.has(Camera::Event) && cell.event.is_some();
        if !(wants_frame || wants_event) {
            return Err(UsageError(format!("{}: the cell has no such camera", file.display())).into());
        }
        let frame_driver = cell.rgb.as_ref().map(|c| c.driver).filter(|_| wants_frame);
        let event_driver = cell.event.as_ref().map(|c| c.driver).filter(|_| wants_event);
        let simulated = frame_driver == Some(FrameDriver::Sim) || event_driver == Some(EventDriver::Sim);
        let Simulated { mut frame, mut event, clock, rest } = if simulated { simulate(&cell, &texts)? } else { real() };
        frame = frame.filter(|_| wants_frame);
        event = event.filter(|_| wants_event);
        if let Some(rgb) = cell.rgb.as_ref().filter(|c| wants_frame && c.driver != FrameDriver::Sim) {
            frame = Some(cameras::open_frame(file, rgb, Arc::clone(&clock))?);
        }
        if let Some(of_cell) = cell.event.as_ref().filter(|c| wants_event && c.driver != EventDriver::Sim) {
            event = Some(cameras::open_event(file, of_cell, Arc::clone(&clock))?);
        }
        let of_frame = frame.as_ref().map(|frame| (Camera::Rgb, frame.facts()));
        let of_event = event.as_ref().map(|event| (Camera::Event, event.facts()));
        let facts = of_frame.into_iter().chain(of_event).collect();
        let period_s = cell.rgb.as_ref().map_or(0.1, |rgb| 1.0 / rgb.images_per_s);
        let channel = cell.event.as_ref().map_or(0, |event| event.trigger_channel);
        let looking = Looking::new((frame, event, clock, rest), period_s, channel);
        Ok(Self { cell, facts, looking })
    }

    /// The cameras that are there.
    pub(super) fn cameras(&self) -> Vec<Camera> {
        self.facts.iter().map(|(camera, _)| *camera).collect()
    }
}

/// A camera that waits for the robot would show nothing.
fn free_running(cell: &mut Cell) {
    if let Some(rgb) = cell.rgb.as_mut().filter(|rgb| matches!(rgb.trigger, FrameTrigger::RobotOutput(_))) {
        say("note: the frame camera runs freely here; pulses of the robot trigger it in sessions only");
        rgb.trigger = FrameTrigger::FreeRun;
    }
}

fn real() -> Simulated {
    let clock = Arc::new(WallClock::starting_at(Stamp::default()));
    Simulated { frame: None, event: None, clock, rest: Box::new(|| pause(REST)) }
}

fn simulate(cell: &Cell, texts: &CellTexts) -> anyhow::Result<Simulated> {
    if cell.robot.driver == RobotDriver::None {
        let hand = SimHand::start(cell, None, 1.0)?;
        let clock = Arc::new(hand.clock.clone());
        return Ok(Simulated { frame: hand.frame(), event: hand.event(), clock, rest: hand.rest() });
    }
    let (joints_rad, place) = standing(cell, texts);
    say(&format!("note: the arm is simulated and stands at {place}"));
    let still = SimStill::start(cell, None, &joints_rad)?;
    let clock = Arc::new(still.clock.clone());
    Ok(Simulated { frame: still.frame(), event: still.event(), clock, rest: still.rest() })
}

/// Home, or the first pose where the cameras do not see the board from home.
fn standing(cell: &Cell, texts: &CellTexts) -> (Joints, String) {
    // A cell whose poses are still to be corrected is looked at all the same.
    let planned = texts.plan_with(&RunOptions::default()).ok();
    let first = planned.as_ref().filter(|p| !p.plan.home_sees_board).and_then(|p| p.plan.poses.first());
    match first {
        Some(pose) => (pose.joints_rad, format!("the first pose, {}", pose.id)),
        None => (cell.robot.home_joints_rad, "home".into()),
    }
}
