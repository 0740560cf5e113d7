//! The ChArUco board: where its corners are in `target`, its two blink images, what a camera saw of it.
//!
//! Uses `geometry` and `image`. Start at [`Board`]; [`View`] is what vision makes of an image.

mod dictionaries;
pub mod print;
mod raster;
mod scale;
mod view;

pub use dictionaries::DICTIONARIES;
pub use raster::raster;
pub use view::{Corner, View};

use serde::{Deserialize, Serialize};

use crate::geometry::{Point, Target};
use crate::image::GrayImage;

/// A ChArUco board of `squares_x` by `squares_y` squares, or a plain chessboard ([`Board::chessboard`]).
///
/// Frame `target`: origin at the outer top-left corner, x right, y down, z into the board. The inner
/// corner `id` is row-major: `id = row * (squares_x - 1) + column`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Board {
    /// Squares along x.
    pub squares_x: u32,
    /// Squares along y.
    pub squares_y: u32,
    /// Side of a square, metres.
    pub square_m: f64,
    /// Side of a marker, metres; 0 without markers.
    pub marker_m: f64,
    /// ArUco dictionary by OpenCV's name, such as `DICT_4X4_50`; [`NO_MARKERS`] without markers.
    pub dictionary: String,
}

/// The dictionary of a plain chessboard, which has no markers.
pub const NO_MARKERS: &str = "none";

/// Why a board cannot be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BoardError {
    /// Too few or too many squares.
    #[error("the board has {squares_x} x {squares_y} squares, outside 3 x 3 to 100 x 100")]
    Squares {
        /// Squares along x.
        squares_x: u32,
        /// Squares along y.
        squares_y: u32,
    },
    /// Marker and square do not fit.
    #[error(
        "marker {marker_m} m does not fit its square {square_m} m: the marker must be 0.3 to 0.95 of the square; are both in metres?"
    )]
    Marker {
        /// Side of a square.
        square_m: f64,
        /// Side of a marker.
        marker_m: f64,
    },
    /// No real board has such squares.
    #[error("square {square_m} m is outside 0.001 to 1 m; is it in metres?")]
    Size {
        /// Side of a square.
        square_m: f64,
    },
}

impl Board {
    /// A plain chessboard of so many inner corners: no detector of this program finds it, its corners come from others.
    pub fn chessboard(columns: u32, rows: u32, square_m: f64) -> Self {
        let (squares_x, squares_y) = (columns.saturating_add(1), rows.saturating_add(1));
        Self { squares_x, squares_y, square_m, marker_m: 0.0, dictionary: NO_MARKERS.into() }
    }

    /// Whether it has no markers.
    pub fn is_chessboard(&self) -> bool {
        self.dictionary == NO_MARKERS && self.marker_m == 0.0
    }

    /// Checks the proportions; the dictionary is checked where it is loaded.
    pub fn check(&self) -> Result<(), BoardError> {
        let &Self { squares_x, squares_y, square_m, marker_m, .. } = self;
        if !((3..=100).contains(&squares_x) && (3..=100).contains(&squares_y)) {
            return Err(BoardError::Squares { squares_x, squares_y });
        }
        if !(0.001..=1.0).contains(&square_m) {
            return Err(BoardError::Size { square_m });
        }
        if !(self.is_chessboard() || (0.3..=0.95).contains(&(marker_m / square_m))) {
            return Err(BoardError::Marker { square_m, marker_m });
        }
        Ok(())
    }

    /// Number of inner corners.
    pub fn corner_count(&self) -> usize {
        ((self.squares_x - 1) * (self.squares_y - 1)) as usize
    }

    /// Position of inner corner `id`; `None` past the last one.
    pub fn corner(&self, id: u32) -> Option<Point<Target>> {
        let columns = self.squares_x - 1;
        let (row, column) = (id / columns, id % columns);
        ((id as usize) < self.corner_count()).then(|| {
            Point::assume_frame([f64::from(column + 1) * self.square_m, f64::from(row + 1) * self.square_m, 0.0])
        })
    }

    /// Outer size along x and y, metres.
    pub fn size_m(&self) -> [f64; 2] {
        [f64::from(self.squares_x) * self.square_m, f64::from(self.squares_y) * self.square_m]
    }

    /// Centre of the board.
    pub fn centre(&self) -> Point<Target> {
        let [x, y] = self.size_m();
        Point::assume_frame([x / 2.0, y / 2.0, 0.0])
    }
}

/// The blended state of the display: `(1 - alpha) * pattern + alpha * white`, in gamma-encoded values.
///
/// `alpha` from 0 (the pattern) to 1 (all white); 0.6 in every experiment of the paper.
pub fn blend_with_white(pattern: &GrayImage, alpha: f64) -> GrayImage {
    let blend = |v: &u8| ((1.0 - alpha) * f64::from(*v) + alpha * 255.0).round().clamp(0.0, 255.0) as u8;
    GrayImage { pixels: pattern.pixels.iter().map(blend).collect(), ..*pattern }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paper_board() -> Board {
        Board { squares_x: 7, squares_y: 5, square_m: 0.012, marker_m: 0.0096, dictionary: "DICT_4X4_50".into() }
    }

    #[test]
    fn corner_9_is_where_the_paper_puts_it() {
        let board = paper_board();
        assert_eq!(board.corner_count(), 24);
        assert_eq!(board.corner(9).unwrap().xyz_m(), [4.0 * 0.012, 2.0 * 0.012, 0.0]);
        assert!(board.corner(24).is_none());
    }

    #[test]
    fn black_blends_to_153_and_white_stays() {
        let pattern = GrayImage { width: 2, height: 1, pixels: vec![0, 255] };
        assert_eq!(blend_with_white(&pattern, 0.6).pixels, [153, 255]);
    }

    #[test]
    fn a_chessboard_has_the_corners_between_its_squares() {
        let board = Board::chessboard(11, 7, 0.03);
        assert!(board.check().is_ok() && board.is_chessboard() && !paper_board().is_chessboard());
        assert_eq!(board.corner_count(), 77);
        assert_eq!(board.corner(12).unwrap().xyz_m(), [2.0 * 0.03, 2.0 * 0.03, 0.0]);
        // No markers of a dictionary, and markers of none, are no board.
        assert!(Board { marker_m: 0.0, ..paper_board() }.check().is_err());
    }

    #[test]
    fn a_marker_larger_than_its_square_is_refused() {
        let board = Board { marker_m: 0.013, ..paper_board() };
        assert!(matches!(board.check(), Err(BoardError::Marker { .. })));
        let board = Board { square_m: f64::NAN, ..paper_board() };
        assert!(matches!(board.check(), Err(BoardError::Size { .. })));
    }
}
