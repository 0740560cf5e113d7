//! Both methods on the same simulated sessions, against the truth.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::errors::{Errors, errors};
use super::{StudyError, session};
use crate::calibration::settings::{Method, Settings};
use crate::runner::setup::CellTexts;
use crate::runner::solve::solve_recording;

/// Both methods on one session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SessionErrors {
    /// Name of the cell.
    pub cell: String,
    /// Seed of the simulated cell.
    pub seed: u64,
    /// Version of this program.
    pub program_version: String,
    /// SHA-256 of the cell file and its trajectories.
    pub texts_sha256: String,
    /// Poses of the session.
    pub poses: usize,
    /// `method: paper`.
    pub paper: Errors,
    /// `method: precise`.
    pub precise: Errors,
}

/// What must come out, as the share of the paper's error or as a limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Goal {
    /// At most this share of the paper's median.
    Share(f64),
    /// At most this.
    AtMost(f64),
    /// At most this share of the paper's median, and at most this.
    Both(f64, f64),
    /// At least this.
    AtLeast(f64),
    /// Nothing is asked.
    None,
}

/// What is compared, and what is asked of the precise method.
pub const ROWS: [(&str, Goal); 15] = [
    ("stereo_translation_mm", Goal::Share(0.1)),
    ("baseline_mm", Goal::Share(0.1)),
    ("stereo_rotation_deg", Goal::AtMost(0.12)),
    ("event_model_px", Goal::Share(0.25)),
    ("rgb_model_px", Goal::None),
    ("event_corner_px", Goal::Share(0.25)),
    ("event_corners_found", Goal::AtLeast(0.99)),
    ("rgb_corner_px", Goal::None),
    ("rgb_corners_found", Goal::None),
    ("hand_eye_translation_mm", Goal::Both(0.25, 1.0)),
    ("hand_eye_rotation_deg", Goal::None),
    ("base_distance_mae_mm", Goal::Share(0.25)),
    ("held_out_target_to_tcp_mm", Goal::AtMost(0.5)),
    ("rgb_rms_px", Goal::None),
    ("event_rms_px", Goal::None),
];

/// Medians over all sessions.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// What is compared; the unit is the end of the name.
    pub name: &'static str,
    /// Sessions that have it.
    pub sessions: usize,
    /// Median of the paper's method.
    pub paper: f64,
    /// Median of the precise method.
    pub precise: f64,
    /// Precise over paper, of the medians.
    pub ratio: f64,
    /// What was asked, in words; empty where nothing was.
    pub goal: String,
    /// Whether it was kept; absent where nothing was asked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kept: Option<bool>,
}

/// Runs one session and solves it by both methods; a result that is in `folder` already is taken from there.
///
/// # Errors
/// A session that cannot be run or solved, or a file that cannot be written.
pub fn one(texts: &CellTexts, name: &str, seed: u64, folder: &Path) -> Result<SessionErrors, StudyError> {
    let kept = folder.join(format!("{name}-{seed}.json"));
    if let Some(before) = before(&kept, texts)? {
        return Ok(before);
    }
    let recording = folder.join(format!("{name}-{seed}.mcap"));
    let recorded = session::record(texts, seed, &recording)?;
    let solve = |method: Method| -> Result<Errors, StudyError> {
        let mut with = |setup: &mut crate::runner::setup::Setup| {
            let Settings { reference_camera, .. } = setup.settings;
            setup.settings = Settings { reference_camera, ..Settings::usual(method) };
            Ok(vec![format!("method: {method:?}")])
        };
        let solved = solve_recording(&recording, &mut with, None, &|_, _| ())?;
        Ok(errors(&recorded, &solved))
    };
    let result = SessionErrors {
        cell: name.into(),
        seed,
        program_version: env!("CARGO_PKG_VERSION").into(),
        texts_sha256: texts.sha256(),
        poses: recorded.base_from_flange.len(),
        paper: solve(Method::Paper)?,
        precise: solve(Method::Precise)?,
    };
    let text = serde_json::to_string_pretty(&result).map_err(|why| file(&kept, &why))?;
    std::fs::write(&kept, text).map_err(|why| file(&kept, &why))?;
    std::fs::remove_file(&recording).map_err(|why| file(&recording, &why))?;
    Ok(result)
}

fn file(path: &Path, why: &dyn ToString) -> StudyError {
    StudyError::File { path: PathBuf::from(path), why: why.to_string() }
}

/// The result of an earlier run, if it is of the same texts and the same program.
fn before(path: &Path, texts: &CellTexts) -> Result<Option<SessionErrors>, StudyError> {
    let Ok(text) = std::fs::read_to_string(path) else { return Ok(None) };
    let found: SessionErrors = serde_json::from_str(&text).map_err(|why| file(path, &why))?;
    let same = found.texts_sha256 == texts.sha256() && found.program_version == env!("CARGO_PKG_VERSION");
    Ok(same.then_some(found))
}

/// Medians over the sessions, and whether what was asked was kept.
pub fn rows(sessions: &[SessionErrors]) -> Vec<Row> {
    let row = |(name, goal): &(&'static str, Goal)| {
        let of = |pick: fn(&SessionErrors) -> &Errors| -> Vec<f64> {
            sessions.iter().filter_map(|s| pick(s).values.get(*name).copied()).collect()
        };
        let (paper, precise) = (of(|s| &s.paper), of(|s| &s.precise));
        let sessions = precise.len();
        let (paper, precise) = (median(paper)?, median(precise)?);
        let (goal, kept) = goal.judge(paper, precise);
        Some(Row { name, sessions, paper, precise, ratio: precise / paper, goal, kept })
    };
    ROWS.iter().filter_map(row).collect()
}

impl Goal {
    fn judge(self, paper: f64, precise: f64) -> (String, Option<bool>) {
        match self {
            Self::Share(share) => (format!("<= {share} of paper"), Some(precise <= share * paper)),
            Self::AtMost(limit) => (format!("<= {limit}"), Some(precise <= limit)),
            Self::Both(share, limit) => {
                (format!("<= {share} of paper and {limit}"), Some(precise <= share * paper && precise <= limit))
            }
            Self::AtLeast(limit) => (format!(">= {limit}"), Some(precise >= limit)),
            Self::None => (String::new(), None),
        }
    }
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    let upper = *values.get(middle)?;
    Some(if values.len() % 2 == 1 { upper } else { 0.5 * (values[middle - 1] + upper) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn session(seed: u64, paper: f64, precise: f64) -> SessionErrors {
        let errors = |v: f64| Errors { values: [("stereo_translation_mm".to_owned(), v)].into(), ..Errors::default() };
        SessionErrors {
            cell: "sim".into(),
            seed,
            program_version: String::new(),
            texts_sha256: String::new(),
            poses: 1,
            paper: errors(paper),
            precise: errors(precise),
        }
    }

    #[test]
    fn medians_are_judged_and_a_miss_is_a_miss() {
        let sessions = [session(1, 1.0, 0.2), session(2, 3.0, 0.1), session(3, 2.0, 0.9)];
        let rows = rows(&sessions);
        assert_eq!(rows.len(), 1, "what no session has is no row");
        assert_eq!((rows[0].paper, rows[0].precise, rows[0].kept), (2.0, 0.2, Some(true)));
        let worse = super::rows(&[session(1, 1.0, 0.2)]);
        assert_eq!(worse[0].kept, Some(false));
    }
}
