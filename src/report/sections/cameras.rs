//! The cameras and the stereo pair.

use super::super::document::{Block, Section, Table, Tone};
use super::super::numbers::{count, deg, fixed, mm, percent, px, rotation_deg, translation_mm};
use super::gates::{self, Gated};
use super::{fact, why};
use crate::calibration::adjust::DisplayShape;
use crate::calibration::result::{CalibrationResult, CameraResult, StereoResult};
use crate::geometry::Camera;

/// Both cameras side by side.
pub(super) fn cameras(result: &CalibrationResult) -> Section {
    let missing: Vec<String> = Camera::BOTH
        .into_iter()
        .filter_map(|c| Some(named(c, result.not_computed.get(&format!("cameras.{c}"))?)))
        .collect();
    if result.cameras.is_empty() {
        let why = if missing.is_empty() { "no camera was solved".into() } else { missing.join("; ") };
        return Section::absent("Cameras", why);
    }
    let mut blocks = vec![Block::Table(table(result))];
    blocks.extend(missing.into_iter().map(Block::Absent));
    let mut facts = vec![fact("intrinsics", result.provenance.intrinsics.clone())];
    facts.extend(result.display_shape.as_ref().map(|s| fact("display", shape(s))));
    blocks.push(Block::Facts(facts));
    blocks.push(Block::Note(
        "The rms is the root of the mean squared distance over all points of the views used, after views above \
         the limit were rejected. It says how well the model fits these corners; it does not see what all views share, \
         such as a wrong square size."
            .into(),
    ));
    Section::new("Cameras", blocks)
}

/// The shape of the display in words.
fn shape(shape: &DisplayShape) -> String {
    let term = |((name, size), sigma): ((&String, &f64), &f64)| {
        format!("{name} {} ± {} um", fixed(size * 1e6, 0), fixed(sigma * 1e6, 0))
    };
    let terms: Vec<_> = shape.terms.iter().zip(&shape.terms_m).zip(&shape.sigma_m.sigma).map(term).collect();
    if terms.is_empty() { shape.model.clone() } else { format!("{}: {}", shape.model, terms.join(", ")) }
}

/// Many reasons start with the camera's name already.
fn named(camera: Camera, why: &str) -> String {
    if why.starts_with(camera.name()) { why.to_owned() } else { format!("{camera}: {why}") }
}

fn table(result: &CalibrationResult) -> Table {
    let cameras: Vec<(&Camera, &CameraResult)> = result.cameras.iter().collect();
    let titles: Vec<String> =
        std::iter::once("<camera".into()).chain(cameras.iter().map(|(c, _)| format!("<{c}"))).collect();
    let mut table = Table::new(&titles.iter().map(String::as_str).collect::<Vec<_>>());
    let mut row = |title: &str, value: &dyn Fn(&Camera, &CameraResult) -> String| {
        table.row(std::iter::once(title.to_owned()).chain(cameras.iter().map(|(name, c)| value(name, c))));
    };
    row("image, px", &|_, c| format!("{} x {}", c.width, c.height));
    row("fx, fy, px", &|_, c| format!("{}, {}", fixed(c.fx, 2), fixed(c.fy, 2)));
    row("cx, cy, px", &|_, c| format!("{}, {}", fixed(c.cx, 2), fixed(c.cy, 2)));
    row("k1, k2, k3", &|_, c| {
        let [k1, k2, _, _, k3] = c.distortion.map(|k| fixed(k, 4));
        format!("{k1}, {k2}, {k3}")
    });
    row("p1, p2", &|_, c| format!("{}, {}", fixed(c.distortion[2], 5), fixed(c.distortion[3], 5)));
    if cameras.iter().any(|(_, c)| c.adjusted.is_some()) {
        row("terms solved", &|_, c| c.adjusted.as_ref().map_or_else(|| "-".into(), |a| a.distortion_model.clone()));
        row("± sigma fx, cx, px", &|_, c| {
            let sigma = c.adjusted.as_ref().map(|a| &a.sigma.sigma);
            sigma.map_or_else(|| "-".into(), |s| format!("± {}, {}", fixed(s.fx, 2), fixed(s.cx, 2)))
        });
    }
    row("rms, px", &|_, c| px(c.rms_px));
    row("rms over", &|_, c| format!("{} in {}", count(c.points, "point"), count(c.views_used, "view")));
    row("views rejected", &|_, c| {
        format!("{} of {}", c.views_rejected, count(c.views_used + c.views_rejected, "view"))
    });
    gate_row(result, &mut row, "rms gate", Gated::CameraRms);
    row("corner rate, %", &|_, c| percent(c.corner_rate));
    gate_row(result, &mut row, "corner rate gate", Gated::CornerRate);
    row("serial", &|_, c| c.serial.clone().unwrap_or_else(|| "not declared".into()));
    row("lens", &|_, c| c.lens.clone().unwrap_or_else(|| "not declared".into()));
    table
}

type AddRow<'a> = dyn FnMut(&str, &dyn Fn(&Camera, &CameraResult) -> String) + 'a;

fn gate_row(result: &CalibrationResult, row: &mut AddRow<'_>, title: &str, gated: fn(Camera) -> Gated) {
    let any = result.cameras.keys().any(|c| !gates::text(result, gated(*c)).is_empty());
    if any {
        row(title, &|camera, _| gates::text(result, gated(*camera)));
    }
}

/// The pair.
pub(super) fn stereo(result: &CalibrationResult) -> Section {
    let title = "Stereo: the event camera before the frame camera";
    let Some(stereo) = &result.stereo else {
        let otherwise =
            if result.cameras.len() < 2 { "the session has no pair of cameras" } else { "no pair was solved" };
        return Section::absent(title, why(result, "stereo", otherwise));
    };
    let mut table = Table::new(&["<event_from_rgb", "x", "y", "z"]);
    let titled = |title: &str, values: [String; 3]| std::iter::once(title.to_owned()).chain(values);
    table.row(titled("translation, mm", translation_mm(&stereo.event_from_rgb)));
    if let Some(sigma) = &stereo.sigma {
        table.row(titled("± sigma, mm", sigma.sigma.translation_m.map(|s| format!("± {}", mm(s)))));
    }
    table.row(titled("rotation vector, deg", rotation_deg(&stereo.event_from_rgb)));
    if let Some(sigma) = &stereo.sigma {
        table.row(titled("± sigma, deg", sigma.sigma.rotation_rad.map(|s| format!("± {}", deg(s)))));
    }
    let mut blocks = vec![Block::Facts(stereo_facts(result, stereo)), Block::Table(table)];
    if stereo.taken_over {
        let text = "Translation and rotation were taken over from an earlier result.";
        blocks.insert(0, Block::Text(text.into()));
    }
    Section { title: title.into(), tone: Tone::Plain, blocks }
}

fn stereo_facts(result: &CalibrationResult, stereo: &StereoResult) -> Vec<(String, String)> {
    let pairs = stereo.pairs_used + stereo.pairs_rejected;
    let rms = format!(
        "{} px over both cameras in {} of views, {} of {pairs} rejected",
        px(stereo.rms_px),
        count(stereo.pairs_used, "pair"),
        stereo.pairs_rejected
    );
    let mut facts = vec![
        fact("baseline", format!("{} mm", mm(stereo.baseline_m))),
        fact("rotation", format!("{} deg", fixed(stereo.rotation_deg, 3))),
        fact("rms", rms),
        fact("corner rate", format!("{} % of the corners were seen by both", percent(stereo.corner_rate))),
    ];
    let gate = gates::text(result, Gated::StereoRms);
    if !gate.is_empty() {
        facts.insert(3, fact("rms gate", gate));
    }
    facts
}
