//! The way to a pose: found, checked for joint limits and keep-out boxes, slowed to the caps, timed.

use super::reach::{base_from_tcp, distance_rad, joints_at, limits_rad, within};
use super::stops::Goal;
use super::{Clearance, MoveTarget, PlannedMove, Refusal, way};
use crate::config::{Cell, Motion, MotionLimits};
use crate::geometry::{
    Base, Tcp, Transform,
    kinematics::{Arm, Joints},
};

/// One move.
pub(super) struct Leg {
    pub(super) target: MoveTarget,
    pub(super) joints_rad: Joints,
    pub(super) base_from_tcp: Transform<Base, Tcp>,
    pub(super) duration_s: f64,
}

/// Plans the move from `now_rad` to `goal`.
pub(super) fn leg(
    cell: &Cell,
    arm: &Arm,
    clearance: &Clearance,
    now_rad: &Joints,
    goal: &Goal,
    motion: Motion,
) -> Result<Leg, Refusal> {
    let base_from_tcp = match goal {
        Goal::Joints(joints) => base_from_tcp(cell, arm, joints),
        Goal::Tcp(pose) => *pose,
    };
    let way = match (motion, goal) {
        (Motion::Joint, Goal::Joints(joints)) => way::joint(now_rad, &within(joints, &limits_rad(cell, arm), arm)?),
        (Motion::Joint, Goal::Tcp(pose)) => way::joint(now_rad, &joints_at(cell, arm, pose, now_rad)?),
        (Motion::Linear, _) => way::linear(arm, &cell.robot.tcp_offset, now_rad, &base_from_tcp)?,
    };
    let joints_rad = *way.last().unwrap_or(now_rad);
    let caps = Caps::of(cell, arm, &way);
    let (target, duration_s) = match motion {
        Motion::Joint => {
            clearance.joint_path(now_rad, &joints_rad)?;
            caps.joint(&cell.robot.limits, joints_rad)
        }
        Motion::Linear => {
            clearance.along(&way)?;
            caps.linear(&cell.robot.limits, base_from_tcp)
        }
    };
    Ok(Leg { target, joints_rad, base_from_tcp, duration_s })
}

/// Plans a joint move at `speed_factor` of the speed caps, 0.01 to 1; beyond, the nearer of the two.
pub(super) fn joint_move(
    cell: &Cell,
    arm: &Arm,
    clearance: &Clearance,
    [from, to]: [&Joints; 2],
    speed_factor: f64,
) -> Result<PlannedMove, Refusal> {
    clearance.joint_path(from, to)?;
    // What is no number is slow.
    let factor = if speed_factor.is_nan() { 0.01 } else { speed_factor.clamp(0.01, 1.0) };
    let limits = MotionLimits {
        joint_speed_rad_s: factor * cell.robot.limits.joint_speed_rad_s,
        tcp_speed_m_s: factor * cell.robot.limits.tcp_speed_m_s,
        ..cell.robot.limits.clone()
    };
    let (target, move_s) = Caps::of(cell, arm, &way::joint(from, to)).joint(&limits, *to);
    Ok(PlannedMove { target, move_s })
}

/// Standing still and capturing at a pose, seconds.
pub(super) fn pause_s(cell: &Cell) -> f64 {
    let images = f64::from(cell.images_per_pose);
    let capture_s = cell.rgb.as_ref().map_or(0.1 * images, |c| (images - 1.0) / c.images_per_s + c.exposure_s);
    cell.robot.stillness.window_s + capture_s
}

/// A straight line that turns by 1 rad is taken to last as long as one of this length, m [assumed].
const TURN_RADIUS_M: f64 = 0.2;

/// What the fastest stretch of a way asks of joints and TCP.
struct Caps {
    /// Largest turn of a joint over the whole way, rad.
    turn_rad: f64,
    /// Length and turn of the TCP over the whole way, m and rad.
    tcp: [f64; 2],
    /// Way of the TCP per turn of the leading joint of the whole move, m/rad, at its fastest.
    tcp_m_per_rad: f64,
    /// Turn of a joint per way of the TCP, rad/m, at its fastest.
    joint_rad_per_m: f64,
}

impl Caps {
    fn of(cell: &Cell, arm: &Arm, way: &[Joints]) -> Self {
        let poses: Vec<_> = way.iter().map(|q| base_from_tcp(cell, arm, q)).collect();
        let steps = way.len().saturating_sub(1).max(1) as f64;
        let ends = || way.first().zip(way.last());
        let turn_rad = ends().map_or(0.0, |(a, b)| distance_rad(a, b));
        let tcp = poses.first().zip(poses.last()).map_or([0.0; 2], |(a, b)| [a.distance_to_m(b), a.angle_to_rad(b)]);
        let longest_m = poses.windows(2).map(|p| p[0].distance_to_m(&p[1])).fold(0.0, f64::max);
        let farthest_rad = way.windows(2).map(|q| distance_rad(&q[0], &q[1])).fold(0.0, f64::max);
        Self {
            turn_rad,
            tcp,
            tcp_m_per_rad: longest_m * steps / turn_rad.max(1e-9),
            joint_rad_per_m: farthest_rad * steps / tcp[0].max(1e-9),
        }
    }

    /// A `movej` slow enough for the TCP as well.
    fn joint(&self, limits: &MotionLimits, joints_rad: Joints) -> (MoveTarget, f64) {
        let per_rad = self.tcp_m_per_rad.max(1e-9);
        let speed_rad_s = limits.joint_speed_rad_s.min(limits.tcp_speed_m_s / per_rad);
        let acceleration_rad_s2 = limits.joint_acceleration_rad_s2.min(limits.tcp_acceleration_m_s2 / per_rad);
        let duration_s = trapezoid_s(self.turn_rad, speed_rad_s, acceleration_rad_s2);
        (MoveTarget::Joint { joints_rad, speed_rad_s, acceleration_rad_s2 }, duration_s)
    }

    /// A `movel` slow enough for every joint as well.
    fn linear(&self, limits: &MotionLimits, base_from_tcp: Transform<Base, Tcp>) -> (MoveTarget, f64) {
        let [length_m, turn_rad] = self.tcp;
        // A turn on the spot has no way to slow down along; the controller limits it by its own.
        let per_m = if length_m > 1e-4 { self.joint_rad_per_m.max(1e-9) } else { 1e-9 };
        let speed_m_s = limits.tcp_speed_m_s.min(limits.joint_speed_rad_s / per_m);
        let acceleration_m_s2 = limits.tcp_acceleration_m_s2.min(limits.joint_acceleration_rad_s2 / per_m);
        // A turn is slowed down with the way: a deadline must allow for it.
        let way_m = length_m.max(TURN_RADIUS_M * turn_rad);
        let straight_s = trapezoid_s(way_m, speed_m_s, acceleration_m_s2);
        let turning_s = trapezoid_s(turn_rad, limits.joint_speed_rad_s, limits.joint_acceleration_rad_s2);
        let target = MoveTarget::Linear { tcp_pose: base_from_tcp.pose_vector(), speed_m_s, acceleration_m_s2 };
        (target, straight_s.max(turning_s))
    }
}

/// Time for a distance from rest to rest, seconds.
fn trapezoid_s(distance: f64, speed: f64, acceleration: f64) -> f64 {
    if distance * acceleration >= speed * speed {
        distance / speed + speed / acceleration
    } else {
        2.0 * (distance / acceleration).sqrt()
    }
}
