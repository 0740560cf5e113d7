//! Simulated cameras before an arm that stands still: no controller, no motion; for mounting cameras.

use std::sync::Arc;

use super::cell::{SimError, whole_rig};
use super::hand::{REST_S, pause};
use super::rig::{Rig, SimEventCamera, SimFrameCamera, Whereabouts};
use super::ur::SimClock;
use crate::config::Cell;
use crate::devices::{EventCamera, FrameCamera};
use crate::geometry::kinematics::{Arm, Joints};

/// The cameras of a simulated cell whose arm does not move.
pub struct SimStill {
    /// Simulated time.
    pub clock: SimClock,
    rig: Arc<Rig>,
    has: [bool; 2],
    images_per_pose: u32,
}

impl SimStill {
    /// Draws the cell with the arm at these joint positions, by the nominal model of the arm.
    pub fn start(cell: &Cell, seed: Option<u64>, joints_rad: &Joints) -> Result<Self, SimError> {
        let seed = seed.or(cell.sim.as_ref().map(|s| s.seed)).unwrap_or(1);
        let clock = SimClock::default();
        let base_from_flange = Arm::ur5e().forward(joints_rad);
        let (rig, _) = whole_rig(cell, seed, Whereabouts::Still(base_from_flange), clock.clone())?;
        let has = [cell.rgb.is_some(), cell.event.is_some()];
        Ok(Self { clock, rig: Arc::new(rig), has, images_per_pose: cell.images_per_pose })
    }

    /// The frame camera, if the cell has one.
    pub fn frame(&self) -> Option<Box<dyn FrameCamera>> {
        self.has[0].then(|| Box::new(SimFrameCamera::new(Arc::clone(&self.rig))) as _)
    }

    /// The event camera, if the cell has one.
    pub fn event(&self) -> Option<Box<dyn EventCamera>> {
        let alone = (!self.has[0]).then_some(self.images_per_pose);
        self.has[1].then(|| Box::new(SimEventCamera::new(Arc::clone(&self.rig), alone)) as _)
    }

    /// Lets simulated time pass with real time, or slower, whenever somebody waits.
    pub fn rest(&self) -> Box<dyn FnMut()> {
        let clock = self.clock.clone();
        Box::new(move || {
            clock.advance(REST_S);
            pause(REST_S);
        })
    }
}
