//! The way to a pose: sampled for keep-out boxes, slowed to the caps, timed.

use super::MoveTarget;
use super::Refusal;
use super::reach::{base_from_flange, base_from_tcp, distance_rad, joints_at, limits_rad, within};
use super::stops::Goal;
use crate::config::{Cell, KeepOut, Motion, MotionLimits, Mount};
use crate::geometry::{
    Base, Point, Target, Tcp, Transform,
    kinematics::{Arm, Joints},
};

/// One move, with the joint positions on the way.
pub(super) struct Leg {
    pub(super) target: MoveTarget,
    pub(super) joints_rad: Joints,
    pub(super) base_from_tcp: Transform<Base, Tcp>,
    pub(super) duration_s: f64,
    /// From the start to the end, both included.
    way: Vec<Joints>,
}

/// Plans the move from `now_rad` to `goal`.
pub(super) fn leg(cell: &Cell, arm: &Arm, now_rad: &Joints, goal: &Goal, motion: Motion) -> Result<Leg, Refusal> {
    let base_from_tcp = match goal {
        Goal::Joints(joints) => base_from_tcp(cell, arm, joints),
        Goal::Tcp(pose) => *pose,
    };
    let limits = limits_rad(cell, arm);
    let way = match (motion, goal) {
        (Motion::Joint, Goal::Joints(joints)) => joint_way(now_rad, &within(joints, &limits, arm)?),
        (Motion::Joint, Goal::Tcp(pose)) => joint_way(now_rad, &joints_at(cell, arm, pose, now_rad)?),
        (Motion::Linear, _) => linear_way(cell, arm, now_rad, &base_from_tcp)?,
    };
    let joints_rad = *way.last().unwrap_or(now_rad);
    within(&joints_rad, &limits, arm)?;
    let caps = Caps::of(cell, arm, &way);
    let (target, duration_s) = match motion {
        Motion::Joint => caps.joint(&cell.robot.limits, joints_rad),
        Motion::Linear => caps.linear(&cell.robot.limits, base_from_tcp),
    };
    Ok(Leg { target, joints_rad, base_from_tcp, duration_s, way })
}

/// Standing still and capturing at a pose, seconds.
pub(super) fn pause_s(cell: &Cell) -> f64 {
    let images = f64::from(cell.images_per_pose);
    let capture_s = cell.rgb.as_ref().map_or(0.1 * images, |c| (images - 1.0) / c.images_per_s + c.exposure_s);
    cell.robot.stillness.window_s + capture_s
}

/// Samples at least every 0.01 rad, which is 9 mm at full reach.
fn joint_way(from: &Joints, to: &Joints) -> Vec<Joints> {
    let steps = ((distance_rad(from, to) / 0.01).ceil() as u32).clamp(1, 1000);
    let at = |i: u32| std::array::from_fn(|k| from[k] + (to[k] - from[k]) * f64::from(i) / f64::from(steps));
    (0..=steps).map(at).collect()
}

/// Samples at least every 5 mm and 3 degrees; refused where a joint would jump.
fn linear_way(cell: &Cell, arm: &Arm, now_rad: &Joints, to: &Transform<Base, Tcp>) -> Result<Vec<Joints>, Refusal> {
    let from = base_from_tcp(cell, arm, now_rad);
    let steps = (from.distance_to_m(to) / 0.005).max(from.angle_to_rad(to) / 0.05).ceil().clamp(1.0, 1000.0) as u32;
    let mut way = vec![*now_rad];
    let mut joints = *now_rad;
    for i in 1..=steps {
        let base_from_tcp = from.interpolate(to, f64::from(i) / f64::from(steps));
        let next = arm.inverse(&base_from_flange(cell, &base_from_tcp), &joints).map_err(Refusal::OutOfReach)?;
        let smooth = distance_rad(&next, &joints) <= 0.3;
        if !smooth {
            return Err(Refusal::NoStraightLine);
        }
        joints = next;
        way.push(joints);
    }
    Ok(way)
}

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
        let straight_s = trapezoid_s(length_m, speed_m_s, acceleration_m_s2);
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

/// Refuses a move on which something enters a keep-out box.
pub(super) fn keep_out(cell: &Cell, arm: &Arm, leg: &Leg) -> Result<(), Refusal> {
    if cell.robot.keep_out.is_empty() {
        return Ok(());
    }
    for joints in &leg.way {
        for (part, at) in carried_points(cell, arm, joints) {
            let at_m = at.xyz_m();
            if let Some(keep_out) = cell.robot.keep_out.iter().find(|k| !is_outside(k, &at_m)) {
                return Err(Refusal::KeepOut { name: keep_out.name.clone(), part, at_m });
            }
        }
    }
    Ok(())
}

fn is_outside(keep_out: &KeepOut, at_m: &[f64; 3]) -> bool {
    (0..3).any(|i| at_m[i] < keep_out.min_m[i] || at_m[i] > keep_out.max_m[i])
}

/// The points of arm, tool and what it carries that must stay out of boxes, in `base`.
fn carried_points(cell: &Cell, arm: &Arm, joints: &Joints) -> Vec<(&'static str, Point<Base>)> {
    let base_from_tcp = base_from_tcp(cell, arm, joints);
    let frames = arm.joint_frames(joints);
    let wrist = ["elbow", "wrist 1", "wrist 2", "wrist 3"];
    let origins = frames[2..].iter().map(|frame| Point::assume_frame(frame.translation.vector.into()));
    let mut points: Vec<_> = wrist.into_iter().zip(origins).collect();
    points.push(("TCP", base_from_tcp * Point::origin()));
    match cell.nominal.mount {
        Mount::Target { tcp_from_target, .. } => {
            let [x, y] = cell.board.size_m();
            let corners = [[0.0, 0.0], [x, 0.0], [0.0, y], [x, y]];
            let corners = corners.map(|[x, y]| Point::<Target>::assume_frame([x, y, 0.0]));
            points.extend(corners.map(|corner| ("board", base_from_tcp * (tcp_from_target * corner))));
        }
        Mount::Cameras { tcp_from_camera, .. } => {
            points.push(("camera", base_from_tcp * (tcp_from_camera * Point::origin())));
        }
    }
    points
}
