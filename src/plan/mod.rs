//! Before any motion: every pose of a session, with reach, limits, keep-out boxes, view and duration checked.
//!
//! Pure: no files, no clock. Uses `geometry`, `board` and `config`.
//! Start at [`expand`]; [`coverage()`] judges the views, [`propose`] makes poses; [`Clearance`] and [`JointMoves`] are for moves that come up at run time.

mod clearance;
mod coverage;
mod motion;
pub mod propose;
mod reach;
mod sight;
mod stops;
mod target;
#[cfg(test)]
mod tests;
mod way;

use std::collections::BTreeSet;

use crate::config::{Cell, MotionBy, PoseKind, Trajectory};
use crate::geometry::{
    Base, Camera, Tcp, Transform,
    kinematics::{Arm, Joints, Unreachable},
};

pub use clearance::{Clearance, Gap};
pub use coverage::{Coverage, MIN_COVERED, MIN_DEPTH_RATIO, MIN_TILT_RAD, coverage};
pub use target::MoveTarget;

use stops::Stop;

/// Every pose of a session, in order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Plan {
    /// The poses.
    pub poses: Vec<PlannedPose>,
    /// The move from the last pose to the home position of the cell, where the cell wants it and we move the arm.
    pub home: Option<PlannedMove>,
    /// Whether the event camera should see most of the board from home.
    pub home_sees_board: bool,
    /// Estimated duration, from home to the last capture and home again, seconds.
    pub duration_s: f64,
    /// What is allowed but worth knowing.
    pub warnings: Vec<String>,
}

/// A move that no capture follows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedMove {
    /// Where to and how fast.
    pub target: MoveTarget,
    /// Estimated time, seconds.
    pub move_s: f64,
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
    /// The trajectory file; the name of the cell for its home position.
    pub file: String,
    /// Id of the pose; `home` for the home position of the cell.
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
    /// Something of arm, tool or board enters a box, or comes nearer than the margin.
    #[error(
        "brings the {part} to {:.3}, {:.3}, {:.3} m, {}, on its way there; move the pose, or visit another one first",
        .at_m[0], .at_m[1], .at_m[2], beside(.name, *.gap_m)
    )]
    KeepOut {
        /// Name of the box.
        name: String,
        /// What enters it.
        part: String,
        /// The point of it that is in the box, or nearest to it, in `base`, metres.
        at_m: [f64; 3],
        /// Free space between the part and the box, metres; negative inside.
        gap_m: f64,
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

fn beside(name: &str, gap_m: f64) -> String {
    if gap_m > 0.0 {
        format!("{:.1} mm from the keep-out box `{name}`, where `keep_out_margin_mm` and 0.5 mm are kept", gap_m * 1e3)
    } else {
        format!("inside the keep-out box `{name}`")
    }
}

/// All poses of the trajectories with the nominal UR5e; see [`expand_with`].
pub fn expand(cell: &Cell, trajectories: &[(PoseKind, Trajectory)]) -> Result<Plan, PlanError> {
    expand_with(cell, &Arm::ur5e(), trajectories)
}

/// All poses of the trajectories, in order, from the home position of the cell and back; every pose that cannot be
/// visited is in the error.
pub fn expand_with(cell: &Cell, arm: &Arm, trajectories: &[(PoseKind, Trajectory)]) -> Result<Plan, PlanError> {
    let mut planner = Planner {
        cell,
        arm,
        clearance: Clearance::of(cell, arm),
        now_rad: cell.robot.home_joints_rad,
        ids: BTreeSet::new(),
        plan: Plan { home_sees_board: sight::from_home(cell, arm), ..Plan::default() },
        problems: Vec::new(),
    };
    // From a home position that is not clear no pose can be reached: one problem, not one for each of them.
    planner.clearance.at(&cell.robot.home_joints_rad).map_err(|why| not_home(cell, why))?;
    for (kind, trajectory) in trajectories {
        let first = planner.plan.poses.len();
        for stop in stops::of(cell, trajectory) {
            planner.visit(*kind, trajectory, stop);
        }
        planner.plan.warnings.extend(stops::warnings(cell, trajectory));
        let seen = sight::warnings(cell, &trajectory.file, &planner.plan.poses[first..]);
        planner.plan.warnings.extend(seen);
    }
    if planner.problems.is_empty() {
        planner.go_home()?;
        Ok(planner.plan)
    } else {
        Err(PlanError { problems: planner.problems })
    }
}

/// Plans joint moves that come up at run time, against boxes and shapes that are looked at once.
#[derive(Debug, Clone)]
pub struct JointMoves {
    cell: Cell,
    arm: Arm,
    clearance: Clearance,
}

impl JointMoves {
    /// For the arm of a cell.
    pub fn of(cell: &Cell, arm: &Arm) -> Self {
        Self { cell: cell.clone(), arm: arm.clone(), clearance: Clearance::of(cell, arm) }
    }

    /// The move between two joint positions (rad), with its time in seconds: within the joint limits, clear of all
    /// boxes, slow enough for the caps of joints and TCP times `speed_factor` (0.01 to 1; beyond, the nearer one).
    pub fn between(&self, from: &Joints, to: &Joints, speed_factor: f64) -> Result<(MoveTarget, f64), Refusal> {
        let planned = motion::joint_move(&self.cell, &self.arm, &self.clearance, [from, to], speed_factor)?;
        Ok((planned.target, planned.move_s))
    }
}

fn not_home(cell: &Cell, why: Refusal) -> PlanError {
    PlanError { problems: vec![PoseProblem { file: cell.name.clone(), pose: "home".into(), why }] }
}

/// A joint that turns farther than this between two poses is worth a warning, rad.
const FAR_RAD: f64 = 2.0;

struct Planner<'a> {
    cell: &'a Cell,
    arm: &'a Arm,
    clearance: Clearance,
    /// Where the arm is after the last pose that worked.
    now_rad: Joints,
    ids: BTreeSet<String>,
    plan: Plan,
    problems: Vec<PoseProblem>,
}

impl Planner<'_> {
    fn visit(&mut self, kind: PoseKind, trajectory: &Trajectory, stop: Stop) {
        let kind = stop.purpose.unwrap_or(kind);
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
        let Self { cell, arm, clearance, now_rad, .. } = self;
        let leg = motion::leg(cell, arm, clearance, now_rad, &stop.goal, stop.motion)?;
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

    fn go_home(&mut self) -> Result<(), PlanError> {
        let Self { cell, arm, clearance, now_rad, plan, .. } = self;
        let robot = &cell.robot;
        if robot.return_home && robot.motion == MotionBy::Script && !plan.poses.is_empty() {
            let home = motion::joint_move(cell, arm, clearance, [now_rad, &robot.home_joints_rad], 1.0);
            let home = home.map_err(|why| not_home(cell, why))?;
            plan.duration_s += home.move_s;
            plan.home = Some(home);
        }
        Ok(())
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
