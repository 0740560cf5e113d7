//! How well the models of the arm explain what its controller says.

use super::super::document::{Block, Section, Table};
use super::super::numbers::{fixed, mm};
use super::fact;
use crate::calibration::kinematics::{ConstantPart, ModelMismatch};
use crate::calibration::result::CalibrationResult;

/// Distances of the models from the controller's own poses of the flange; absent without a robot.
pub(super) fn section(result: &CalibrationResult) -> Option<Section> {
    let kinematics = result.kinematics.as_ref()?;
    let mut table = Table::new(&["<model", "mean", "largest", "mean angle", "largest angle", "<worst pose"]);
    let models = [("controller's parameters", &kinematics.controller_dh), ("URDF", &kinematics.urdf)];
    for (name, model) in models {
        if let Some(model) = model {
            table.row(row(name, model, result));
        }
    }
    let mut blocks = vec![Block::Table(table)];
    if let Some(ConstantPart { transform, rest_mean_m, rest_max_m }) = &kinematics.urdf_from_controller {
        let [x, y, z] = transform.translation_m().map(mm);
        let angle = fixed(transform.rotation_angle_rad().to_degrees(), 3);
        blocks.push(Block::Facts(vec![
            fact("one rigid motion of the URDF's base explains", format!("{x}, {y}, {z} mm and {angle} deg")),
            fact("and leaves", format!("mean {} mm, largest {} mm", mm(*rest_mean_m), mm(*rest_max_m))),
        ]));
    }
    let notes: Vec<_> = kinematics.not_computed.iter().map(|(what, why)| format!("{what}: {why}")).collect();
    if !notes.is_empty() {
        blocks.push(Block::List(notes));
    }
    blocks.push(Block::Text(
        "The controller's own pose is what counts; a URDF of the nominal arm is millimetres off. Write one of this \
         arm with `cellcal robot urdf`."
            .into(),
    ));
    Some(Section::new("Robot kinematics", blocks))
}

fn row(name: &str, model: &ModelMismatch, result: &CalibrationResult) -> [String; 6] {
    let degrees = |radians: f64| format!("{} deg", fixed(radians.to_degrees(), 4));
    let worst = result.poses.get(model.worst_pose).map_or_else(|| "?".to_owned(), |p| p.pose_id.clone());
    [
        name.into(),
        format!("{} mm", mm(model.mean_m)),
        format!("{} mm", mm(model.max_m)),
        degrees(model.mean_rad),
        degrees(model.max_rad),
        worst,
    ]
}
