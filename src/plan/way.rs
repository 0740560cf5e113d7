//! Joint positions on the way of a move.

use super::Refusal;
use super::reach::distance_rad;
use crate::geometry::{
    Base, Flange, Tcp, Transform,
    kinematics::{Arm, Joints},
};

/// A straight way has at least this many looks, so that its bend is seen.
const FEWEST_STEPS: u32 = 8;

/// All joints in step: a look at least every 0.01 rad, which is 9 mm at full reach.
pub(super) fn joint(from: &Joints, to: &Joints) -> Vec<Joints> {
    let steps = ((distance_rad(from, to) / 0.01).ceil() as u32).clamp(1, 1000);
    let at = |i: u32| std::array::from_fn(|k| from[k] + (to[k] - from[k]) * f64::from(i) / f64::from(steps));
    (0..=steps).map(at).collect()
}

/// Straight at the TCP: a look at least every 5 mm and 3 degrees; refused where a joint would jump.
pub(super) fn linear(
    arm: &Arm,
    flange_from_tcp: &Transform<Flange, Tcp>,
    from_rad: &Joints,
    to: &Transform<Base, Tcp>,
) -> Result<Vec<Joints>, Refusal> {
    let from = arm.forward(from_rad) * *flange_from_tcp;
    let steps = (from.distance_to_m(to) / 0.005).max(from.angle_to_rad(to) / 0.05).ceil();
    let steps = (steps.min(1000.0) as u32).max(FEWEST_STEPS);
    let mut way = vec![*from_rad];
    let mut joints = *from_rad;
    for i in 1..=steps {
        let base_from_tcp = from.interpolate(to, f64::from(i) / f64::from(steps));
        let next = arm.inverse(&(base_from_tcp * flange_from_tcp.inverse()), &joints).map_err(Refusal::OutOfReach)?;
        let smooth = distance_rad(&next, &joints) <= 0.3;
        if !smooth {
            return Err(Refusal::NoStraightLine);
        }
        joints = next;
        way.push(joints);
    }
    Ok(way)
}
