//! Joint positions for a pose: several starting points, inside the limits, near where the arm is.

use std::f64::consts::{PI, TAU};

use super::Refusal;
use crate::config::Cell;
use crate::geometry::{
    Base, Flange, Tcp, Transform,
    kinematics::{Arm, Joints, Unreachable},
};

/// Pose of the TCP at these joint positions.
pub(super) fn base_from_tcp(cell: &Cell, arm: &Arm, joints_rad: &Joints) -> Transform<Base, Tcp> {
    arm.forward(joints_rad) * cell.robot.tcp_offset
}

/// Pose of the flange for a pose of the TCP.
pub(super) fn base_from_flange(cell: &Cell, base_from_tcp: &Transform<Base, Tcp>) -> Transform<Base, Flange> {
    *base_from_tcp * cell.robot.tcp_offset.inverse()
}

/// Smallest and largest position of each joint, rad.
pub(super) fn limits_rad(cell: &Cell, arm: &Arm) -> [[f64; 2]; 6] {
    cell.robot.limits.joints_rad.unwrap_or_else(|| std::array::from_fn(|i| arm.joints[i].limits_rad))
}

/// The joint positions for `base_from_tcp` that are nearest to `now_rad`, within the limits.
pub(super) fn joints_at(
    cell: &Cell,
    arm: &Arm,
    base_from_tcp: &Transform<Base, Tcp>,
    now_rad: &Joints,
) -> Result<Joints, Refusal> {
    let base_from_flange = base_from_flange(cell, base_from_tcp);
    let limits = limits_rad(cell, arm);
    let mut nearest: Option<Joints> = None;
    let mut outside: Option<Refusal> = None;
    let mut missed: Option<Unreachable> = None;
    let home = cell.robot.home_joints_rad;
    for seed in [*now_rad, home].into_iter().chain(other_seeds(&home, &base_from_flange)) {
        match arm.inverse(&base_from_flange, &seed) {
            Ok(joints) => match within(&shifted(&joints, now_rad, &limits), &limits, arm) {
                Ok(joints) => {
                    let better = nearest.is_none_or(|n| distance_rad(&joints, now_rad) < distance_rad(&n, now_rad));
                    nearest = if better { Some(joints) } else { nearest };
                }
                Err(refusal) => outside = outside.or(Some(refusal)),
            },
            Err(unreachable) => missed = Some(nearer(missed, unreachable)),
        }
        // The branch where the arm is already is as near as can be.
        if nearest.is_some_and(|n| distance_rad(&n, now_rad) < 0.8) {
            break;
        }
    }
    let none = Unreachable { position_mm: f64::INFINITY, angle_deg: f64::INFINITY };
    nearest.ok_or_else(|| outside.unwrap_or(Refusal::OutOfReach(missed.unwrap_or(none))))
}

/// Other branches: the base joint towards the goal, elbow and wrist flipped.
fn other_seeds(home: &Joints, goal: &Transform<Base, Flange>) -> impl Iterator<Item = Joints> {
    let [x, y, _] = goal.translation_m();
    let towards = y.atan2(x) + PI;
    let home = *home;
    (0..8).map(move |branch: u32| {
        let mut seed = home;
        seed[0] = if branch & 1 == 0 { towards } else { towards + PI };
        if branch & 2 != 0 {
            seed[1] += seed[2];
            seed[2] = -seed[2];
        }
        if branch & 4 != 0 {
            seed[4] = -seed[4];
            seed[5] += PI;
        }
        seed
    })
}

fn nearer(before: Option<Unreachable>, now: Unreachable) -> Unreachable {
    before.filter(|b| b.position_mm <= now.position_mm).unwrap_or(now)
}

/// Largest turn of a joint, rad.
pub(super) fn distance_rad(a: &Joints, b: &Joints) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// The same pose with every joint as near to `near_rad` as its limits let whole turns bring it.
fn shifted(joints: &Joints, near_rad: &Joints, limits: &[[f64; 2]; 6]) -> Joints {
    std::array::from_fn(|i| {
        let nearest = joints[i] + TAU * ((near_rad[i] - joints[i]) / TAU).round();
        let [min, max] = limits[i];
        let allowed = [nearest, nearest - TAU, nearest + TAU].into_iter().find(|q| (min..=max).contains(q));
        allowed.unwrap_or(nearest)
    })
}

/// Whether joint positions keep the limits.
pub(super) fn within(joints: &Joints, limits: &[[f64; 2]; 6], arm: &Arm) -> Result<Joints, Refusal> {
    for (i, ([min, max], q)) in limits.iter().zip(joints).enumerate() {
        if !(*min..=*max).contains(q) {
            return Err(Refusal::JointLimit {
                joint: arm.joints[i].name.clone(),
                value_deg: q.to_degrees(),
                min_deg: min.to_degrees(),
                max_deg: max.to_degrees(),
            });
        }
    }
    Ok(*joints)
}
