//! Before any motion: every pose of a session, with reach, limits, keep-out boxes, view and duration checked.
//!
//! Pure: no files, no clock. Uses `geometry`, `board` and `config`.
//! Start at [`expand`].

mod motion;
mod reach;
mod sight;
mod stops;
mod target;
#[cfg(test)]
mod tests;

use std::collections::BTreeSet;

use crate::config::{Cell, PoseKind, Trajectory};
use crate::geometry::{
    Base, Camera, Tcp, Transform,
    kinematics::{Arm, Joints, Unreachable},
};

pub use target::MoveTarget;

use stops::Stop;

/// Every pose of a session, in order.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The poses.
    pub poses: Vec<PlannedPose>,
    /// Estimated duration, from home to the last capture, seconds.
    pub duration_s: f64,
    /// What is allowed but worth knowing.
    pub warnings: Vec<String>,
}

/// One stop, ready to be moved to.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedPose {
    /// Unique in the plan.
    pub id: String,
    /// What it is for.
    pub kind: PoseKind,
    /// The pair of the distance check that it belongs to; its two poses follow each other.
    pub pair: Option<PairRef>,
    /// The move that leads here from the pose before.
    pub target: MoveTarget,
    /// Joint positions on arrival, rad; by the nominal model of the arm.
    pub joints_rad: Joints,
    /// Pose of the TCP on arrival.
    pub base_from_tcp: Transform<Base, Tcp>,
    /// How many inner corners each camera of the cell should see here, by the nominal places.
    pub corners_in_view: Vec<(Camera, usize)>,
    /// Estimated time of the move, seconds.
    pub move_s: f64,
}

/// A pair of the distance check.
#[derive(Debug, Clone, PartialEq)]
pub struct PairRef {
    /// Name of the pair.
    pub name: String,
    /// The known distance, metres.
    pub truth_m: f64,
}

/// The poses that cannot be visited, each with the reason.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub struct PlanError {
    /// At least one.
    pub problems: Vec<PoseProblem>,
}

impl std::fmt::Display for PlanError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (i, problem) in self.problems.iter().enumerate() {
            write!(f, "{}{problem}", if i == 0 { "" } else { "\nerror: " })?;
        }
        Ok(())
    }
}

/// A pose that cannot be visited.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{file}: pose {pose} {why}")]
pub struct PoseProblem {
    /// The trajectory file.
    pub file: String,
    /// Id of the pose.
    pub pose: String,
    /// What is wrong and what to do.
    pub why: Refusal,
}

/// Why a pose cannot be visited.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// No joint positions.
    #[error(
        "is out of reach: the arm gets no nearer than {:.0} mm and {:.1} deg; move it, or correct `nominal` and `tcp_offset` of the cell",
        .0.position_mm, .0.angle_deg
    )]
    OutOfReach(Unreachable),
    /// Joint positions only outside their limits.
    #[error(
        "needs {joint} at {value_deg:.1} deg, outside {min_deg:.1} to {max_deg:.1}; move it, or correct `limits.joints_deg`"
    )]
    JointLimit {
        /// Name of the joint.
        joint: String,
        /// Position that is needed, degrees.
        value_deg: f64,
        /// Smallest allowed, degrees.
        min_deg: f64,
        /// Largest allowed, degrees.
        max_deg: f64,
    },
    /// The straight line passes where the arm cannot follow.
    #[error(
        "cannot be reached on a straight line: the arm must change its configuration on the way; use `move: joint`"
    )]
    NoStraightLine,
    /// Something of arm, tool or board enters a box.
    #[error("brings the {part} to {:.3}, {:.3}, {:.3} m, inside the keep-out box `{name}`, on its way there; move the pose, or visit another one first", .at_m[0], .at_m[1], .at_m[2])]
    KeepOut {
        /// Name of the box.
        name: String,
        /// What enters it.
        part: &'static str,
        /// Where it is then, in `base`, metres.
        at_m: [f64; 3],
    },
    /// No camera sees the board.
    #[error("shows no corner of the board to any camera; move it, or correct `nominal` of the cell")]
    OutOfView,
    /// The cameras look at the back of the board.
    #[error("turns the back of the board to the {0} camera; correct its rotation, or `nominal` of the cell")]
    FromBehind(Camera),
    /// Two poses with one id.
    #[error("has an id that another pose of the session has; rename one, or use each trajectory once")]
    DoubledId,
}

/// All poses of the trajectories with the nominal UR5e; see [`expand_with`].
pub fn expand(cell: &Cell, trajectories: &[(PoseKind, Trajectory)]) -> Result<Plan, PlanError> {
    expand_with(cell, &Arm::ur5e(), trajectories)
}

/// All poses of the trajectories, in order, from the home position of the cell; every pose that cannot be
/// visited is in the error.
pub fn expand_with(cell: &Cell, arm: &Arm, trajectories: &[(PoseKind, Trajectory)]) -> Result<Plan, PlanError> {
    let mut planner = Planner {
        cell,
        arm,
        now_rad: cell.robot.home_joints_rad,
        ids: BTreeSet::new(),
        plan: Plan { poses: Vec::new(), duration_s: 0.0, warnings: Vec::new() },
        problems: Vec::new(),
    };
    for (kind, trajectory) in trajectories {
        let first = planner.plan.poses.len();
        for stop in stops::of(cell, trajectory) {
            planner.visit(*kind, trajectory, stop);
        }
        planner.plan.warnings.extend(stops::warnings(cell, trajectory));
        let seen = sight::warnings(cell, &trajectory.file, &planner.plan.poses[first..]);
        planner.plan.warnings.extend(seen);
    }
    let Planner { plan, problems, .. } = planner;
    if problems.is_empty() { Ok(plan) } else { Err(PlanError { problems }) }
}

/// A joint that turns farther than this between two poses is worth a warning, rad.
const FAR_RAD: f64 = 2.0;

struct Planner<'a> {
    cell: &'a Cell,
    arm: &'a Arm,
    /// Where the arm is after the last pose that worked.
    now_rad: Joints,
    ids: BTreeSet<String>,
    plan: Plan,
    problems: Vec<PoseProblem>,
}

impl Planner<'_> {
    fn visit(&mut self, kind: PoseKind, trajectory: &Trajectory, stop: Stop) {
        let pose = stop.id.clone();
        let found = if self.ids.insert(pose.clone()) { self.planned(kind, stop) } else { Err(Refusal::DoubledId) };
        match found {
            Ok(planned) => {
                self.warn_of_far_turns(&trajectory.file, &planned);
                self.now_rad = planned.joints_rad;
                self.plan.duration_s += planned.move_s + motion::pause_s(self.cell);
                self.plan.poses.push(planned);
            }
            Err(why) => self.problems.push(PoseProblem { file: trajectory.file.clone(), pose, why }),
        }
    }

    fn planned(&self, kind: PoseKind, stop: Stop) -> Result<PlannedPose, Refusal> {
        let Self { cell, arm, now_rad, .. } = self;
        let leg = motion::leg(cell, arm, now_rad, &stop.goal, stop.motion)?;
        motion::keep_out(cell, arm, &leg)?;
        let corners_in_view = sight::corners_in_view(cell, leg.base_from_tcp)?;
        Ok(PlannedPose {
            id: stop.id,
            kind,
            pair: stop.pair,
            target: leg.target,
            joints_rad: leg.joints_rad,
            base_from_tcp: leg.base_from_tcp,
            corners_in_view,
            move_s: leg.duration_s,
        })
    }

    fn warn_of_far_turns(&mut self, file: &str, planned: &PlannedPose) {
        let turns = planned.joints_rad.iter().zip(self.now_rad).map(|(to, from)| (to - from).abs());
        let farthest = turns.enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((joint, turn)) = farthest.filter(|(_, turn)| *turn > FAR_RAD) {
            let (id, joint, turn) = (&planned.id, &self.arm.joints[joint].name, turn.to_degrees());
            self.plan.warnings.push(format!(
                "{file}: pose {id} turns {joint} by {turn:.0} deg: the arm changes its configuration; watch that move"
            ));
        }
    }
}
