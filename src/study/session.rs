//! One simulated session, recorded as any other, and what was true at each of its poses.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::StudyError;
use crate::config::{EventDriver, FrameDriver, RobotDriver};
use crate::devices::Clock;
use crate::devices::sim::cell::{SimCell, SimStart};
use crate::geometry::{Base, Flange, Transform};
use crate::recording::{About, FORMAT_VERSION, Kind, Writer};
use crate::runner::setup::{CellTexts, Planned};
use crate::runner::solve::sha256;
use crate::runner::{Devices, Live, Nobody, Told};
use crate::session::{Command, End};

/// A session that was recorded, and the cell that it was recorded on.
pub(super) struct Recorded {
    pub(super) sim: SimCell,
    /// True pose of the flange at every captured pose, by index of the pose.
    pub(super) base_from_flange: BTreeMap<usize, Transform<Base, Flange>>,
    pub(super) planned: Planned,
}

/// Runs a session in simulated time and leaves its recording at `path`.
pub(super) fn record(texts: &CellTexts, seed: u64, path: &Path) -> Result<Recorded, StudyError> {
    static NEVER: AtomicBool = AtomicBool::new(false);
    let planned = texts.plan()?;
    refuse(&planned)?;
    let Planned { cell, setup, .. } = &planned;
    let sim = SimCell::start_at(cell, Some(seed), f64::INFINITY, SimStart::default())?;
    let clock: Arc<dyn Clock> = Arc::new(sim.clock.clone());
    let robot = sim.robot()?;
    let devices = Devices { robot, frame: sim.frame(), event: sim.event(), clock };
    let writer = Writer::create(path, &about(texts, seed), &texts.attachments())?;
    let (truth, mut base_from_flange) = (sim.controller.truth(), BTreeMap::new());
    let mut hear = |told: Told<'_>| {
        if let Told::Command(Command::Capture { pose, .. }) = told
            && let Some(at) = truth.newest_s().and_then(|now_s| truth.base_from_flange_at(now_s))
        {
            base_from_flange.insert(*pose, at);
        }
    };
    let mut operator = Nobody;
    let timing = (cell.images_per_pose, setup.image_period_s);
    let live = Live::new(devices, writer, timing, &NEVER, &mut operator, &mut hear)?;
    let mut live = live.expecting(&cell.display);
    let outcome = setup.machine.clone().run(&mut live)?;
    live.into_recording()?;
    if outcome.end != End::Complete {
        return Err(StudyError::Ended { cell: cell.name.clone(), seed, why: format!("{:?}", outcome.end) });
    }
    Ok(Recorded { sim, base_from_flange, planned })
}

fn refuse(planned: &Planned) -> Result<(), StudyError> {
    let cell = &planned.cell;
    let why = if cell.robot.driver != RobotDriver::Sim {
        "its robot is not simulated"
    } else if cell.rgb.as_ref().is_none_or(|c| c.driver != FrameDriver::Sim) {
        "it has no simulated frame camera"
    } else if cell.event.as_ref().is_none_or(|c| c.driver != EventDriver::Sim) {
        "it has no simulated event camera"
    } else {
        return Ok(());
    };
    Err(StudyError::Cell { cell: cell.name.clone(), why: why.into() })
}

fn about(texts: &CellTexts, seed: u64) -> About {
    let facts = [
        ("cell_sha256".to_owned(), sha256(texts.cell.1.as_bytes())),
        ("robot".to_owned(), "simulated UR5e over RTDE and URScript".to_owned()),
        ("sim_seed".to_owned(), seed.to_string()),
    ];
    About {
        format_version: FORMAT_VERSION,
        kind: Kind::Live,
        session_id: format!("study-{seed}"),
        program_version: env!("CARGO_PKG_VERSION").into(),
        facts: facts.into(),
    }
}
