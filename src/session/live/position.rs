//! Where the arm is in terms of the trajectory, and how a session begins or goes on from there.

use std::collections::VecDeque;

use super::Live;
use crate::geometry::kinematics::Joints;
use crate::session::preflight::{self, Finding};
use crate::session::route::{Leg, Node, ON_WAY_RAD, SLOW, off_way_rad};
use crate::session::types::RobotSample;

/// The last place where the arm stood, and where it was sent from there.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Position {
    pub(super) node: Node,
    /// Measured there, rad.
    pub(super) node_joints: Joints,
    /// The last move.
    pub(super) leg: Option<Leg>,
}

impl Position {
    pub(super) fn at_start(joints: Joints) -> Self {
        Self { node: Node::Home, node_joints: joints, leg: None }
    }

    pub(super) fn leaves_for(&mut self, leg: &Leg) {
        self.leg = Some(leg.clone());
    }

    pub(super) fn reaches(&mut self, node: Node, joints: Joints) {
        (self.node, self.node_joints) = (node, joints);
    }
}

impl Live {
    /// The moves before the first capture, from where the arm is; the error is a finding, or nothing where only
    /// the operator can say that the arm may drive to the start.
    pub(super) fn where_from(&mut self, sample: &RobotSample) -> Result<VecDeque<Leg>, Option<Finding>> {
        let joints = sample.joints_rad;
        if self.expected.external {
            return Ok(VecDeque::new());
        }
        // A session that has never moved begins as a new one does.
        let on_route = self.resumed && self.position.node != Node::Elsewhere && self.position.leg.is_some();
        let back = if on_route { Some(self.back_on_the_way(&joints)) } else { None };
        if let Some(Ok(legs)) = back {
            return Ok(legs);
        }
        let near_start = preflight::start_finding(sample, &self.expected).is_none();
        if near_start {
            self.position = Position { node: Node::Home, node_joints: joints, leg: None };
            return self.legs_beside_start(&joints).map_err(Some);
        }
        if let Some(Err(off)) = back {
            return Err(Some(off));
        }
        let approach = self.slow_way("start_pose", &joints, self.route.start_joints_rad, Node::Home).map_err(Some)?;
        if !self.confirmed {
            return Err(None);
        }
        self.position = Position { node: Node::Elsewhere, node_joints: joints, leg: None };
        Ok(approach)
    }

    /// The first moves, checked from where the arm really is.
    fn legs_beside_start(&self, joints: &Joints) -> Result<VecDeque<Leg>, Finding> {
        let Some(pose) = self.next_missing() else { return Ok(VecDeque::new()) };
        let legs = self.route.to_pose(Node::Home, joints, pose).map(VecDeque::from);
        legs.map_err(|why| Finding::new("start_pose", format!("the arm cannot drive from where it is: it {why}")))
    }

    /// Back to the last place along the way on which the arm stopped.
    fn back_on_the_way(&self, joints: &Joints) -> Result<VecDeque<Leg>, Finding> {
        let Position { node, node_joints, leg } = self.position.clone();
        let goal = leg.map_or(node_joints, |leg| leg.joints_rad);
        let away = off_way_rad(joints, &node_joints, &goal);
        let near = away <= ON_WAY_RAD;
        if near {
            return self.slow_way("off_path", joints, node_joints, node);
        }
        Err(Finding::new(
            "off_path",
            format!(
                "the arm is {:.1} deg off the way on which it stopped, {:.1} deg allowed; jog it back there or to its home, then resume",
                away.to_degrees(),
                ON_WAY_RAD.to_degrees()
            ),
        ))
    }

    fn slow_way(&self, id: &str, from: &Joints, to: Joints, node: Node) -> Result<VecDeque<Leg>, Finding> {
        let away = from.iter().zip(&to).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        if away < 1e-3 {
            return Ok(VecDeque::new());
        }
        let way = self.route.ways.between(from, &to, SLOW);
        let (target, move_s) = way.map_err(|why| {
            Finding::new(id, format!("the arm cannot drive from where it is: it {why}; jog it to its home"))
        })?;
        Ok(VecDeque::from([Leg { to: node, capture: false, target, move_s, joints_rad: to }]))
    }
}
