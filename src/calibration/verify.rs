//! Feeds the checks with what a session saw.
//!
//! The poses for hand-eye that were fitted, and those for distances, which are held out; outliers that the
//! fit left out are left out here too, and named with their poses.

use std::collections::BTreeMap;

use super::arm::SolvedArm;
use super::checks::{self, BaseDistance, CheckedCorner, Sighting};
use super::hand_eye::{EyeInHand, EyeToHand, Pair};
use super::problem::Problem;
use super::result::ChecksResult;
use super::settings::PoseKind;

/// The checks of a cell whose arm carries the target.
pub(super) fn to_hand(problem: &Problem, pairs: &BTreeMap<usize, Pair>, solved: &SolvedArm<EyeToHand>) -> ChecksResult {
    let Some(corner) = corner(problem) else { return ChecksResult::default() };
    let sightings = sightings(problem, pairs, Some(&solved.rejected));
    let without = by_id(problem, &solved.without);
    ChecksResult {
        target_to_tcp: checks::target_to_tcp(&corner, &solved.solution, &without, &sightings),
        target_in_base: None,
        base_distance: checks::base_distance(&corner, Some(&solved.solution), &problem.pairs, &sightings),
    }
}

/// The checks of a cell whose arm carries the cameras.
pub(super) fn in_hand(problem: &Problem, pairs: &BTreeMap<usize, Pair>, solved: &SolvedArm<EyeInHand>) -> ChecksResult {
    let Some(corner) = corner(problem) else { return ChecksResult::default() };
    let sightings = sightings(problem, pairs, Some(&solved.rejected));
    let without = by_id(problem, &solved.without);
    ChecksResult {
        target_to_tcp: None,
        target_in_base: checks::target_in_base(&corner, &solved.solution, &without, &sightings),
        base_distance: None,
    }
}

/// The distances alone, which need no hand-eye result.
pub(super) fn distances_only(problem: &Problem, pairs: &BTreeMap<usize, Pair>) -> Option<BaseDistance> {
    let sightings = sightings(problem, pairs, None);
    checks::base_distance(&corner(problem)?, None, &problem.pairs, &sightings)
}

fn corner(problem: &Problem) -> Option<CheckedCorner> {
    let corner_id = problem.checks.corner_id;
    let corner_in_target = problem.board.corner(corner_id)?;
    Some(CheckedCorner { corner_id, corner_in_target, truth_m: problem.checks.target_to_tcp_m })
}

fn sightings(
    problem: &Problem,
    pairs: &BTreeMap<usize, Pair>,
    rejected: Option<&BTreeMap<usize, String>>,
) -> Vec<Sighting> {
    let counts = |(index, _): &(&usize, &Pair)| {
        let kind = problem.poses[**index].kind;
        kind != PoseKind::Intrinsics && !rejected.is_some_and(|r| r.contains_key(index))
    };
    let sighting = |(index, pair): (&usize, &Pair)| Sighting {
        pose_id: problem.poses[*index].id.clone(),
        camera_from_target: pair.camera_from_target,
        base_from_tcp: Some(pair.base_from_tcp),
        held_out: problem.poses[*index].kind != PoseKind::HandEye,
    };
    pairs.iter().filter(counts).map(sighting).collect()
}

fn by_id<S: Copy>(problem: &Problem, without: &BTreeMap<usize, S>) -> BTreeMap<String, S> {
    without.iter().filter_map(|(i, s)| Some((problem.poses.get(*i)?.id.clone(), *s))).collect()
}
