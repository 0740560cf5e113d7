//! The reprojection error of every view, one strip for each camera.

use super::super::numbers::px;
use super::super::sections::kind_name;
use super::Figure;
use super::svg::{Anchor, Scale, Svg, clipped, tick_text};
use crate::calibration::result::{CalibrationResult, PoseResult};
use crate::geometry::Camera;

const WIDTH: f64 = 960.0;
const LEFT: f64 = 52.0;
const TOP: f64 = 40.0;
const STRIP: f64 = 120.0;
const BETWEEN: f64 = 34.0;
/// Room for the ids of poses.
const LABELS: f64 = 84.0;
/// Narrowest distance of two labels of poses.
const LABEL_PX: f64 = 13.0;

/// Draws the views of every pose; `None` where no view could be fitted.
pub(super) fn draw(result: &CalibrationResult) -> Option<Figure> {
    let has = |camera: &Camera| result.poses.iter().any(|p| rms_px(p, *camera).is_some());
    let cameras: Vec<Camera> = Camera::BOTH.into_iter().filter(has).collect();
    if cameras.is_empty() {
        return None;
    }
    let bottom = TOP + (STRIP + BETWEEN) * cameras.len() as f64 - BETWEEN;
    let mut svg = Svg::new(WIDTH, bottom + LABELS);
    let step = (WIDTH - LEFT) / result.poses.len().max(1) as f64;
    kinds(&mut svg, &result.poses, step, bottom);
    for (i, camera) in cameras.iter().enumerate() {
        let top = TOP + (STRIP + BETWEEN) * i as f64;
        strip(&mut svg, result, *camera, step, top);
    }
    ids(&mut svg, &result.poses, step, bottom);
    let limit = result.provenance.settings.reject_view_above_px;
    let caption = format!(
        "Reprojection error of every view, px (root of the mean squared distance over its corners). Outlined: views rejected \
         from the camera's solve. Cross: no usable view. Dashed: limit of a view, {limit} px. Bars cut off at the top carry \
         their value."
    );
    Some(Figure { drawings: vec![svg.finish(&caption)], caption, wide: true })
}

fn rms_px(pose: &PoseResult, camera: Camera) -> Option<f64> {
    pose.cameras.get(&camera)?.rms_px.filter(|v| v.is_finite())
}

/// Names the stretches of poses of one kind.
fn kinds(svg: &mut Svg, poses: &[PoseResult], step: f64, bottom: f64) {
    let mut from = 0;
    for stretch in poses.chunk_by(|a, b| a.kind == b.kind) {
        let (x, width) = (LEFT + from as f64 * step, stretch.len() as f64 * step);
        if from > 0 {
            svg.line("divider", [x, TOP - 26.0], [x, bottom]);
        }
        if let Some(first) = stretch.first().filter(|_| width > 60.0) {
            let text = format!("{} ({})", kind_name(first.kind), stretch.len());
            svg.text("tick", [x + width / 2.0, TOP - 26.0], Anchor::Middle, &text);
        }
        from += stretch.len();
    }
}

fn strip(svg: &mut Svg, result: &CalibrationResult, camera: Camera, step: f64, top: f64) {
    let limit = result.provenance.settings.reject_view_above_px;
    let used = result.poses.iter().filter(|p| p.cameras.get(&camera).is_some_and(|c| c.used));
    let largest = used.filter_map(|p| rms_px(p, camera)).fold(0.0, f64::max);
    // An outlier of 20 px must not flatten the others: bars end a little above the limit.
    let high = 1.25 * largest.max(if limit.is_finite() { limit } else { 0.0 }).max(1e-3);
    let y = Scale { low: 0.0, high, from: top + STRIP, to: top };
    let ticks = y.ticks(4);
    for tick in &ticks {
        svg.line(if *tick == 0.0 { "zero" } else { "grid" }, [LEFT, y.at(*tick)], [WIDTH, y.at(*tick)]);
        svg.text("tick", [LEFT - 6.0, y.at(*tick) + 4.0], Anchor::End, &tick_text(*tick, &ticks));
    }
    svg.text("name", [LEFT, top - 6.0], Anchor::Start, &format!("{camera}, px"));
    for (i, pose) in result.poses.iter().enumerate() {
        bar(svg, pose, camera, &y, [LEFT + i as f64 * step, step]);
    }
    svg.line("gate", [LEFT, y.at(limit)], [WIDTH, y.at(limit)]);
}

fn bar(svg: &mut Svg, pose: &PoseResult, camera: Camera, y: &Scale, [left, step]: [f64; 2]) {
    let (middle, width) = (left + step / 2.0, (step * 0.72).min(22.0));
    let Some(rms) = rms_px(pose, camera) else {
        let (at, reach) = (y.from - 5.0, (width / 2.0).min(3.0));
        svg.line("missing", [middle - reach, at - reach], [middle + reach, at + reach]);
        svg.line("missing", [middle - reach, at + reach], [middle + reach, at - reach]);
        return;
    };
    let seen = pose.cameras.get(&camera);
    let used = seen.is_some_and(|c| c.used);
    let corners = seen.map_or(0, |c| c.corners);
    let class = format!("{camera}{}", if used { "" } else { " rejected" });
    let shown = rms.min(y.high);
    let hint =
        format!("{}: {} px over {corners} corners{}", pose.pose_id, px(rms), if used { "" } else { ", rejected" });
    let top = y.at(shown);
    svg.rect(&class, [middle - width / 2.0, top], [width, y.from - top], &hint);
    if rms > y.high {
        svg.text("tick", [middle, y.to - 3.0], Anchor::Middle, &super::super::numbers::fixed(rms, 1));
    }
}

fn ids(svg: &mut Svg, poses: &[PoseResult], step: f64, bottom: f64) {
    let every = (LABEL_PX / step).ceil().max(1.0) as usize;
    for (i, pose) in poses.iter().enumerate().step_by(every) {
        let x = LEFT + (i as f64 + 0.5) * step;
        svg.turned("tick", [x + 3.5, bottom + 8.0], Anchor::End, -90.0, &clipped(&pose.pose_id, 12));
    }
}
