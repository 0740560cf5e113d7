//! What a report tells, in which order and in which words; one file per subject.

mod cameras;
mod checks;
mod gates;
mod hand_eye;
mod kinematics;
mod poses;
mod provenance;

pub(super) use hand_eye::{PanelRow, panel_rows};
pub(super) use poses::kind_name;

use super::document::{Block, Document, Section, Tone, Verdict};
use crate::calibration::gates::Status;
use crate::calibration::result::CalibrationResult;

/// The whole report.
pub(super) fn document(result: &CalibrationResult) -> Document {
    let mut sections = Vec::new();
    sections.extend(changed(result));
    sections.extend(list("Warnings", Tone::Alert, result.warnings.clone()));
    let missing = result.not_computed.iter().map(|(section, why)| format!("{section}: {why}"));
    sections.extend(list("Not computed", Tone::Alert, missing.collect()));
    sections.extend([
        gates::section(result),
        hand_eye::place(result),
        checks::section(result),
        cameras::cameras(result),
        cameras::stereo(result),
        poses::section(result),
        hand_eye::panel(result),
        hand_eye::observability(result),
    ]);
    sections.extend(kinematics::section(result));
    sections.extend([provenance::timing(result), provenance::section(result)]);
    Document { subject: subject(result), verdict: verdict(result), sections }
}

fn subject(result: &CalibrationResult) -> Vec<(String, String)> {
    let program = format!("cellcal {}", result.program_version);
    let pairs = [("cell", &result.cell), ("session", &result.session_id), ("solved by", &program)];
    pairs.into_iter().map(|(name, value)| (name.into(), value.clone())).collect()
}

fn verdict(result: &CalibrationResult) -> Verdict {
    let (word, tone, meaning) = match result.verdict.status {
        Status::Pass => ("PASS", Tone::Good, "Every gate of the cell was judged and kept."),
        Status::Fail => ("FAIL", Tone::Bad, "At least one gate was missed: do not use this calibration."),
        Status::Inconclusive if result.provenance.gates.is_none() => {
            ("INCONCLUSIVE", Tone::Alert, "There were no gates, so nothing could be judged.")
        }
        Status::Inconclusive => {
            ("INCONCLUSIVE", Tone::Alert, "No gate was missed, but not everything that must hold could be judged.")
        }
    };
    let what_if = if result.overrides.is_empty() { "" } else { " (WHAT-IF)" };
    Verdict { word: format!("{word}{what_if}"), tone, meaning, reasons: result.verdict.reasons.clone() }
}

fn changed(result: &CalibrationResult) -> Option<Section> {
    let mut section = list("What-if: not as it was recorded", Tone::Alert, result.overrides.clone())?;
    let text = "Solved with changed settings; the numbers answer a question and are no calibration to use. Changed:";
    section.blocks.insert(0, Block::Text(text.into()));
    Some(section)
}

fn list(title: &str, tone: Tone, items: Vec<String>) -> Option<Section> {
    let section = |items| Section { title: title.into(), tone, blocks: vec![Block::List(items)] };
    (!items.is_empty()).then(|| section(items))
}

/// Why a section is absent, as the result says it, or else `otherwise`.
fn why(result: &CalibrationResult, section: &str, otherwise: &str) -> String {
    result.not_computed.get(section).cloned().unwrap_or_else(|| otherwise.to_owned())
}

fn fact(name: &str, value: impl Into<String>) -> (String, String) {
    (name.into(), value.into())
}
