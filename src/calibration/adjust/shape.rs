//! The shape of a display that is not quite flat.
//!
//! Height along z of `target` over its corners, as seven smooth terms: X2, Y2, XY, then X3, X2Y, XY2, Y3, with
//! X and Y from -1 to 1 over the inner corners. Each term has its best plane over the corners taken out, so it
//! neither shifts nor tilts the board.

use serde::{Deserialize, Serialize};

use crate::board::Board;

/// Number of terms.
pub(super) const TERMS: usize = 7;
/// Expected size of each term, m (facts: 20 to 80 um over the board).
pub(super) const PRIOR_SIGMA_M: f64 = 50e-6;

/// Which terms are solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Shape {
    /// A plane.
    Flat,
    /// X2, Y2, XY.
    Quadratic,
    /// All seven terms.
    Cubic,
}

impl Shape {
    /// Simplest first.
    pub const NESTED: [Self; 3] = [Self::Flat, Self::Quadratic, Self::Cubic];

    /// Number of terms, in the order of the module.
    pub fn terms(self) -> usize {
        match self {
            Self::Flat => 0,
            Self::Quadratic => 3,
            Self::Cubic => TERMS,
        }
    }

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Flat => "flat",
            Self::Quadratic => "quadratic",
            Self::Cubic => "cubic",
        }
    }
}

/// The terms on one board.
pub(super) struct Basis {
    columns: u32,
    rows: u32,
}

impl Basis {
    pub(super) fn of(board: &Board) -> Self {
        Self { columns: board.squares_x - 1, rows: board.squares_y - 1 }
    }

    /// The terms at corner `id`.
    pub(super) fn at(&self, id: u32) -> [f64; TERMS] {
        let x = place(id % self.columns, self.columns);
        let y = place(id / self.columns, self.rows);
        let ((x2, x4), (y2, y4)) = (moments(self.columns), moments(self.rows));
        [
            x * x - x2,
            y * y - y2,
            x * y,
            x * (x * x - x4 / x2),
            (x * x - x2) * y,
            x * (y * y - y2),
            y * (y * y - y4 / y2),
        ]
    }

    /// Height of corner `id`, m.
    pub(super) fn height_m(&self, terms_m: &[f64; TERMS], id: u32) -> f64 {
        self.at(id).iter().zip(terms_m).map(|(b, m)| b * m).sum()
    }
}

/// Place of line `i` of `count` (two at least), from -1 to 1.
fn place(i: u32, count: u32) -> f64 {
    2.0 * f64::from(i) / f64::from(count - 1) - 1.0
}

/// Mean square and mean fourth power of the places.
fn moments(count: u32) -> (f64, f64) {
    let mean = |power: i32| (0..count).map(|i| place(i, count).powi(power)).sum::<f64>() / f64::from(count);
    (mean(2), mean(4))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_term_shifts_or_tilts_the_board() {
        let board =
            Board { squares_x: 7, squares_y: 5, square_m: 0.012, marker_m: 0.0096, dictionary: "DICT_4X4_50".into() };
        let basis = Basis::of(&board);
        for term in 0..TERMS {
            let sum = |weight: &dyn Fn(u32) -> f64| (0..24).map(|id| basis.at(id)[term] * weight(id)).sum::<f64>();
            let (x, y) = (|id: u32| f64::from(id % 6) - 2.5, |id: u32| f64::from(id / 6) - 1.5);
            assert!(sum(&|_| 1.0).abs() < 1e-12 && sum(&x).abs() < 1e-12 && sum(&y).abs() < 1e-12, "{term}");
            assert!(sum(&|id| basis.at(id)[term]) > 0.1, "{term} is nothing");
        }
    }
}
