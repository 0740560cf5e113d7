//! The error of the target check at every pose, with the gates.

use super::super::numbers::{mm, signed_mm};
use super::Figure;
use super::svg::{Anchor, Scale, Svg, clipped, tick_text};
use crate::calibration::result::CalibrationResult;
use crate::calibration::settings::Gates;

const WIDTH: f64 = 960.0;
const LEFT: f64 = 52.0;
const TOP: f64 = 30.0;
const BOTTOM: f64 = 270.0;
const HEIGHT: f64 = 350.0;
/// Narrowest distance of two labels of poses.
const LABEL_PX: f64 = 13.0;

struct Point {
    pose_id: String,
    error_mm: f64,
    left_out_mm: Option<f64>,
    held_out: bool,
}

struct Errors {
    /// What the errors are against.
    against: &'static str,
    points: Vec<Point>,
    /// Value in mm and name of each line.
    gates: Vec<(f64, String)>,
    /// Mean of the errors, mm, where it is not zero by definition.
    mean_mm: Option<f64>,
}

/// Draws whichever of the two target checks there is.
pub(super) fn draw(result: &CalibrationResult) -> Option<Figure> {
    let errors = to_tcp(result).or_else(|| in_base(result))?;
    let values = || errors.points.iter().flat_map(|p| [Some(p.error_mm), p.left_out_mm]).flatten();
    let finite = values().chain(errors.gates.iter().map(|g| g.0)).filter(|v| v.is_finite());
    let (low, high) = finite.fold((0.0_f64, 0.0_f64), |(l, h), v| (l.min(v), h.max(v)));
    let margin = 0.08 * (high - low).max(0.1);
    let low = if low < 0.0 { low - margin } else { 0.0 };
    let y = Scale { low, high: high + margin, from: BOTTOM, to: TOP };
    let mut svg = Svg::new(WIDTH, HEIGHT);
    axis(&mut svg, &y);
    gates(&mut svg, &y, &errors.gates);
    if let Some(mean_mm) = errors.mean_mm {
        svg.line("mean", [LEFT, y.at(mean_mm)], [WIDTH, y.at(mean_mm)]);
    }
    points(&mut svg, &y, &errors.points);
    let caption = format!(
        "Target check: error at every pose, mm, {}. Filled: poses of the hand-eye fit; bar: the same pose measured with the answer \
         of all others. Hollow: poses held out of the fit. Dotted: mean of all. Dashed: gate on \
         the error of a pose.",
        errors.against
    );
    Some(Figure { drawings: vec![svg.finish(&caption)], caption, wide: true })
}

fn to_tcp(result: &CalibrationResult) -> Option<Errors> {
    let check = result.checks.target_to_tcp.as_ref()?;
    let reference_m = check.truth_m.unwrap_or(check.mean_m);
    let against = if check.truth_m.is_some() {
        "against the mechanical distance"
    } else {
        "against the mean (no truth is known)"
    };
    let points = check.per_pose.iter().map(|p| Point {
        pose_id: p.pose_id.clone(),
        error_mm: (p.distance_m - reference_m) * 1e3,
        left_out_mm: p.leave_one_out_m.map(|d| (d - reference_m) * 1e3),
        held_out: p.held_out,
    });
    let gates = result.provenance.gates.as_ref().map(gate_lines).unwrap_or_default();
    let gates = if check.truth_m.is_some() { gates } else { Vec::new() };
    Some(Errors { against, points: points.collect(), gates, mean_mm: check.bias_m.map(|b| b * 1e3) })
}

/// The gate on the largest error, on both sides of zero; those on mean and sigma are not about single poses.
fn gate_lines(gates: &Gates) -> Vec<(f64, String)> {
    let line = |m: f64| (m * 1e3, format!("gate {} mm", signed_mm(m)));
    gates.target_to_tcp_max_m.into_iter().flat_map(|m| [line(m), line(-m)]).collect()
}

fn in_base(result: &CalibrationResult) -> Option<Errors> {
    let check = result.checks.target_in_base.as_ref()?;
    let points = check.per_pose.iter().map(|p| Point {
        pose_id: p.pose_id.clone(),
        error_mm: p.error_m * 1e3,
        left_out_mm: None,
        held_out: p.held_out,
    });
    Some(Errors { against: "distance from the mean place", points: points.collect(), gates: Vec::new(), mean_mm: None })
}

fn axis(svg: &mut Svg, y: &Scale) {
    let ticks = y.ticks(6);
    for tick in &ticks {
        let class = if *tick == 0.0 { "zero" } else { "grid" };
        svg.line(class, [LEFT, y.at(*tick)], [WIDTH, y.at(*tick)]);
        svg.text("tick", [LEFT - 6.0, y.at(*tick) + 4.0], Anchor::End, &tick_text(*tick, &ticks));
    }
    svg.text("tick", [LEFT - 6.0, TOP - 14.0], Anchor::End, "mm");
}

fn gates(svg: &mut Svg, y: &Scale, gates: &[(f64, String)]) {
    for (value, name) in gates {
        let at = y.at(*value);
        svg.line("gate", [LEFT, at], [WIDTH, at]);
        let below = if *value < 0.0 { 12.0 } else { -4.0 };
        svg.text("gate-name", [WIDTH - 2.0, at + below], Anchor::End, name);
    }
}

fn points(svg: &mut Svg, y: &Scale, points: &[Point]) {
    let step = (WIDTH - LEFT) / points.len().max(1) as f64;
    let every = (LABEL_PX / step).ceil().max(1.0) as usize;
    let radius = (step * 0.3).clamp(1.5, 5.0);
    for (i, point) in points.iter().enumerate() {
        let x = LEFT + (i as f64 + 0.5) * step;
        let at = y.at(point.error_mm);
        svg.line("stem", [x, y.at(0.0)], [x, at]);
        let without = point.left_out_mm.map_or_else(String::new, |v| format!(", leave-one-out {} mm", mm(v / 1e3)));
        if let Some(left_out_mm) = point.left_out_mm {
            let reach = radius + 2.5;
            svg.line("without", [x - reach, y.at(left_out_mm)], [x + reach, y.at(left_out_mm)]);
        }
        let (class, kind) = if point.held_out { ("held", "held out") } else { ("fit", "in the fit") };
        let hint = format!("{}: {} mm, {kind}{without}", point.pose_id, signed_mm(point.error_mm / 1e3));
        svg.circle(class, [x, at], radius, &hint);
        if i % every == 0 {
            svg.turned("tick", [x + 3.5, BOTTOM + 10.0], Anchor::End, -90.0, &clipped(&point.pose_id, 12));
        }
    }
}
