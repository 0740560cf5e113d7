//! Where a move ends, and how it is called.

use crate::geometry::Transform;
use crate::session::route::{Leg, Node};
use crate::session::types::{MoveTarget, RobotSample};

/// A move ends this near to where it was sent: joints in rad, or TCP in m and rad.
const ARRIVED_RAD: f64 = 0.01;
const ARRIVED_M: f64 = 0.002;

/// Whether a move has ended where it was sent; NaN has not.
pub(super) fn has_arrived(target: &MoveTarget, sample: &RobotSample) -> Result<(), String> {
    match target {
        MoveTarget::Joint { joints_rad, .. } => {
            let far = joints_rad.iter().zip(&sample.joints_rad).map(|(a, b)| (a - b).abs());
            let near = far.clone().all(|d| d <= ARRIVED_RAD);
            let most = far.fold(0.0, f64::max).to_degrees();
            if near { Ok(()) } else { Err(format!("a joint ended {most:.2} deg from where it was sent")) }
        }
        MoveTarget::Linear { tcp_pose, .. } => {
            let wanted = Transform::from_pose_vector(*tcp_pose);
            let is = sample.base_from_tcp();
            let (metres, radians) = (wanted.distance_to_m(&is), wanted.angle_to_rad(&is));
            let near = metres <= ARRIVED_M && radians <= ARRIVED_RAD;
            let (mm, deg) = (metres * 1e3, radians.to_degrees());
            if near { Ok(()) } else { Err(format!("the TCP ended {mm:.2} mm and {deg:.2} deg from where it was sent")) }
        }
    }
}

impl Leg {
    pub(super) fn described(&self) -> String {
        match (self.to, self.capture) {
            (Node::Home | Node::Elsewhere, _) => "home".into(),
            (Node::Pose(pose), true) => format!("pose {}", pose + 1),
            (Node::Pose(pose), false) => format!("past pose {}", pose + 1),
        }
    }
}
