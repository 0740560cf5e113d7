//! `cellcal check`: a cell and its trajectories, without hardware.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::cell::{load, observability_of};
use super::{Exit, print};
use crate::calibration::settings::PoseKind;
use crate::cv::charuco;
use crate::plan::{Coverage, coverage};
use crate::runner::setup::Planned;

/// Checks a cell, its trajectories, reach, limits and duration; needs no hardware.
#[derive(Debug, Args)]
pub(super) struct Check {
    /// The cell file.
    cell: PathBuf,
    /// As JSON.
    #[arg(long)]
    json: bool,
}

impl Check {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        let Planned { cell, plan, setup } = load(&self.cell)?.plan()?;
        charuco::check_dictionary(&cell.board)?;
        let (found, refused) = observability_of(&cell, &plan);
        let seen = if plan.poses.is_empty() { Vec::new() } else { coverage(&cell, &plan) };
        let advice: Vec<String> = seen.iter().flat_map(Coverage::advice).collect();
        let count = |kind| plan.poses.iter().filter(|p| p.kind == kind).count();
        let counts = [PoseKind::Intrinsics, PoseKind::HandEye, PoseKind::Distance].map(count);
        if self.json {
            let report = json!({
                "cell": cell.name, "poses": plan.poses.len(), "duration_s": plan.duration_s,
                "intrinsics_poses": counts[0], "hand_eye_poses": counts[1], "distance_poses": counts[2],
                "pairs": setup.pairs.len(), "warnings": plan.warnings,
                "observability": found, "refused": refused, "coverage": seen, "advice": advice,
            });
            print(&format!("{}\n", serde_json::to_string_pretty(&report)?))?;
        } else {
            let [intrinsics, for_arm, distance] = counts;
            let mut text = format!(
                "cell {}: {} poses ({intrinsics} intrinsics, {for_arm} hand-eye, {distance} distance), about {:.0} s of robot time\n",
                cell.name,
                plan.poses.len(),
                plan.duration_s
            );
            text.extend(found.iter().map(|o| {
                let (second, condition) = (o.second_eigenvalue, o.condition);
                format!("observability: second eigenvalue {second:.3} (at least 0.02), condition {condition:.2} (at most 20)\n")
            }));
            text.extend(seen.iter().map(|c| format!("{}\n", c.summary())));
            text.extend(plan.warnings.iter().map(|w| format!("warning: {w}\n")));
            text.extend(advice.iter().map(|a| format!("advice: {a}\n")));
            text.extend(refused.iter().map(|w| format!("refused: {w}\n")));
            text.push_str(if refused.is_none() { "ok\n" } else { "" });
            print(&text)?;
        }
        Ok(if refused.is_some() { Exit::Usage } else { Exit::Ok })
    }
}
