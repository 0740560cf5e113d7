//! An imported session: its state machine only collects what the source declares.

use super::types::{Captured, Command, Input, Stamp};
use super::{End, Evidence, Machine, Outcome, PoseRecord};

/// Collects the captures of an imported session.
#[derive(Debug)]
pub struct Imported {
    poses: Vec<PoseRecord>,
    captures: Vec<Captured>,
}

impl Imported {
    /// A session of `poses` poses.
    pub fn new(poses: usize) -> Self {
        Self { poses: vec![PoseRecord::not_reached(); poses], captures: Vec::new() }
    }
}

impl Machine for Imported {
    fn start(&mut self) -> Option<Command> {
        None
    }

    fn handle(&mut self, _at: Stamp, input: &Input) -> Option<Command> {
        let Input::Captured(captured) = input else { return None };
        if let Some(record) = self.poses.get_mut(captured.pose) {
            let declared = captured.declared.as_ref();
            let evidence = |still: [f64; 2]| Evidence {
                source: "declared by source".into(),
                from_s: still[0],
                to_s: still[1],
                samples: None,
                max_joint_speed_rad_s: None,
                max_joint_spread_rad: None,
                max_tcp_speed_m_s: None,
            };
            *record = PoseRecord {
                capture: Some(self.captures.len()),
                base_from_tcp: declared.and_then(|d| d.base_from_tcp),
                joints_rad: declared.and_then(|d| d.joints_rad),
                evidence: declared.and_then(|d| d.still_s).map(evidence),
                skipped: None,
            };
        }
        // Counted even where its pose is not of this session: images and events are counted with it.
        self.captures.push(captured.clone());
        None
    }

    fn is_done(&self) -> bool {
        false
    }

    fn into_outcome(self) -> Outcome {
        let all = self.poses.iter().all(|p| p.capture.is_some());
        let end = if all { End::Complete } else { End::Cut };
        Outcome { end, poses: self.poses, captures: self.captures, facts: None, display: None }
    }
}
