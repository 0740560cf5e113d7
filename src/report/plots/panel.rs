//! What each solver found, against the chosen one.

use super::super::numbers::{deg, fixed, mm};
use super::super::sections::{PanelRow, panel_rows};
use super::Figure;
use super::svg::{Anchor, Scale, Svg, tick_text};
use crate::calibration::hand_eye::HandEyeMethod;
use crate::calibration::result::CalibrationResult;

const WIDTH: f64 = 460.0;
const LEFT: f64 = 84.0;
const RIGHT: f64 = 400.0;
const TOP: f64 = 26.0;
const ROW: f64 = 26.0;

/// Draws distance and angle side by side; `None` for fewer than two solvers.
pub(super) fn draw(result: &CalibrationResult) -> Option<Figure> {
    let hand_eye = result.hand_eye.as_ref()?;
    let rows = panel_rows(hand_eye);
    if rows.len() < 2 {
        return None;
    }
    let chosen = hand_eye.method;
    let distance: Vec<_> = rows.iter().map(|r| (r.distance_m * 1e3, format!("{} mm", mm(r.distance_m)))).collect();
    let angle: Vec<_> = rows.iter().map(|r| (r.angle_rad.to_degrees(), format!("{} deg", deg(r.angle_rad)))).collect();
    let name = chosen.name();
    let distance = bars(&rows, chosen, &distance, &format!("distance from {name}, mm"));
    let angle = bars(&rows, chosen, &angle, &format!("angle to {name}, deg"));
    let caption = format!("Solver panel: place and direction of the camera as each solver has them, against {name}.");
    Some(Figure { drawings: vec![distance, angle], caption, wide: false })
}

fn bars(rows: &[PanelRow], chosen: HandEyeMethod, values: &[(f64, String)], title: &str) -> String {
    let bottom = TOP + ROW * rows.len() as f64;
    let mut svg = Svg::new(WIDTH, bottom + 24.0);
    let largest = values.iter().map(|v| v.0).filter(|v| v.is_finite()).fold(0.0, f64::max);
    let x = Scale { low: 0.0, high: if largest > 0.0 { largest } else { 1.0 }, from: LEFT, to: RIGHT };
    let ticks = x.ticks(4);
    for tick in &ticks {
        svg.line(if *tick == 0.0 { "zero" } else { "grid" }, [x.at(*tick), TOP], [x.at(*tick), bottom]);
        svg.text("tick", [x.at(*tick), bottom + 15.0], Anchor::Middle, &tick_text(*tick, &ticks));
    }
    svg.text("name", [LEFT, TOP - 9.0], Anchor::Start, title);
    for ((i, row), (value, text)) in rows.iter().enumerate().zip(values) {
        let middle = TOP + ROW * (i as f64 + 0.5);
        svg.text("label", [LEFT - 8.0, middle + 4.0], Anchor::End, row.method.name());
        let text = if row.method == chosen { "the result" } else { text };
        svg.rect("event", [LEFT, middle - 7.0], [x.at(*value) - LEFT, 14.0], text);
        let text = if row.method == chosen { text.to_owned() } else { fixed(*value, 3) };
        svg.text("tick", [x.at(*value) + 5.0, middle + 4.0], Anchor::Start, &text);
    }
    svg.finish(title)
}
