//! Proposes one set of poses that serves cameras, stereo, hand-eye and checks in a single short tour.
//!
//! Views are drawn at random from a seed; those that the cameras see and the arm reaches are judged by the Fisher
//! information of the joint problem (both cameras, stereo, hand-eye; the place of the board at every pose eliminated),
//! chosen one after the other and exchanged until the error that a user sees is smallest, and put in an order of short
//! moves. Pure. Uses `config`, `geometry` and the rest of `plan`. Start at [`propose`].

mod candidates;
mod model;
mod predict;
mod select;
#[cfg(test)]
mod tests;
mod tour;

use nalgebra::DMatrix;

use super::{Clearance, Plan, motion, sight};
use crate::config::{Cell, PoseKind, RobotDriver, TourPart};
use crate::geometry::kinematics::Arm;

pub use predict::Accuracy;

use candidates::{Draw, Item};
use model::Model;
use predict::Wanted;
use select::{Pool, Search};
use tour::Times;

/// Draws for single stops.
const SINGLE_DRAWS: usize = 4000;
/// Draws for each kind of pair.
const PAIR_DRAWS: usize = 1500;
/// Pairs of the distance check: one across the optical axis, one along it.
const PAIRS: usize = 2;
/// Fewest stops for the hand-eye fit; with fewer the jackknife says little.
const MIN_FOR_ARM: usize = 8;
/// The nearest and farthest distance of the board, as shares of that at home. A lens of 12 mm at f/11,
/// focused at 0.29 m, blurs by no more than two pixels of 4.5 um from there to there.
const DEPTHS: [f64; 2] = [0.83, 1.22];
/// Share of the image width that the board fills where home does not show it.
const FILLS: f64 = 0.45;
/// Share of corners that a tour may miss where no gate says it.
const MAY_MISS: f64 = 0.25;

/// What is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wish {
    /// Largest number of poses.
    pub poses: usize,
    /// Longest robot time, from home and back with all captures, s.
    pub seconds: f64,
    /// Seed of the draws: the same cell, wish and seed give the same poses.
    pub seed: u64,
    /// Nearest and farthest distance of the board from the reference camera, m; absent: about that at home.
    pub depths_m: Option<[f64; 2]>,
}

/// Why there is no proposal.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ProposeError {
    /// Nobody moves.
    #[error(
        "the cell has `robot: none`, so that `nominal` says neither where the cameras nor where the board is: poses are \
         proposed for an arm; give `robot` and `nominal`"
    )]
    NoArm,
    /// Too few poses are asked for.
    #[error("{found} poses are too few: give at least {} ({MIN_FOR_ARM} for the hand-eye fit and {PAIRS} pairs)", MIN_FOR_ARM + 2 * PAIRS)]
    FewPoses {
        /// As asked for.
        found: usize,
    },
    /// A cell like this has no such views.
    #[error(
        "of {drawn} views only {found} are seen by the cameras, reached by the arm near home and clear of the keep-out \
         boxes, {needed} are needed: correct `nominal`, `home_joints_deg` and `keep_out` of the cell, or give --depth-mm \
         (now {:.0} to {:.0})", .depths_m[0] * 1e3, .depths_m[1] * 1e3
    )]
    FewViews {
        /// Views that were drawn.
        drawn: usize,
        /// Those that can be used.
        found: usize,
        /// Those that are needed.
        needed: usize,
        /// Distances of the board, m.
        depths_m: [f64; 2],
    },
    /// The moves alone take too long.
    #[error(
        "the shortest tour found with {poses} poses takes {found_s:.0} s, longer than {allowed_s:.0} s: give more --seconds, \
         or raise `limits` of the robot"
    )]
    Slow {
        /// Poses of that tour.
        poses: usize,
        /// Its robot time, s.
        found_s: f64,
        /// As asked for, s.
        allowed_s: f64,
    },
}

/// A set of poses in the order of their visit.
#[derive(Debug, Clone, PartialEq)]
pub struct Proposal {
    /// The stops, as they are written to a trajectory.
    pub parts: Vec<TourPart>,
    /// Robot time, s.
    pub duration_s: f64,
    /// What the poses are worth.
    pub accuracy: Accuracy,
    /// Nearest and farthest distance of the board, m: the depth of the workspace that the accuracy is for.
    pub depths_m: [f64; 2],
}

/// Proposes poses; `step` hears of steps done and all steps.
pub fn propose(
    cell: &Cell,
    arm: &Arm,
    wish: &Wish,
    step: &(dyn Fn(usize, usize) + Sync),
) -> Result<Proposal, ProposeError> {
    if cell.robot.driver == RobotDriver::None {
        return Err(ProposeError::NoArm);
    }
    let singles = wish.poses.saturating_sub(2 * PAIRS);
    if singles < MIN_FOR_ARM {
        return Err(ProposeError::FewPoses { found: wish.poses });
    }
    let (model, clearance) = (Model::of(cell), Clearance::of(cell, arm));
    let depths_m = wish.depths_m.unwrap_or_else(|| usual_depths_m(cell, arm));
    let wanted = Wanted::of(&model, depths_m);
    let draw = Draw { cell, arm, clearance: &clearance, model: &model, depths_m };
    let pools = pools(&draw, singles, wish.seed);
    for Pool { items, wanted, drawn } in &pools {
        if items.len() < *wanted {
            return Err(ProposeError::FewViews { drawn: *drawn, found: items.len(), needed: *wanted, depths_m });
        }
    }
    let share = cell.gates.corner_rate.map_or(MAY_MISS, |rate| 0.5 * (1.0 - rate));
    let search = Search { pools: &pools, wanted: &wanted, may_miss: share * wish.poses as f64 };
    let drawn = pools[0].drawn;
    let few = || ProposeError::FewViews { drawn, found: pools[0].items.len(), needed: wish.poses, depths_m };
    let chosen = search.run(model.size(), step).ok_or_else(few)?;
    let items: Vec<&Item> = chosen.iter().map(|choice| search.item(choice)).collect();
    let times = Times::of(cell, arm, &clearance, &items);
    let trim = Trim { cell, items: &items, times: &times, wanted: &wanted, size: model.size() };
    let order = trim.within(wish.seconds)?;
    let accuracy = wanted.accuracy(&trim.information(&order)).ok_or_else(few)?;
    let parts = order.iter().map(|i| part(items[*i])).collect();
    Ok(Proposal { parts: numbered(parts), duration_s: trim.duration_s(&order), accuracy, depths_m })
}

/// What the poses of a plan are worth, for a workspace between two distances from the reference camera, m.
///
/// The robot's poses count where they are for the hand-eye fit, the views of all of them for the cameras.
pub fn accuracy(cell: &Cell, plan: &Plan, depths_m: [f64; 2]) -> Option<Accuracy> {
    let model = Model::of(cell);
    let told = |pose: &super::PlannedPose| model.sight(pose.base_from_tcp, pose.kind == PoseKind::HandEye).information;
    let prior = DMatrix::identity(model.size(), model.size());
    let sum = plan.poses.iter().fold(prior, |sum, pose| sum + told(pose));
    Wanted::of(&model, depths_m).accuracy(&sum)
}

/// Around the distance at which home shows the board, or at which the board fills a good part of the image.
fn usual_depths_m(cell: &Cell, arm: &Arm) -> [f64; 2] {
    let home = arm.forward(&cell.robot.home_joints_rad) * cell.robot.tcp_offset;
    let shown = sight::corners_in_view(cell, home).is_ok();
    let centre = cell.nominal.mount.camera_from_target(home) * cell.board.centre();
    let reference = cell.nominal_camera(cell.reference_camera());
    let [width_m, height_m] = cell.board.size_m();
    let filling_m = reference.map_or(0.3, |c| c.fx * width_m.max(height_m) / (FILLS * f64::from(c.width)));
    let usual_m = if shown { centre.xyz_m()[2] } else { filling_m };
    // As it can be given by hand.
    DEPTHS.map(|share| (share * usual_m * 1e3).round() / 1e3)
}

fn pools(draw: &Draw<'_>, singles: usize, seed: u64) -> Vec<Pool> {
    let mut pools = vec![Pool { items: draw.singles(SINGLE_DRAWS, seed), wanted: singles, drawn: SINGLE_DRAWS }];
    for (k, along) in [(1, false), (2, true)] {
        // Another stream for each kind, so that more of one leaves the others as they are.
        let items = draw.pairs(PAIR_DRAWS, seed.wrapping_add(k << 32), along);
        pools.push(Pool { items, wanted: 1, drawn: PAIR_DRAWS });
    }
    pools
}

/// Takes stops away until the tour is short enough.
struct Trim<'a> {
    cell: &'a Cell,
    items: &'a [&'a Item],
    times: &'a Times,
    wanted: &'a Wanted,
    size: usize,
}

impl Trim<'_> {
    fn within(&self, seconds: f64) -> Result<Vec<usize>, ProposeError> {
        let all: Vec<usize> = (0..self.items.len()).collect();
        let mut order = self.times.short_tour(&all);
        loop {
            let found_s = self.duration_s(&order);
            if found_s <= seconds {
                return Ok(order);
            }
            let poses = order.iter().map(|i| self.items[*i].stops()).sum();
            let fewer = self.without_the_cheapest(&order);
            order = fewer.ok_or(ProposeError::Slow { poses, found_s, allowed_s: seconds })?;
        }
    }

    /// The tour without the stop that costs the most time for what it tells; `None` where each is needed.
    fn without_the_cheapest(&self, order: &[usize]) -> Option<Vec<usize>> {
        let for_arm = order.iter().filter(|i| self.items[**i].for_arm).count();
        let before_m2 = self.wanted.mean_square_m2(&self.information(order));
        let spare = |i: &&usize| {
            let item = self.items[**i];
            item.second.is_none() && (!item.for_arm || for_arm > MIN_FOR_ARM)
        };
        let judged = order.iter().filter(spare).map(|i| {
            let left: Vec<usize> = order.iter().copied().filter(|k| k != i).collect();
            let shorter = self.times.short_tour(&left);
            let saved_s = self.duration_s(order) - self.duration_s(&shorter);
            let loss = self.wanted.mean_square_m2(&self.information(&shorter)) / before_m2 - 1.0;
            (loss / saved_s.max(1e-3), shorter)
        });
        judged.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, order)| order)
    }

    /// Moves, standing still and captures, s.
    fn duration_s(&self, order: &[usize]) -> f64 {
        let stops: usize = order.iter().map(|i| self.items[*i].stops()).sum();
        self.times.moves_s(order) + motion::pause_s(self.cell) * stops as f64
    }

    fn information(&self, order: &[usize]) -> DMatrix<f64> {
        let prior = DMatrix::identity(self.size, self.size);
        order.iter().fold(prior, |sum, i| sum + &self.items[*i].information)
    }
}

fn part(item: &Item) -> TourPart {
    match &item.second {
        None => {
            let purpose = if item.for_arm { PoseKind::HandEye } else { PoseKind::Intrinsics };
            TourPart::View { purpose, view: item.view }
        }
        Some((_, displacement_m, _)) => {
            TourPart::Pair { name: String::new(), start: item.view, displacement_m: *displacement_m }
        }
    }
}

/// Names for the pairs, in the order of their visit.
fn numbered(mut parts: Vec<TourPart>) -> Vec<TourPart> {
    let pairs = parts.iter_mut().filter_map(|part| match part {
        TourPart::Pair { name, .. } => Some(name),
        TourPart::View { .. } => None,
    });
    for (i, name) in pairs.enumerate() {
        *name = format!("pair-{}", i + 1);
    }
    parts
}
