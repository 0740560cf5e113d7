//! Feeds the checks with what a session saw.
//!
//! The poses for hand-eye that were fitted, and those for distances, which are held out; outliers that the
//! fit left out are left out here too, and named with their poses.

use std::collections::BTreeMap;

use super::adjust::Adjusted;
use super::arm::SolvedArm;
use super::checks::{self, BaseDistance, CheckedCorner, Sighting};
use super::hand_eye::{EyeInHand, EyeToHand, Pair};
use super::problem::{CheckTruth, Problem};
use super::result::ChecksResult;
use super::settings::PoseKind;
use crate::geometry::Camera;

/// The adjustment, and the camera that the checks look through.
pub(super) type AdjustedCamera<'a> = (&'a Adjusted, Camera);

/// The checks of a cell whose arm carries the target.
pub(super) fn to_hand(
    problem: &Problem,
    adjusted: Option<&AdjustedCamera<'_>>,
    pairs: &BTreeMap<usize, Pair>,
    solved: &SolvedArm<EyeToHand>,
) -> ChecksResult {
    let Some(corner) = corner(problem, adjusted) else { return ChecksResult::default() };
    let sightings = sightings(problem, pairs, Some(&solved.rejected));
    let without = by_id(problem, &solved.without);
    let declared = problem.checks.is_some();
    ChecksResult {
        target_to_tcp: declared
            .then_some(())
            .and_then(|()| checks::target_to_tcp(&corner, &solved.solution, &without, &sightings)),
        target_in_base: None,
        base_distance: checks::base_distance(&corner, Some(&solved.solution), &problem.pairs, &sightings),
    }
}

/// The checks of a cell whose arm carries the cameras.
pub(super) fn in_hand(
    problem: &Problem,
    adjusted: Option<&AdjustedCamera<'_>>,
    pairs: &BTreeMap<usize, Pair>,
    solved: &SolvedArm<EyeInHand>,
) -> ChecksResult {
    let Some(corner) = corner(problem, adjusted) else { return ChecksResult::default() };
    let sightings = sightings(problem, pairs, Some(&solved.rejected));
    let without = by_id(problem, &solved.without);
    ChecksResult {
        target_to_tcp: None,
        target_in_base: checks::target_in_base(&corner, &solved.solution, &without, &sightings),
        base_distance: None,
    }
}

/// The distances alone, which need no hand-eye result.
pub(super) fn distances_only(
    problem: &Problem,
    adjusted: Option<&AdjustedCamera<'_>>,
    pairs: &BTreeMap<usize, Pair>,
) -> Option<BaseDistance> {
    let sightings = sightings(problem, pairs, None);
    checks::base_distance(&corner(problem, adjusted)?, None, &problem.pairs, &sightings)
}

/// Pairs whose distance could not be measured, in words.
pub(super) fn missing_pairs(problem: &Problem, measured: Option<&BaseDistance>) -> Option<String> {
    let known = |name: &str| measured.is_some_and(|m| m.per_pair.iter().any(|p| p.pair == name));
    let missing: Vec<_> = problem.pairs.iter().map(|p| p.name.as_str()).filter(|n| !known(n)).collect();
    let (count, all) = (missing.len(), problem.pairs.len());
    (count > 0).then(|| format!("base distance: {count} of {all} pairs could not be measured: {}", missing.join(", ")))
}

/// The corner that the cell declares; without a declaration the paper's corner 9 serves the distances.
///
/// Where the adjustment found the display bent, the corner lies on the bent display.
fn corner(problem: &Problem, adjusted: Option<&AdjustedCamera<'_>>) -> Option<CheckedCorner> {
    let last = (problem.board.corner_count() as u32).checked_sub(1)?;
    let declared = problem.checks.unwrap_or(CheckTruth { corner_id: last.min(9), target_to_tcp_m: None });
    let CheckTruth { corner_id, target_to_tcp_m: truth_m } = declared;
    let flat = problem.board.corner(corner_id)?;
    let bent = adjusted.and_then(|(all, camera)| all.corner(&problem.board, *camera, corner_id));
    Some(CheckedCorner { corner_id, corner_in_target: bent.unwrap_or(flat), truth_m })
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
