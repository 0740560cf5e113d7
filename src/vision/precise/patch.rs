//! The pixels that say where a corner is: along its four edges, clear of markers and of the next corners.

use nalgebra::{Matrix2, Vector2};

use crate::image::FloatImage;

/// How far along an edge pixels count, squares: half way to the next corner.
const ALONG_SQUARES: f64 = 0.5;
/// How far from an edge pixels count, squares; and at least and at most so many px.
const ACROSS_SQUARES: f64 = 0.14;
const ACROSS_PX: [f64; 2] = [4.5, 8.0];
/// Distance kept from the black border of a marker, px, and the band next to an edge that is used in any case.
const MARKER_CLEARANCE_PX: f64 = 2.5;
const WHITE_BAND_PX: f64 = 0.75;

/// How the board lies in the image around one corner.
#[derive(Debug, Clone, Copy)]
pub(super) struct Local {
    /// Where the corner is about, px.
    pub(super) at_px: [f64; 2],
    /// How far a square goes along the board's x and y, px.
    pub(super) along_x_px: [f64; 2],
    pub(super) along_y_px: [f64; 2],
}

/// A pixel of a patch.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// From the expected corner, px.
    pub(super) d_px: [f64; 2],
    pub(super) value: f64,
    /// Which of the four arms of the cross it is nearest to: +x, +y, -x, -y.
    pub(super) arm: usize,
}

/// The pixels around one corner.
#[derive(Debug, Clone)]
pub(super) struct Patch {
    pub(super) samples: Vec<Sample>,
    /// Pixels of the mask that the image does not have.
    pub(super) outside: usize,
}

/// Shape of the mask.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mask {
    /// From the border of a white square to its marker, squares.
    pub(super) marker_margin: f64,
    /// Whether the squares at smaller x and y, and at larger x and y, are the black ones.
    pub(super) diagonal_is_black: bool,
}

impl Patch {
    /// Cuts a patch out; `None` where the board is seen too small or edge-on.
    pub(super) fn cut(image: &FloatImage, local: &Local, mask: Mask) -> Option<Self> {
        let px_of_squares = Matrix2::from_columns(&[Vector2::from(local.along_x_px), Vector2::from(local.along_y_px)]);
        let squares_of_px = px_of_squares.try_inverse()?;
        // Distance of two opposite sides of a square.
        let side_px = [0, 1].map(|i| 1.0 / squares_of_px.row(i).norm());
        let across_px = (ACROSS_SQUARES * side_px[0].min(side_px[1])).clamp(ACROSS_PX[0], ACROSS_PX[1]);
        let is_large_enough = side_px.iter().all(|s| ALONG_SQUARES * s > 1.5 * ACROSS_PX[0]);
        if !is_large_enough {
            return None;
        }
        let half = [0, 1].map(|i| ALONG_SQUARES * (local.along_x_px[i].abs() + local.along_y_px[i].abs()));
        let range = |i: usize| {
            let (low, high) = ((local.at_px[i] - half[i]).ceil(), (local.at_px[i] + half[i]).floor());
            (low.is_finite() && high.is_finite() && high - low < 4096.0).then_some(low as i64..=high as i64)
        };
        let (columns, rows) = (range(0)?, range(1)?);
        let mut patch = Self { samples: Vec::new(), outside: 0 };
        for y in rows {
            for x in columns.clone() {
                let d_px = [x as f64 - local.at_px[0], y as f64 - local.at_px[1]];
                let squares = squares_of_px * Vector2::from(d_px);
                let Some(arm) = mask.arm([squares.x, squares.y], side_px, across_px) else { continue };
                match value(image, x, y) {
                    Some(value) => patch.samples.push(Sample { d_px, value, arm }),
                    None => patch.outside += 1,
                }
            }
        }
        Some(patch)
    }
}

impl Mask {
    /// The arm that a point belongs to, `None` off the mask.
    fn arm(self, [x, y]: [f64; 2], side_px: [f64; 2], across_px: f64) -> Option<usize> {
        if !(x.abs() <= ALONG_SQUARES && y.abs() <= ALONG_SQUARES) {
            return None;
        }
        let off_px = [x.abs() * side_px[0], y.abs() * side_px[1]];
        let near_px = off_px[0].min(off_px[1]);
        if near_px > across_px {
            return None;
        }
        let is_black = (x * y > 0.0) == self.diagonal_is_black;
        let clear_px = |i: usize| (self.marker_margin * side_px[i] - MARKER_CLEARANCE_PX).max(WHITE_BAND_PX);
        if !is_black && off_px[0] > clear_px(0) && off_px[1] > clear_px(1) {
            return None;
        }
        // Near the edge along x the arm goes along x.
        Some(if off_px[1] < off_px[0] {
            if x > 0.0 { 0 } else { 2 }
        } else if y > 0.0 {
            1
        } else {
            3
        })
    }
}

fn value(image: &FloatImage, x: i64, y: i64) -> Option<f64> {
    let (x, y) = (usize::try_from(x).ok()?, usize::try_from(y).ok()?);
    (x < image.width).then(|| image.values.get(y * image.width + x)).flatten().map(|v| f64::from(*v))
}
