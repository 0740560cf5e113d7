//! Which way leads to the next place: as planned, directly where that is clear, or back along the poses.
//!
//! Uses `plan` for the words; whether a way is clear is asked of [`Ways`].

use std::sync::Arc;

use super::types::MoveTarget;
use crate::geometry::kinematics::Joints;

/// Speed of a way that nobody has planned, as a share of the caps of the cell.
pub(super) const SLOW: f64 = 0.25;

/// One stop of the trajectory.
#[derive(Debug, Clone, PartialEq)]
pub struct Stop {
    /// Where to, from the stop before.
    pub target: MoveTarget,
    /// Joint positions on arrival, by the nominal model, rad.
    pub joints_rad: Joints,
    /// Estimated time of the move, s.
    pub move_s: f64,
}

/// Answers whether a joint move is clear, and gives it.
type Clear = dyn Fn(&Joints, &Joints, f64) -> Result<(MoveTarget, f64), String> + Send + Sync;

/// Plans a joint move between two places at a share of the caps, or says why there is none.
#[derive(Clone)]
pub struct Ways(Arc<Clear>);

impl Ways {
    /// Plans with `clear`: from, to, share of the caps; gives the move and its estimated time in s.
    pub fn new(
        clear: impl Fn(&Joints, &Joints, f64) -> Result<(MoveTarget, f64), String> + Send + Sync + 'static,
    ) -> Self {
        Self(Arc::new(clear))
    }

    pub(super) fn between(&self, from: &Joints, to: &Joints, speed: f64) -> Result<(MoveTarget, f64), String> {
        (self.0)(from, to, speed)
    }
}

impl std::fmt::Debug for Ways {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Ways")
    }
}

/// A place where the arm can be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Node {
    /// Off the route: a far start that has not reached home yet.
    Elsewhere,
    Home,
    Pose(usize),
}

/// Farthest from a place that a move planned from there may begin, rad.
const AT_PLACE_RAD: f64 = 0.02;

/// One move.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Leg {
    pub(super) to: Node,
    /// Whether the arm is there for a capture.
    pub(super) capture: bool,
    pub(super) target: MoveTarget,
    pub(super) move_s: f64,
    pub(super) joints_rad: Joints,
}

/// The trajectory as places and ways.
#[derive(Debug, Clone)]
pub struct Route {
    /// The poses, in order.
    pub stops: Vec<Stop>,
    /// Where the session starts, rad.
    pub start_joints_rad: Joints,
    /// The way home from the last pose; absent where the arm stays.
    pub home: Option<Stop>,
    /// Whether other ways are clear.
    pub ways: Ways,
}

impl Route {
    /// The planned leg to a pose, from the place before.
    pub(super) fn planned(&self, pose: usize) -> Result<Leg, String> {
        let Some(stop) = self.stops.get(pose) else { return Err(format!("there is no pose {}", pose + 1)) };
        let &Stop { target, joints_rad, move_s } = stop;
        Ok(Leg { to: Node::Pose(pose), capture: true, target, move_s, joints_rad })
    }

    /// The legs that end with a capture at `pose`.
    pub(super) fn to_pose(&self, from: Node, now: &Joints, pose: usize) -> Result<Vec<Leg>, String> {
        let planned = self.planned(pose)?;
        let stop = &self.stops[pose];
        let before = if pose == 0 { Node::Home } else { Node::Pose(pose - 1) };
        if from == before && is_near(now, &self.place(before)) {
            return Ok(vec![planned]);
        }
        if matches!(stop.target, MoveTarget::Joint { .. })
            && let Ok((target, move_s)) = self.ways.between(now, &stop.joints_rad, 1.0)
        {
            return Ok(vec![Leg { target, move_s, ..planned }]);
        }
        let mut legs = self.along(from, now, before)?;
        legs.push(planned);
        Ok(legs)
    }

    /// The legs home; none where the arm stays.
    pub(super) fn to_home(&self, from: Node, now: &Joints) -> Result<Vec<Leg>, String> {
        let Some(home) = &self.home else { return Ok(Vec::new()) };
        let leg = |(target, move_s)| Leg {
            to: Node::Home,
            capture: false,
            target,
            move_s,
            joints_rad: self.start_joints_rad,
        };
        let last = self.stops.len().checked_sub(1).map(Node::Pose);
        if last == Some(from) && is_near(now, &self.place(from)) {
            return Ok(vec![leg((home.target, home.move_s))]);
        }
        match self.ways.between(now, &self.start_joints_rad, 1.0) {
            Ok(way) => Ok(vec![leg(way)]),
            Err(_) => self.along(from, now, Node::Home),
        }
    }

    /// From place to place along the trajectory, in either direction; every way is checked. At least one leg:
    /// beside the goal the arm drives to the goal itself.
    fn along(&self, from: Node, now: &Joints, to: Node) -> Result<Vec<Leg>, String> {
        let number = |node| match node {
            Node::Elsewhere | Node::Home => 0,
            Node::Pose(i) => i + 1,
        };
        let (mut at, goal) = (number(from), number(to));
        let (mut legs, mut joints) = (Vec::new(), *now);
        loop {
            at = if at < goal { at + 1 } else { at - usize::from(at > goal) };
            let to = at.checked_sub(1).map_or(Node::Home, Node::Pose);
            let joints_rad = self.place(to);
            let (target, move_s) = self.ways.between(&joints, &joints_rad, 1.0)?;
            legs.push(Leg { to, capture: false, target, move_s, joints_rad });
            joints = joints_rad;
            if at == goal {
                return Ok(legs);
            }
        }
    }

    /// Where a place is by the plan, rad.
    fn place(&self, node: Node) -> Joints {
        let pose = if let Node::Pose(pose) = node { self.stops.get(pose) } else { None };
        pose.map_or(self.start_joints_rad, |stop| stop.joints_rad)
    }
}

/// Whether a move that was planned from `place` may begin here; NaN may not.
fn is_near(now: &Joints, place: &Joints) -> bool {
    now.iter().zip(place).all(|(a, b)| (a - b).abs() <= AT_PLACE_RAD)
}

/// Farthest that the arm may be from the way on which it stopped, rad.
pub(super) const ON_WAY_RAD: f64 = 0.05;

/// Largest distance of a joint from the straight way between two places, rad; at its nearest point.
pub(super) fn off_way_rad(joints: &Joints, from: &Joints, to: &Joints) -> f64 {
    let along: f64 = (0..6).map(|i| (to[i] - from[i]) * (joints[i] - from[i])).sum();
    let length: f64 = (0..6).map(|i| (to[i] - from[i]).powi(2)).sum();
    let fraction = if length > 0.0 { (along / length).clamp(0.0, 1.0) } else { 0.0 };
    let away = (0..6).map(|i| (joints[i] - from[i] - fraction * (to[i] - from[i])).abs());
    away.fold(0.0, |far, a| if a.is_nan() || far.is_nan() { f64::NAN } else { far.max(a) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn joint(joints_rad: Joints) -> MoveTarget {
        MoveTarget::Joint { joints_rad, speed_rad_s: 1.0, acceleration_rad_s2: 1.0 }
    }

    /// Five poses; from one to the next but one something is in the way.
    fn route(linear: Option<usize>) -> Route {
        let stop = |i: usize| {
            let joints_rad = [0.1 * (i + 1) as f64; 6];
            let line = MoveTarget::Linear { tcp_pose: [i as f64; 6], speed_m_s: 0.1, acceleration_m_s2: 0.1 };
            let target = if linear == Some(i) { line } else { joint(joints_rad) };
            Stop { target, joints_rad, move_s: 1.0 }
        };
        let ways =
            Ways::new(
                |from, to, _| {
                    if (from[0] - to[0]).abs() < 0.15 { Ok((joint(*to), 2.0)) } else { Err("blocked".into()) }
                },
            );
        let home = Stop { target: joint([0.0; 6]), joints_rad: [0.0; 6], move_s: 3.0 };
        Route { stops: (0..5).map(stop).collect(), start_joints_rad: [0.0; 6], home: Some(home), ways }
    }

    fn places(legs: &[Leg]) -> Vec<(Node, bool)> {
        legs.iter().map(|leg| (leg.to, leg.capture)).collect()
    }

    #[test]
    fn the_planned_way_is_taken_from_the_pose_before() {
        let legs = route(None).to_pose(Node::Pose(1), &[0.2; 6], 2).unwrap();
        assert_eq!(places(&legs), [(Node::Pose(2), true)]);
        assert_eq!(legs[0].move_s, 1.0);
        assert_eq!(route(None).to_pose(Node::Home, &[0.0; 6], 0).unwrap().len(), 1);
    }

    #[test]
    fn where_the_direct_way_is_blocked_the_poses_are_walked() {
        let legs = route(None).to_pose(Node::Home, &[0.0; 6], 3).unwrap();
        let walked = [(0, false), (1, false), (2, false), (3, true)].map(|(i, capture)| (Node::Pose(i), capture));
        assert_eq!(places(&legs), walked);
        let back = route(None).to_pose(Node::Pose(4), &[0.5; 6], 1).unwrap();
        let walked = [(3, false), (2, false), (1, false), (0, false), (1, true)];
        assert_eq!(places(&back), walked.map(|(i, capture)| (Node::Pose(i), capture)));
        let home = route(None).to_home(Node::Pose(1), &[0.2; 6]).unwrap();
        assert_eq!(places(&home), [(Node::Pose(0), false), (Node::Home, false)]);
    }

    #[test]
    fn a_planned_move_is_never_begun_from_elsewhere() {
        // Beside home, and the first pose from there: the direct way is checked anew, or leads by home itself.
        let beside = route(None).to_pose(Node::Home, &[0.04; 6], 0).unwrap();
        assert_eq!((places(&beside), beside[0].move_s), (vec![(Node::Pose(0), true)], 2.0));
        let line = route(Some(0)).to_pose(Node::Home, &[0.04; 6], 0).unwrap();
        assert_eq!(places(&line), [(Node::Home, false), (Node::Pose(0), true)]);
        assert!(route(None).to_pose(Node::Home, &[0.9; 6], 0).is_err(), "far from home, whatever it is called");
        assert!(route(None).to_pose(Node::Elsewhere, &[0.9; 6], 0).is_err());
        assert!(route(None).to_pose(Node::Pose(1), &[f64::NAN; 6], 2).is_err());
        let home = route(None).to_home(Node::Pose(4), &[0.35; 6]).unwrap();
        assert_eq!(places(&home)[0], (Node::Pose(3), false), "not the planned way from a place where it is not");
    }

    #[test]
    fn a_straight_line_is_only_entered_at_its_start() {
        let legs = route(Some(2)).to_pose(Node::Pose(3), &[0.35; 6], 2).unwrap();
        let places = places(&legs);
        assert_eq!(places[places.len() - 2..], [(Node::Pose(1), false), (Node::Pose(2), true)]);
        assert!(matches!(legs[legs.len() - 1].target, MoveTarget::Linear { .. }));
    }

    #[test]
    fn the_distance_from_a_way_is_that_of_its_nearest_point() {
        let (from, to) = ([0.0; 6], [1.0, 1.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(off_way_rad(&[0.5, 0.5, 0.0, 0.0, 0.0, 0.0], &from, &to), 0.0);
        assert!((off_way_rad(&[0.5, 0.5, 0.2, 0.0, 0.0, 0.0], &from, &to) - 0.2).abs() < 1e-12);
        assert!((off_way_rad(&[-0.3, 0.0, 0.0, 0.0, 0.0, 0.0], &from, &to) - 0.3).abs() < 1e-12);
        assert!(off_way_rad(&[f64::NAN; 6], &from, &to).is_nan());
    }
}
