//! What a rehearsal came to: every pose with the time to stillness and what was measured there.

use serde_json::json;

use super::{Exit, exit, print};
use crate::plan::Plan;
use crate::session::{Outcome, PoseRecord};

/// Prints the poses of a rehearsal; the exit code says how it ended.
pub(super) fn finish(outcome: &Outcome, plan: &Plan, json: bool, notes: &[String]) -> anyhow::Result<Exit> {
    let reached = outcome.poses.iter().filter(|p| p.capture.is_some()).count();
    let rows = plan.poses.iter().map(|p| p.id.as_str()).zip(&outcome.poses);
    if json {
        let poses: Vec<_> = rows.map(|(id, record)| pose_json(id, record)).collect();
        let report = json!({ "poses": poses, "reached": reached, "total": outcome.poses.len() });
        print(&format!("{}\n", serde_json::to_string_pretty(&report)?))?;
    } else {
        // Before the first pose there is nothing to list.
        let shown = rows.filter(|_| reached > 0);
        let mut text: String = shown.map(|(id, record)| pose_line(id, record)).collect();
        text.push_str(&format!("rehearsal: {reached} of {} poses reached\n", outcome.poses.len()));
        print(&text)?;
    }
    let ended = exit::of_end(&outcome.end).unwrap_or(Exit::Ok);
    let loss = reached < outcome.poses.len() || !notes.is_empty();
    Ok(if ended == Exit::Ok && loss { Exit::Warnings } else { ended })
}

fn pose_json(id: &str, record: &PoseRecord) -> serde_json::Value {
    let mut pose = json!({ "pose_id": id, "reached": record.capture.is_some() });
    let parts = [
        ("stationarity", serde_json::to_value(&record.evidence).ok()),
        ("base_from_tcp", serde_json::to_value(record.base_from_tcp).ok()),
        ("joints_rad", serde_json::to_value(record.joints_rad).ok()),
        ("reason", serde_json::to_value(&record.skipped).ok()),
    ];
    for (key, value) in parts {
        if let Some(value) = value.filter(|v| !v.is_null()) {
            pose[key] = value;
        }
    }
    pose
}

fn pose_line(id: &str, record: &PoseRecord) -> String {
    match (&record.evidence, &record.skipped) {
        (Some(evidence), _) => {
            let [speed, spread] = [evidence.max_joint_speed_rad_s, evidence.max_joint_spread_rad];
            let shown = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), |v| format!("{v:.1e}"));
            format!("{id}: still, joint speed at most {} rad/s, spread {} rad\n", shown(speed), shown(spread))
        }
        (None, why) => format!("{id}: {}\n", why.as_deref().unwrap_or("no reason is known")),
    }
}
