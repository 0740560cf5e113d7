//! Timing, stillness, and where the result comes from.

use std::collections::BTreeMap;

use serde_json::Value;

use super::super::document::{Block, Section};
use super::super::numbers::{count, fixed, mm};
use super::{fact, why};
use crate::calibration::result::{CalibrationResult, PairedBy, PoseResult, Provenance, Timing};
use crate::events::blink::DisplayProof;

/// Clocks and stillness.
pub(super) fn timing(result: &CalibrationResult) -> Section {
    let mut blocks = vec![match &result.timing {
        Some(timing) => Block::Facts(clocks(timing)),
        None => {
            let otherwise = "no event windows were cut in this session, so no clocks had to be brought together";
            Block::Absent(why(result, "timing", otherwise))
        }
    }];
    let notes = result.timing.as_ref().map(|t| t.notes.clone()).unwrap_or_default();
    if !notes.is_empty() {
        blocks.push(Block::List(notes));
    }
    let display = result.display.as_ref().map(|proof| fact("display", display(proof)));
    let facts = display.into_iter().chain([fact("stillness", stillness(&result.poses))]);
    blocks.push(Block::Facts(facts.collect()));
    Section::new("Timing and stillness", blocks)
}

/// How the display blinked, in a line.
fn display(proof: &DisplayProof) -> String {
    let DisplayProof {
        cycle_hz, cycle_hz_sigma, dark_share, cycles, late_refreshes, early_refreshes, jitter_us, ..
    } = proof;
    format!(
        "{} Hz (sigma {}) over {cycles} cycles, black cells dark for {} % of a cycle, transitions within {} us (rms), \
         {late_refreshes} refreshes late, {early_refreshes} early",
        fixed(*cycle_hz, 4),
        fixed(*cycle_hz_sigma, 4),
        fixed(100.0 * dark_share, 1),
        fixed(*jitter_us, 0),
    )
}

fn clocks(timing: &Timing) -> Vec<(String, String)> {
    let &Timing { paired_by, offset_s, drift_ppm, residual_rms_s, windows: [with_window, exposures], .. } = timing;
    let (by, residual) = match paired_by {
        PairedBy::Trigger => (
            "trigger edges",
            ("trigger residual", format!("rms {} us over the trigger edges", fixed(residual_rms_s * 1e6, 1))),
        ),
        PairedBy::Arrival => (
            "the arrival of packets: no trigger wire",
            ("arrival spread", format!("{} ms beyond the fastest packets, median", fixed(residual_rms_s * 1e3, 2))),
        ),
        PairedBy::Period => (
            "the image period alone: no trigger edges",
            ("arrival spread", format!("{} ms beyond the fastest packets, median", fixed(residual_rms_s * 1e3, 2))),
        ),
    };
    let mut facts = vec![
        fact("event windows", format!("{with_window} of {}, paired by {by}", count(exposures, "exposure"))),
        fact("clock offset", format!("{} s, session clock minus sensor clock", fixed(offset_s, 6))),
        fact("clock drift", format!("{} ppm", fixed(drift_ppm, 2))),
        fact(residual.0, residual.1),
    ];
    if let Some(latency_s) = timing.arrival_latency_s {
        let text = format!(
            "fastest packets {} ms after their events: the pairing is not off by an image",
            fixed(latency_s * 1e3, 1)
        );
        facts.push(fact("arrival", text));
    }
    facts
}

/// What the evidence of the poses says, in a line; it is stored as the session wrote it.
fn stillness(poses: &[PoseResult]) -> String {
    let evidence: Vec<(&str, &Value)> =
        poses.iter().filter_map(|p| Some((p.pose_id.as_str(), p.stationarity.as_ref()?))).collect();
    if evidence.is_empty() {
        return "absent: no pose has evidence of it".into();
    }
    let mut by_source: BTreeMap<&str, usize> = BTreeMap::new();
    for source in evidence.iter().filter_map(|(_, v)| v.get("source").and_then(Value::as_str)) {
        *by_source.entry(source).or_default() += 1;
    }
    let shown: Vec<_> = by_source.iter().map(|(source, n)| format!("{source} at {n}")).collect();
    let mut text = format!("{} of {}", shown.join(", "), count(poses.len(), "pose"));
    if let Some((pose, speed)) = largest(&evidence, "max_joint_speed_rad_s") {
        text.push_str(&format!("; fastest joint {} mrad/s at {pose}", fixed(speed * 1e3, 2)));
    }
    if let Some((pose, speed)) = largest(&evidence, "max_tcp_speed_m_s") {
        text.push_str(&format!("; fastest TCP {} mm/s at {pose}", fixed(speed * 1e3, 2)));
    }
    text
}

fn largest<'a>(evidence: &[(&'a str, &Value)], key: &str) -> Option<(&'a str, f64)> {
    let values = evidence.iter().filter_map(|(pose, v)| Some((*pose, v.get(key)?.as_f64()?)));
    values.max_by(|a, b| a.1.total_cmp(&b.1))
}

/// Versions, settings, hashes.
pub(super) fn section(result: &CalibrationResult) -> Section {
    let Provenance { opencv, board, board_layout, board_frame, intrinsics, settings, gates: _, facts, sha256 } =
        &result.provenance;
    let size = format!(
        "{} x {} squares of {} mm, markers {} mm, {}",
        board.squares_x,
        board.squares_y,
        mm(board.square_m),
        mm(board.marker_m),
        board.dictionary
    );
    let mut rows = vec![
        fact("program", format!("cellcal {}, result schema {}", result.program_version, result.schema_version)),
        fact("opencv", opencv.clone()),
        fact("board", size),
        fact("board layout", board_layout.clone()),
        fact("board frame", board_frame.clone()),
        fact("intrinsics", intrinsics.clone()),
        fact("settings", settings_text(serde_json::to_value(settings).unwrap_or_default())),
    ];
    rows.extend(facts.iter().map(|(name, value)| fact(name, value.clone())));
    rows.extend(sha256.iter().map(|(name, hash)| fact(&format!("sha256 of {name}"), hash.clone())));
    Section::new("Provenance", vec![Block::Facts(rows)])
}

/// Every setting by its name in the cell file, so that a new one is shown without a change here.
fn settings_text(settings: Value) -> String {
    let Value::Object(fields) = settings else { return "not readable".into() };
    // Sorted here, because the order of a JSON object depends on how the JSON library was built.
    let fields: BTreeMap<String, Value> = fields.into_iter().collect();
    let shown = |(name, value): (&String, &Value)| match value {
        Value::String(text) => format!("{name} {text}"),
        Value::Null => format!("{name} not set"),
        other => format!("{name} {other}"),
    };
    fields.iter().map(shown).collect::<Vec<_>>().join(", ")
}
