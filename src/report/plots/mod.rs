//! The plots, as SVG to be set into a page.
//!
//! Written by hand and not with a plotting crate, because colours must come from the page: one drawing for
//! light, dark and paper. Shapes carry classes, `style.css` gives them colours; labels are escaped in `svg`.

mod layout;
mod panel;
mod svg;
mod target_check;
mod view_rms;

use super::document::Plot;
use crate::calibration::result::CalibrationResult;

/// A drawing with its caption; both ready to be set.
pub(super) struct Figure {
    /// What is shown, as plain text.
    pub(super) caption: String,
    /// One or more `<svg>` elements.
    pub(super) drawings: Vec<String>,
    /// Whether a drawing needs the whole width of the page.
    pub(super) wide: bool,
}

/// Draws a plot; `None` where there is nothing to draw.
pub(super) fn draw(plot: Plot, result: &CalibrationResult) -> Option<Figure> {
    match plot {
        Plot::TargetCheck => target_check::draw(result),
        Plot::ViewRms => view_rms::draw(result),
        Plot::Layout => layout::draw(result),
        Plot::Panel => panel::draw(result),
    }
}
