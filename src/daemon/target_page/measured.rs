//! From what the user measured on the display to the size of a square.
//!
//! An error of scale goes one to one into every distance that is calibrated, so the uncertainty is kept.

use std::fmt::Write as _;

use serde::{Deserialize, Serialize};

/// Sides of a bank card (ISO/IEC 7810, ID-1), mm.
const CARD_MM: [f64; 2] = [85.60, 53.98];
/// Half of what the standard allows the sides to differ by, mm: 85.47 to 85.72, 53.92 to 54.03.
const CARD_TOLERANCE_MM: [f64; 2] = [0.125, 0.055];
/// How well an edge on glass is brought under the edge of a card by eye, mm; our estimate, two edges a side.
const CARD_EDGE_MM: f64 = 0.2;
/// Fewest squares between the jaws.
const LEAST_SQUARES: f64 = 8.0;
/// Pixels of real panels, mm.
const PITCH_MM: std::ops::RangeInclusive<f64> = 0.01..=3.0;

/// How the display was measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// A calliper over a row and a column of squares.
    Calliper,
    /// The outline of a bank card.
    Card,
}

/// What the page sends.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Measurement {
    pub(super) method: Method,
    /// Length on the screen along x and y, device pixels.
    pub(super) px: [f64; 2],
    /// The same as read from the calliper, mm; not used for the card.
    #[serde(default)]
    pub(super) mm: Option<[f64; 2]>,
    /// Number of squares in that length.
    #[serde(default)]
    pub(super) squares: Option<f64>,
    /// Standard uncertainty of one reading, mm.
    #[serde(default)]
    pub(super) reading_sigma_mm: Option<f64>,
    /// Device pixels of a square of the board.
    pub(super) px_per_square: f64,
    /// Refreshes per second as measured by the page, and cycles per second as shown.
    #[serde(default)]
    pub(super) refresh_hz: Option<f64>,
    #[serde(default)]
    pub(super) cycle_hz: Option<f64>,
    /// Size of the shown surface, device pixels.
    pub(super) panel_px: [u32; 2],
}

#[derive(Debug, PartialEq, thiserror::Error)]
pub(super) enum MeasurementError {
    #[error("{key} is {found}, outside {allowed}")]
    Outside { key: &'static str, found: f64, allowed: &'static str },
    #[error("{0} is missing")]
    Missing(&'static str),
    #[error(
        "a pixel would be {x_mm:.4} mm wide and {y_mm:.4} mm high, which differ by more than 10 %; were x and y exchanged?"
    )]
    Oblong { x_mm: f64, y_mm: f64 },
}

/// The size of a square on this display, with standard uncertainty; each value along x and y.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Measured {
    /// How it was measured.
    pub method: Method,
    /// Size of a device pixel, mm.
    pub mm_per_px: [f64; 2],
    /// Its standard uncertainty, mm.
    pub mm_per_px_sigma: [f64; 2],
    /// Device pixels of a square.
    pub px_per_square: f64,
    /// Side of a square, mm.
    pub square_mm: [f64; 2],
    /// Its standard uncertainty, mm.
    pub square_sigma_mm: [f64; 2],
    /// Size of the shown surface, device pixels.
    pub panel_px: [u32; 2],
    /// Refreshes per second, if measured.
    pub refresh_hz: Option<f64>,
    /// Cycles per second, if shown.
    pub cycle_hz: Option<f64>,
    /// What to know about it.
    pub notes: Vec<String>,
    /// The lines for the cell file.
    pub yaml: String,
}

fn within(
    key: &'static str,
    found: f64,
    range: std::ops::RangeInclusive<f64>,
    allowed: &'static str,
) -> Result<f64, MeasurementError> {
    if range.contains(&found) { Ok(found) } else { Err(MeasurementError::Outside { key, found, allowed }) }
}

impl Measurement {
    /// Length between the edges and its standard uncertainty along x and y, mm.
    fn lengths_mm(&self) -> Result<[[f64; 2]; 2], MeasurementError> {
        match self.method {
            Method::Card => {
                let sigma = |i: usize| (CARD_TOLERANCE_MM[i].powi(2) / 3.0 + 2.0 * CARD_EDGE_MM.powi(2)).sqrt();
                Ok([CARD_MM, [sigma(0), sigma(1)]])
            }
            Method::Calliper => {
                let squares = self.squares.ok_or(MeasurementError::Missing("squares"))?;
                within("squares", squares, LEAST_SQUARES..=1000.0, "8 to 1000")?;
                let mm = self.mm.ok_or(MeasurementError::Missing("mm"))?;
                let sigma = self.reading_sigma_mm.ok_or(MeasurementError::Missing("reading_sigma_mm"))?;
                within("reading_sigma_mm", sigma, 0.001..=5.0, "0.001 to 5 mm")?;
                for value in mm {
                    within("mm", value, 5.0..=5000.0, "5 to 5000 mm")?;
                }
                Ok([mm, [sigma; 2]])
            }
        }
    }

    /// The size of a square.
    pub(super) fn evaluate(&self, shown: &super::wish::Wish) -> Result<Measured, MeasurementError> {
        let [mm, sigma_mm] = self.lengths_mm()?;
        for px in self.px {
            within("px", px, 16.0..=16384.0, "16 to 16384 pixels")?;
        }
        let px_per_square = within("px_per_square", self.px_per_square, 8.0..=8192.0, "8 to 8192 pixels")?;
        for px in self.panel_px {
            within("panel_px", f64::from(px), 16.0..=16384.0, "16 to 16384 pixels")?;
        }
        for (key, hz) in [("refresh_hz", self.refresh_hz), ("cycle_hz", self.cycle_hz)] {
            hz.map_or(Ok(0.0), |hz| within(key, hz, 1.0..=500.0, "1 to 500 Hz"))?;
        }
        let mm_per_px = [mm[0] / self.px[0], mm[1] / self.px[1]];
        for value in mm_per_px {
            within("the size of a pixel", value, PITCH_MM, "0.01 to 3 mm")?;
        }
        let [x_mm, y_mm] = mm_per_px;
        if !(0.9..=1.1).contains(&(x_mm / y_mm)) {
            return Err(MeasurementError::Oblong { x_mm, y_mm });
        }
        let mm_per_px_sigma = [sigma_mm[0] / self.px[0], sigma_mm[1] / self.px[1]];
        let square_mm = mm_per_px.map(|mm| mm * px_per_square);
        let square_sigma_mm = mm_per_px_sigma.map(|mm| mm * px_per_square);
        let mut measured = Measured {
            method: self.method,
            mm_per_px,
            mm_per_px_sigma,
            px_per_square,
            square_mm,
            square_sigma_mm,
            panel_px: self.panel_px,
            refresh_hz: self.refresh_hz,
            cycle_hz: self.cycle_hz,
            notes: notes(square_mm, square_sigma_mm),
            yaml: String::new(),
        };
        measured.yaml = measured.yaml_of(shown);
        Ok(measured)
    }
}

fn notes([x, y]: [f64; 2], [sigma_x, sigma_y]: [f64; 2]) -> Vec<String> {
    let percent = 100.0 * (sigma_x / x).hypot(sigma_y / y) / 2.0;
    let mut notes = vec![format!(
        "scale known to {percent:.2} % (one sigma): as much of every distance from the camera to the board"
    )];
    if (x - y).abs() > 3.0 * sigma_x.hypot(sigma_y) {
        notes.push(format!(
            "squares are {x:.4} x {y:.4} mm: the pixels are not square; the cell has one size, their mean: measure again"
        ));
    }
    notes
}

impl Measured {
    /// `board:` and `display:` as they go into a cell file.
    fn yaml_of(&self, shown: &super::wish::Wish) -> String {
        let ([x, y], [sigma_x, sigma_y]) = (self.square_mm, self.square_sigma_mm);
        let (board, [w, h]) = (&shown.board, self.panel_px);
        let square = (x + y) / 2.0;
        let marker = square * board.marker_m / board.square_m;
        let mut yaml = format!(
            "board: {{dictionary: {}, squares_x: {}, squares_y: {}, square_mm: {square:.4}, marker_mm: {marker:.4}}}\n",
            board.dictionary, board.squares_x, board.squares_y
        );
        let _ = write!(yaml, "display: {{alpha: {}", shown.alpha);
        for (key, hz) in [("cycle_hz", self.cycle_hz), ("refresh_hz", self.refresh_hz)] {
            let _ = hz.map_or(Ok(()), |hz| write!(yaml, ", {key}: {}", (hz * 1e3).round() / 1e3));
        }
        let _ = writeln!(
            yaml,
            ", panel_px: [{w}, {h}], square_xy_mm: [{x:.4}, {y:.4}], square_sigma_mm: [{sigma_x:.4}, {sigma_y:.4}]}}"
        );
        yaml
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;
    use crate::daemon::target_page::wish::Wish;

    fn shown() -> Wish {
        let cell = config::parse_cell(include_str!("../../../cells/handheld.yaml"), "handheld.yaml").unwrap();
        Wish::new(&cell.board, &cell.display, &[]).unwrap()
    }

    fn calliper() -> Measurement {
        Measurement {
            method: Method::Calliper,
            px: [720.0, 400.0],
            mm: Some([72.36, 40.16]),
            squares: Some(9.0),
            reading_sigma_mm: Some(0.05),
            px_per_square: 90.0,
            refresh_hz: Some(59.94),
            cycle_hz: Some(14.985),
            panel_px: [800, 480],
        }
    }

    #[test]
    fn a_calliper_gives_square_and_uncertainty_along_x_and_y() {
        let found = calliper().evaluate(&shown()).unwrap();
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        near(found.square_mm[0], 9.045);
        near(found.square_mm[1], 9.036);
        near(found.square_sigma_mm[0], 0.05 / 8.0);
        near(found.square_sigma_mm[1], 0.05 * 90.0 / 400.0);
        assert_eq!(found.notes.len(), 1, "{:?}", found.notes);
    }

    #[test]
    fn the_lines_are_what_a_cell_file_takes() {
        let found = calliper().evaluate(&shown()).unwrap();
        let text = include_str!("../../../cells/handheld.yaml");
        let others = text.lines().filter(|l| !l.starts_with("board:") && !l.starts_with("display:"));
        let text = others.collect::<Vec<_>>().join("\n") + "\n" + &found.yaml;
        let cell = config::parse_cell(&text, "measured.yaml").unwrap();
        assert!((cell.board.square_m * 1e3 - 9.0405).abs() < 1e-4);
        assert_eq!(cell.display.square_xy_mm, Some([9.045, 9.036]));
        assert_eq!(cell.display.refresh_hz, 59.94);
        let moved = text.replace("square_mm: 9.0405", "square_mm: 9.1");
        assert!(config::parse_cell(&moved, "moved.yaml").unwrap_err().to_string().contains("display.square_xy_mm"));
    }

    #[test]
    fn a_card_is_less_certain_and_says_so() {
        let card = Measurement { method: Method::Card, px: [856.0, 539.8], mm: None, ..calliper() };
        let found = card.evaluate(&shown()).unwrap();
        assert!((found.square_mm[0] - 9.0).abs() < 1e-9 && (found.square_mm[1] - 9.0).abs() < 1e-9);
        // 0.292 of 85.60 mm: two edges of 0.2 mm and the tolerance of the card.
        assert!((found.square_sigma_mm[0] / 9.0 - 0.2919 / 85.60).abs() < 1e-5, "{:?}", found.square_sigma_mm);
    }

    #[test]
    fn impossible_measurements_are_refused() {
        let wrong = [
            Measurement { mm: Some([40.16, 72.36]), ..calliper() },
            Measurement { mm: Some([f64::NAN, 40.0]), ..calliper() },
            Measurement { mm: None, ..calliper() },
            Measurement { squares: Some(7.0), ..calliper() },
            Measurement { px: [0.0, 400.0], ..calliper() },
            Measurement { reading_sigma_mm: Some(-1.0), ..calliper() },
            Measurement { refresh_hz: Some(f64::INFINITY), ..calliper() },
            Measurement { panel_px: [0, 480], ..calliper() },
        ];
        for measurement in wrong {
            assert!(measurement.evaluate(&shown()).is_err(), "{measurement:?}");
        }
    }
}
