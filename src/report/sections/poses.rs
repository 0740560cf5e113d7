//! What happened at every pose.

use std::collections::BTreeSet;

use super::super::document::{Block, Plot, Section, Table, Tone};
use super::super::numbers::{count, mm, or_dash, px};
use crate::board::Board;
use crate::calibration::result::{CalibrationResult, PoseCamera, PoseResult};
use crate::calibration::settings::PoseKind;
use crate::geometry::Camera;

/// The word for what a pose is for.
pub(in crate::report) fn kind_name(kind: PoseKind) -> &'static str {
    match kind {
        PoseKind::Intrinsics => "intrinsics",
        PoseKind::HandEye => "hand-eye",
        PoseKind::Distance => "distance",
    }
}

/// The table, with a summary before it.
pub(super) fn section(result: &CalibrationResult) -> Section {
    if result.poses.is_empty() {
        return Section::absent("Poses", "the session reached no pose");
    }
    let cameras: BTreeSet<Camera> = result.poses.iter().flat_map(|p| p.cameras.keys().copied()).collect();
    let titles: Vec<String> = ["<pose", "<kind", "<used"]
        .into_iter()
        .map(str::to_owned)
        .chain(cameras.iter().flat_map(|c| [format!("{c} n"), format!("{c} px")]))
        .chain(["scatter".into(), "<reason".into()])
        .collect();
    let mut table = Table::new(&titles.iter().map(String::as_str).collect::<Vec<_>>());
    for pose in &result.poses {
        table.toned(tone(pose), cells(pose, &cameras));
    }
    let legend = format!(
        "n: corners found of {}. px: rms over those corners; in brackets where the view was rejected. scatter: distance of \
         the target from its mean place, mm, for poses of the hand-eye fit.",
        corner_count(&result.provenance.board)
    );
    Section::new(
        "Poses",
        vec![Block::Text(summary(result)), Block::Plot(Plot::ViewRms), Block::Note(legend), Block::Table(table)],
    )
}

fn tone(pose: &PoseResult) -> Tone {
    match (pose.used, &pose.reason) {
        (false, _) => Tone::Bad,
        (true, Some(_)) => Tone::Alert,
        (true, None) => Tone::Plain,
    }
}

fn cells(pose: &PoseResult, cameras: &BTreeSet<Camera>) -> Vec<String> {
    let mut cells = vec![pose.pose_id.clone(), kind_name(pose.kind).into()];
    cells.push(if pose.used { "yes" } else { "NO" }.into());
    for camera in cameras {
        let seen = pose.cameras.get(camera);
        cells.push(seen.map_or_else(|| "-".into(), |s| s.corners.to_string()));
        cells.push(seen.map_or_else(|| "-".into(), rms));
    }
    cells.push(or_dash(pose.hand_eye_residual_m, mm));
    cells.push(pose.reason.clone().unwrap_or_default());
    cells
}

fn rms(seen: &PoseCamera) -> String {
    match (seen.rms_px, seen.used) {
        (Some(rms_px), true) => px(rms_px),
        (Some(rms_px), false) => format!("({})", px(rms_px)),
        (None, _) => "-".into(),
    }
}

fn summary(result: &CalibrationResult) -> String {
    let of_kind = |kind: PoseKind| result.poses.iter().filter(|p| p.kind == kind).count();
    let kinds = [PoseKind::Intrinsics, PoseKind::HandEye, PoseKind::Distance];
    let parts = kinds.map(|k| (of_kind(k), kind_name(k))).into_iter().filter(|(n, _)| *n > 0);
    let parts: Vec<String> = parts.map(|(n, name)| format!("{n} {name}")).collect();
    let all = result.poses.len();
    let unused: Vec<&str> = result.poses.iter().filter(|p| !p.used).map(|p| p.pose_id.as_str()).collect();
    let unused = if unused.is_empty() { String::new() } else { format!(", not used: {}", unused.join(", ")) };
    let used = result.poses.iter().filter(|p| p.used).count();
    format!("{} ({}); {used} used{unused}.", count(all, "pose"), parts.join(", "))
}

/// As [`Board::corner_count`], for a board that nobody has checked.
fn corner_count(board: &Board) -> u64 {
    u64::from(board.squares_x.saturating_sub(1)) * u64::from(board.squares_y.saturating_sub(1))
}
