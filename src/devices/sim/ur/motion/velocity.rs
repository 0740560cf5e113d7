//! Commanded speeds: `speedj`, `speedl` and `servoj`.

use super::{EQUIVALENT_RADIUS_M, MAX_JOINT_SPEED_RAD_S, Motion, Pace, PathFault, TICK_S, largest};
use crate::geometry::kinematics::Joints;

/// How fast the drives follow a servo target, rad/s2.
pub(in super::super) const SERVO_RAD_S2: f64 = 40.0;

/// Speed below which a joint counts as standing, rad/s.
const STANDING_RAD_S: f64 = 1e-9;

/// Distance at which a servo target counts as reached, rad.
const REACHED_RAD: f64 = 1e-6;

/// What is commanded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in super::super) enum Goal {
    /// Joint speeds, rad/s.
    JointSpeed(Joints),
    /// Speed of the TCP in `base`, m/s and rad/s.
    TcpSpeed([f64; 6]),
    /// Joint positions, rad, to be approached within about this time.
    Position { joints: Joints, lookahead_s: f64 },
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Speeding {
    goal: Goal,
    /// In rad/s2 of the leading joint, or in m/s2 for a speed of the TCP.
    acceleration: f64,
    reached: bool,
}

impl Motion {
    /// Follows a commanded speed from the speed of now; a path that was followed is forgotten.
    pub(in super::super) fn start_speed(&mut self, goal: Goal, acceleration: f64) {
        if !self.is_busy() {
            self.unsettle();
        }
        self.path = None;
        self.speeding = Some(Speeding { goal, acceleration, reached: false });
        (self.pace, self.rate) = (Pace::Follow, 1.0);
    }

    /// Whether the commanded speed is there, or none is commanded any more.
    pub(in super::super) fn has_reached_speed(&self) -> bool {
        self.speeding.is_none_or(|s| s.reached)
    }

    /// One cycle of a commanded speed.
    pub(super) fn speed_on(&mut self, speed_fraction: f64) -> Result<(), PathFault> {
        let Some(mut speeding) = self.speeding else { return Ok(()) };
        let (wanted, step) = match self.pace {
            Pace::Follow => self.wanted(&speeding, speed_fraction).inspect_err(|_| self.came_to_rest())?,
            Pace::Pause { .. } | Pace::Stop { .. } => ([0.0; 6], self.braking_rad_s2 * TICK_S),
        };
        let change: Joints = std::array::from_fn(|i| wanted[i] - self.target_speed[i]);
        let share = if largest(&change) > step { step / largest(&change) } else { 1.0 };
        speeding.reached = share >= 1.0;
        let before = self.target_speed;
        let speed: Joints = std::array::from_fn(|i| before[i] + share * change[i]);
        let next: Joints = std::array::from_fn(|i| self.target[i] + TICK_S * speed[i]);
        self.check(&next, &speed).inspect_err(|_| self.came_to_rest())?;
        (self.target, self.target_speed, self.speeding) = (next, speed, Some(speeding));
        let stands = largest(&speed) < STANDING_RAD_S && speeding.reached;
        if stands && !matches!(self.pace, Pace::Pause { .. }) && self.is_done(&speeding.goal) {
            self.came_to_rest();
            self.start_ring(&before);
        }
        Ok(())
    }

    /// Joint speeds that are asked for, and by how much they may change in this cycle, rad/s.
    fn wanted(&self, speeding: &Speeding, speed_fraction: f64) -> Result<(Joints, f64), PathFault> {
        let step = speeding.acceleration * TICK_S;
        match &speeding.goal {
            Goal::JointSpeed(speeds) => Ok((speeds.map(|v| v * speed_fraction), step)),
            Goal::Position { joints, lookahead_s } => {
                let near = self.is_done(&speeding.goal);
                let speed = |i: usize| if near { 0.0 } else { (joints[i] - self.target[i]) / lookahead_s.max(TICK_S) };
                let limited = |v: f64| v.clamp(-MAX_JOINT_SPEED_RAD_S, MAX_JOINT_SPEED_RAD_S);
                Ok((std::array::from_fn(|i| limited(speed(i))), step))
            }
            Goal::TcpSpeed(twist) => {
                let wanted = self.joint_speeds(&twist.map(|v| v * speed_fraction))?;
                let change: Joints = std::array::from_fn(|i| wanted[i] - self.target_speed[i]);
                let [x, y, z, rx, ry, rz] = self.tcp_speed(&self.target, &change);
                let turning = EQUIVALENT_RADIUS_M * (rx * rx + ry * ry + rz * rz).sqrt();
                let size = (x * x + y * y + z * z).sqrt().max(turning);
                // The same share of the change in joints as in space.
                let step = if size > step { largest(&change) * step / size } else { f64::INFINITY };
                Ok((wanted, step))
            }
        }
    }

    /// Joint speeds for a speed of the TCP.
    fn joint_speeds(&self, twist: &[f64; 6]) -> Result<Joints, PathFault> {
        let singular = || PathFault("a commanded speed of the TCP leads through a singularity".into());
        let angular = nalgebra::Vector3::new(twist[3], twist[4], twist[5]);
        let lever = self.arm.forward(&self.target).rotation() * self.flange_from_tcp.iso().translation.vector;
        let linear = nalgebra::Vector3::new(twist[0], twist[1], twist[2]) - angular.cross(&lever);
        let at_flange = nalgebra::Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z);
        let speeds = self.arm.jacobian(&self.target).lu().solve(&at_flange).ok_or_else(singular)?;
        Ok(std::array::from_fn(|i| speeds[i]))
    }

    fn check(&self, next: &Joints, speed: &Joints) -> Result<(), PathFault> {
        let slow = speed.iter().all(|v| v.abs() <= MAX_JOINT_SPEED_RAD_S);
        if !slow {
            return Err(PathFault(format!("a joint would move at {:.2} rad/s", largest(speed))));
        }
        let inside = next.iter().zip(&self.arm.joints).all(|(q, j)| *q >= j.limits_rad[0] && *q <= j.limits_rad[1]);
        if inside { Ok(()) } else { Err(PathFault("a joint would leave its limits".into())) }
    }

    fn is_done(&self, goal: &Goal) -> bool {
        match goal {
            Goal::Position { joints, .. } if self.pace == Pace::Follow => {
                (0..6).all(|i| (joints[i] - self.target[i]).abs() < REACHED_RAD)
            }
            Goal::Position { .. } | Goal::JointSpeed(_) | Goal::TcpSpeed(_) => true,
        }
    }
}
