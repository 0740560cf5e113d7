//! Where the camera is, what the other solvers say, and whether the poses could tell.

use super::super::document::{Block, Plot, Section, Table, Tone};
use super::super::numbers::{count, deg, fixed, mm, rotation_deg, signed_mm, translation_mm};
use super::gates::{self, Gated};
use super::{fact, why};
use crate::calibration::adjust::{LoopFacts, RobotTie};
use crate::calibration::hand_eye::{HandEyeMethod, Uncertainty};
use crate::calibration::observability::{Axis, MAX_CONDITION, MIN_ROTATION_RAD, MIN_SECOND_EIGENVALUE, Observability};
use crate::calibration::result::{CalibrationResult, HandEyeResult};
use crate::calibration::settings::PoseKind;
use crate::geometry::{Camera, Transform};

/// Smallest second eigenvalue of the pose sets that are known to be healthy.
const HEALTHY_EIGENVALUE: f64 = 0.137;
/// Largest condition of those sets.
const HEALTHY_CONDITION: f64 = 2.6;

/// Where camera and target are, with the uncertainty.
pub(super) fn place(result: &CalibrationResult) -> Section {
    let Some(hand_eye) = &result.hand_eye else {
        return Section::absent("Hand-eye", why(result, "hand_eye", "no robot poses enter this session"));
    };
    let camera = hand_eye.reference_camera;
    let sigma = hand_eye.uncertainty.as_ref();
    let mut blocks: Vec<Block> = [
        hand_eye.base_from_camera.map(|t| transform(&format!("base_from_{camera}"), &t, sigma)),
        hand_eye.tcp_from_camera.map(|t| transform(&format!("tcp_from_{camera}"), &t, sigma)),
    ]
    .into_iter()
    .flatten()
    .collect();
    blocks.push(Block::Facts(facts(result, hand_eye)));
    blocks.push(Block::Note(
        "The sigma is what changes when poses are left out. It does not see what all poses share: a wrong square size, \
         wrong intrinsics, a robot whose kinematics are off."
            .into(),
    ));
    blocks.extend(hand_eye.tcp_from_target.map(|t| transform("tcp_from_target", &t, None)));
    blocks.extend(hand_eye.base_from_target.map(|t| transform("base_from_target", &t, None)));
    blocks.push(Block::Plot(Plot::Layout));
    Section::new(title(hand_eye), blocks)
}

fn title(hand_eye: &HandEyeResult) -> String {
    let camera = match hand_eye.reference_camera {
        Camera::Rgb => "frame camera (rgb)",
        Camera::Event => "event camera",
    };
    match hand_eye.tcp_from_camera {
        Some(_) => format!("Hand-eye: where the {camera} sits on the tool"),
        None => format!("Hand-eye: where the {camera} stands"),
    }
}

/// A table of a transform, with its sigma where there is one.
fn transform<A, B>(name: &str, transform: &Transform<A, B>, sigma: Option<&Uncertainty>) -> Block {
    let mut table = Table::new(&[&format!("<{name}"), "x", "y", "z"]);
    let mut row = |title: &str, values: [String; 3]| table.row(std::iter::once(title.to_owned()).chain(values));
    row("translation, mm", translation_mm(transform));
    if let Some(sigma) = sigma {
        row("± sigma, mm", sigma.translation_sigma_m.map(|s| format!("± {}", mm(s))));
    }
    row("rotation vector, deg", rotation_deg(transform));
    if let Some(sigma) = sigma {
        row("± sigma, deg, all axes", [format!("± {}", deg(sigma.rotation_sigma_rad)), String::new(), String::new()]);
    }
    Block::Table(table)
}

fn facts(result: &CalibrationResult, hand_eye: &HandEyeResult) -> Vec<(String, String)> {
    let wanted = result.poses.iter().filter(|p| p.kind == PoseKind::HandEye).count();
    let rejected = wanted.saturating_sub(hand_eye.poses_used);
    let poses = count(hand_eye.poses_used, "pose");
    let mut facts = vec![
        fact("method", hand_eye.method.name()),
        fact(
            "scatter of target",
            format!("rms {} mm over {poses}, {rejected} of {wanted} rejected", mm(hand_eye.scatter_rms_m)),
        ),
    ];
    facts.extend(hand_eye.refined.iter().flat_map(refined));
    match &hand_eye.uncertainty {
        Some(uncertainty) => facts.extend(influence(uncertainty)),
        None => facts.push(fact("uncertainty", "absent: everything hangs on one pose, so it cannot be told")),
    }
    facts
}

/// What the adjustment says about the arm and about points that the camera sees.
fn refined(found: &LoopFacts) -> Vec<(String, String)> {
    let tie = match found.robot_tie {
        RobotTie::Joint => "solved together with the cameras",
        RobotTie::AfterCameras => "solved after the cameras, which the arm would have pulled away",
    };
    let noise =
        format!("{} mm, {} deg along and about each axis; {tie}", mm(found.robot_sigma_m), deg(found.robot_sigma_rad));
    let largest = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
    let point = largest(&mut found.points.iter().map(|p| p.error_95_m));
    let image = largest(&mut found.image.iter().map(|p| p.error_95_px));
    let reach =
        format!("a point {} mm, its image {} px, at the worst corner of the space seen", mm(point), fixed(image, 2));
    vec![fact("noise of the arm", noise), fact("error, 95 %", reach)]
}

fn influence(uncertainty: &Uncertainty) -> Vec<(String, String)> {
    let Uncertainty { poses, scatter_m, culprit, most_influential: influential, .. } = uncertainty;
    vec![
        fact("uncertainty", format!("jackknife: {} left out one at a time", count(*poses, "pose"))),
        fact(
            "worst pose",
            format!(
                "{}: without it the scatter goes from {} to {} mm and the camera moves {} mm, {} deg",
                culprit.pose_id,
                mm(*scatter_m),
                mm(culprit.scatter_without_m),
                mm(culprit.translation_change_m),
                deg(culprit.rotation_change_rad)
            ),
        ),
        fact(
            "most influence",
            format!(
                "{}: without it the camera moves {} mm, {} deg",
                influential.pose_id,
                mm(influential.translation_change_m),
                deg(influential.rotation_change_rad)
            ),
        ),
    ]
}

/// One answer of the panel against the chosen one.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::report) struct PanelRow {
    pub(in crate::report) method: HandEyeMethod,
    /// Along the axes of the frame of the result, m.
    pub(in crate::report) difference_m: [f64; 3],
    pub(in crate::report) distance_m: f64,
    pub(in crate::report) angle_rad: f64,
}

/// The panel against the chosen answer; solvers whose entry is no transform are missing.
pub(in crate::report) fn panel_rows(hand_eye: &HandEyeResult) -> Vec<PanelRow> {
    let rows = hand_eye.panel.iter().filter_map(|(method, value)| {
        match (&hand_eye.base_from_camera, &hand_eye.tcp_from_camera) {
            (Some(chosen), _) => Some(panel_row(*method, chosen, &serde_json::from_value(value.clone()).ok()?)),
            (None, Some(chosen)) => Some(panel_row(*method, chosen, &serde_json::from_value(value.clone()).ok()?)),
            (None, None) => None,
        }
    });
    rows.collect()
}

fn panel_row<A, B>(method: HandEyeMethod, chosen: &Transform<A, B>, other: &Transform<A, B>) -> PanelRow {
    let difference = other.iso().translation.vector - chosen.iso().translation.vector;
    let (distance_m, angle_rad) = (other.distance_to_m(chosen), other.angle_to_rad(chosen));
    PanelRow { method, difference_m: difference.into(), distance_m, angle_rad }
}

/// What each solver found.
pub(super) fn panel(result: &CalibrationResult) -> Section {
    let Some(hand_eye) = &result.hand_eye else {
        return Section::absent("Solver panel", "there is no hand-eye result");
    };
    let chosen = hand_eye.method.name();
    let mut table = Table::new(&["<solver", "dx mm", "dy mm", "dz mm", "distance mm", "angle deg", "<note"]);
    for row in panel_rows(hand_eye) {
        let [x, y, z] = row.difference_m.map(signed_mm);
        let note = match row.method == hand_eye.method {
            true => "the result",
            false if row.method.counts_in_spread() => "",
            false => "not in the spread: the most sensitive to noise",
        };
        let cells = [row.method.name().into(), x, y, z, mm(row.distance_m), deg(row.angle_rad), note.to_owned()];
        table.row(cells);
    }
    for (method, reason) in &hand_eye.panel_failed {
        let dash = || "-".to_owned();
        let cells = [method.name().into(), dash(), dash(), dash(), dash(), dash(), format!("failed: {reason}")];
        table.toned(Tone::Alert, cells);
    }
    let spread = hand_eye.panel_spread_m.map_or_else(
        || "absent: fewer than two solvers found an answer".to_owned(),
        |s| {
            let gate = Some(gates::text(result, Gated::PanelSpread)).filter(|g| !g.is_empty());
            let gate = gate.map_or_else(String::new, |g| format!("; gate {g}"));
            format!("{} mm between the two solvers farthest apart{gate}", mm(s))
        },
    );
    let blocks = vec![
        Block::Text(format!("What each solver found for the camera, against {chosen}, over the same {}.", count(hand_eye.poses_used, "pose"))),
        Block::Table(table),
        Block::Facts(vec![fact("spread", spread)]),
        Block::Note(
            "On healthy poses the choice of solver hardly matters, so solvers that disagree are an alarm; solvers that \
             agree prove little, because they share poses, intrinsics and board."
                .into(),
        ),
        Block::Plot(Plot::Panel),
    ];
    Section::new("Solver panel", blocks)
}

/// Whether the poses could tell where the camera is.
pub(super) fn observability(result: &CalibrationResult) -> Section {
    let Some(hand_eye) = &result.hand_eye else {
        return Section::absent("Observability", "there is no hand-eye result");
    };
    let found = &hand_eye.observability;
    let Observability { poses, second_eigenvalue, condition, largest_rotation_rad, axes_frame, .. } = found;
    let mut table = Table::new(&["<quantity", "found", "refused", "healthy"]);
    let below = format!("below {MIN_SECOND_EIGENVALUE}");
    let healthy = format!("{HEALTHY_EIGENVALUE} or more");
    table.row(["second eigenvalue of the rotation axes", &fixed(*second_eigenvalue, 3), &below, &healthy]);
    let (above, healthy) = (format!("above {MAX_CONDITION}"), format!("{HEALTHY_CONDITION} or less"));
    table.row(["condition of the translation", &fixed(*condition, 2), &above, &healthy]);
    let (largest, below) = (fixed(largest_rotation_rad.to_degrees(), 1), fixed(MIN_ROTATION_RAD.to_degrees(), 0));
    table.row(["largest rotation between two poses, deg", &largest, &format!("below {below}"), "-"]);
    let words = match (found.check(), is_healthy(found)) {
        (Err(error), _) => format!("REFUSED: {error}"),
        (Ok(()), true) => format!("Healthy: the {} turn about clearly different axes.", count(*poses, "pose")),
        (Ok(()), false) => format!(
            "Weak: the {} can be solved, but turn mostly about {} of {axes_frame}; more turns about {} would help.",
            count(*poses, "pose"),
            Axis(found.main_axis),
            Axis(found.second_axis)
        ),
    };
    Section::new("Observability", vec![Block::Text(words), Block::Table(table)])
}

fn is_healthy(found: &Observability) -> bool {
    found.second_eigenvalue >= HEALTHY_EIGENVALUE && found.condition <= HEALTHY_CONDITION
}
