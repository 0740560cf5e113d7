//! A cell file with every file that it names, and what can be said about its poses before any motion.

use std::path::Path;

use super::exit::UsageError;
use super::read_text;
use crate::calibration::observability::{self, Observability};
use crate::calibration::settings::{Carried, PoseKind};
use crate::config::{Cell, IntrinsicsSource};
use crate::plan::Plan;
use crate::runner::setup::CellTexts;

/// Reads a cell and every file that it names.
pub(super) fn load(cell: &Path) -> anyhow::Result<CellTexts> {
    let text = read_text(cell)?;
    let name = cell.display().to_string();
    let parsed = crate::config::parse_cell(&text, &name)?;
    let folder = cell.parent().unwrap_or(Path::new("."));
    let mut trajectories = Vec::new();
    for used in &parsed.trajectories {
        let path = folder.join(&used.file);
        let text = std::fs::read_to_string(&path).map_err(|why| {
            UsageError(format!(
                "{name}: trajectories: {}: {why}; the path is relative to the cell file",
                path.display()
            ))
        })?;
        trajectories.push((used.file.clone(), text));
    }
    let beside = |key: &str, file: &String| {
        let path = folder.join(file);
        let text = std::fs::read_to_string(&path)
            .map_err(|why| UsageError(format!("{name}: {key}: {}: {why}", path.display())))?;
        Ok::<_, UsageError>((path.display().to_string(), text))
    };
    let intrinsics = match &parsed.intrinsics {
        IntrinsicsSource::Solve => None,
        IntrinsicsSource::From(file) => Some(beside("intrinsics", file)?),
    };
    let urdf = parsed.robot.urdf.as_ref().map(|file| beside("robot.urdf", file)).transpose()?;
    Ok(CellTexts { cell: (name, text), folder: folder.into(), trajectories, intrinsics, urdf })
}

/// How well the hand-eye poses span space, and why they would be refused; neither where there are none.
pub(super) fn observability_of(cell: &Cell, plan: &Plan) -> (Option<Observability>, Option<String>) {
    let for_arm = plan.poses.iter().filter(|p| p.kind == PoseKind::HandEye);
    let poses: Vec<_> = for_arm.map(|p| p.base_from_tcp).collect();
    if poses.is_empty() {
        return (None, None);
    }
    let found = match cell.carried {
        Carried::Target => observability::carried_target(&poses),
        Carried::Cameras => observability::carried_cameras(&poses),
    };
    match found {
        Ok(observability) => {
            let refused = observability.check().err().map(|e| e.to_string());
            (Some(observability), refused)
        }
        Err(error) => (None, Some(error.to_string())),
    }
}
