//! A finished calibration for people: text for a terminal, one HTML page with plots.
//!
//! `sections` says what is told, in which order and in which words, as a `document`; `terminal` and
//! `html` only set it, so that both tell the same. Order: verdict and gates, what was changed, warnings,
//! the camera's place with its uncertainty, the checks, the cameras, every pose, the panel of solvers,
//! observability, timing, provenance. Same result, same bytes: no clock, no path, no random ids.
//!
//! Names of poses, cells and files come from users: `document::visible` takes control characters out of all
//! text, and `html` escapes it. Uses `geometry`, `board`, `calibration`. Start at [`terminal()`].

mod document;
#[cfg(test)]
mod fixture;
mod html;
mod numbers;
mod plots;
mod sections;
mod terminal;
#[cfg(test)]
mod tests;

use crate::calibration::result::CalibrationResult;

/// The report as plain text, at most 100 columns wide where no single word is longer; ends with a newline.
pub fn terminal(result: &CalibrationResult) -> String {
    terminal::render(&sections::document(result))
}

/// The report as one HTML page: no scripts, nothing loaded from elsewhere, for screens and for print.
pub fn html(result: &CalibrationResult) -> String {
    html::render(&sections::document(result), result)
}
