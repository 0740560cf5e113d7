//! A proposed tour as the text of a trajectory file.

use std::fmt::Write as _;

use super::trajectory::BoardView;
use super::write::{fixed, push_comments, scalar};
use crate::calibration::settings::PoseKind;
use crate::geometry::{Camera, rotation};

/// A stop of a tour, or a pair of stops.
#[derive(Debug, Clone, PartialEq)]
pub enum TourPart {
    /// A view of the board.
    View {
        /// What it is for.
        purpose: PoseKind,
        /// How the board lies before the camera.
        view: BoardView,
    },
    /// Two stops for the distance check, a known displacement apart.
    Pair {
        /// Name of the pair: letters, digits, `-` and `_`.
        name: String,
        /// The view at the first stop.
        start: BoardView,
        /// From the first TCP position to the second, in `base`, metres.
        displacement_m: [f64; 3],
    },
}

impl TourPart {
    fn purpose(&self) -> PoseKind {
        match self {
            Self::View { purpose, .. } => *purpose,
            Self::Pair { .. } => PoseKind::Distance,
        }
    }
}

/// The text of a trajectory file that visits these parts in this order; the views are for `camera`.
///
/// Millimetres and degrees are written to a thousandth. Each line of `header` becomes a comment at the top.
pub fn tour_yaml(name: &str, camera: Camera, parts: &[TourPart], header: &[String]) -> String {
    let mut text = String::from("# yaml-language-server: $schema=../.schema/trajectory.json\n");
    push_comments(&mut text, "", header);
    text.push_str(&format!("name: {}\nsegments:\n", scalar(name)));
    let mut before = None;
    for part in parts {
        let purpose = part.purpose();
        let is_pair = matches!(part, TourPart::Pair { .. });
        if is_pair || before != Some(purpose) {
            push_segment(&mut text, camera, purpose, is_pair);
        }
        push_part(&mut text, part);
        // Pairs stand alone; what follows begins a segment of its own.
        before = (!is_pair).then_some(purpose);
    }
    text
}

fn push_segment(text: &mut String, camera: Camera, purpose: PoseKind, is_pair: bool) {
    let [pattern, list] = if is_pair { ["translate", "pairs"] } else { ["views", "poses"] };
    let purpose = match purpose {
        PoseKind::Intrinsics => "intrinsics",
        PoseKind::HandEye => "hand_eye",
        PoseKind::Distance => "distance",
    };
    text.push_str(&format!("  - pattern: {pattern}\n    purpose: {purpose}\n    camera: {camera}\n    {list}:\n"));
}

fn push_part(text: &mut String, part: &TourPart) {
    // Writing to a string cannot fail.
    let _ = match part {
        TourPart::View { view, .. } => writeln!(text, "      - view: {}", view_text(view)),
        TourPart::Pair { name, start, displacement_m } => {
            let by = triple(displacement_m.map(|v| v * 1e3));
            let (name, start) = (scalar(name), view_text(start));
            writeln!(text, "      - {{name: {name}, start: {{view: {start}}}, displacement_mm: {by}}}")
        }
    };
}

fn view_text(view: &BoardView) -> String {
    let turn = rotation::to_vector(&view.rotation).map(f64::to_degrees);
    format!("{{centre_mm: {}, rotvec_deg: {}}}", triple(view.centre_m.map(|v| v * 1e3)), triple(turn.into()))
}

/// Three numbers to a thousandth, as short as they are.
fn triple(values: [f64; 3]) -> String {
    let short = |v: f64| {
        let text = fixed(v, 3);
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    };
    format!("[{}]", values.map(short).join(", "))
}
