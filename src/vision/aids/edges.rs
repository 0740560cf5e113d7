//! How wide the edges between black squares and white are: the 10-90 % width of the edge spread function.
//!
//! As in slanted-edge measurements (ISO 12233) pixels are projected onto the normal of the edge and nothing is
//! interpolated between pixels, which would blur by itself.

use super::super::plane::{BoardInImage, Quad};
use super::median;
use crate::board::Board;
use crate::image::GrayImage;

/// Part of a side that is looked at; the corners themselves are not.
const ALONG: [f64; 2] = [0.2, 0.8];
/// How far into a square and into the white around the board an edge is followed, squares.
const REACH: f64 = 0.4;
/// Part of that reach from which on it is taken for plain black or white.
const PLAIN: f64 = 0.6;
/// Width of a bin along the normal, px.
const BIN_PX: f64 = 0.5;
/// Narrower plains are nothing to measure on, px.
const PLAIN_MIN_PX: f64 = 1.0;
/// The step must be this high, DN.
const STEP_MIN: f64 = 10.0;
/// Wider than this share of the white strip beside a marker, an edge reaches into the marker.
const STRIP_SHARE: f64 = 0.5;

/// Widths of the edges that can be measured, px.
///
/// Edges inside the board have only a narrow white strip before a marker. Where they are too wide for it those on
/// the outside of the board count alone; if there are none either, the widths are too small.
pub(super) fn widths(image: &GrayImage, board: &Board, black: &[[u32; 2]], found: &BoardInImage) -> Vec<f64> {
    let sides: Vec<Side> = black.iter().flat_map(|square| Side::of(*square, board, found)).collect();
    let measured = |outer: bool| -> Vec<(f64, f64)> {
        let of_kind = sides.iter().filter(|side| side.outer == outer);
        of_kind.filter_map(|side| Some((side.width_px(image)?, side.white_px))).collect()
    };
    let (inner, outer) = (measured(false), measured(true));
    let shares: Vec<f64> = inner.iter().map(|(width_px, strip_px)| width_px / strip_px).collect();
    let fits = median(&shares).is_some_and(|share| share <= STRIP_SHARE);
    let counted = match (fits, outer.is_empty()) {
        (true, _) => [inner, outer].concat(),
        (false, true) => inner,
        (false, false) => outer,
    };
    counted.into_iter().map(|(width_px, _)| width_px).collect()
}

/// One side of a black square in the image.
#[derive(Debug, Clone, Copy)]
struct Side {
    /// Its ends, px.
    ends: [[f64; 2]; 2],
    /// From black to white, of length 1.
    outward: [f64; 2],
    /// How far black reaches to one side and white to the other, px.
    black_px: f64,
    white_px: f64,
    /// Whether it is on the outside of the board.
    outer: bool,
}

impl Side {
    fn of(square: [u32; 2], board: &Board, found: &BoardInImage) -> Vec<Self> {
        let [x, y] = square.map(f64::from);
        let last = [board.squares_x - 1, board.squares_y - 1];
        let strip = 0.5 * (1.0 - board.marker_m / board.square_m);
        let sides = [
            ([x, y], [x + 1.0, y], [0.0, -1.0], square[1] == 0),
            ([x + 1.0, y], [x + 1.0, y + 1.0], [1.0, 0.0], square[0] == last[0]),
            ([x + 1.0, y + 1.0], [x, y + 1.0], [0.0, 1.0], square[1] == last[1]),
            ([x, y + 1.0], [x, y], [-1.0, 0.0], square[0] == 0),
        ];
        let side = |(from, to, outward, outer): ([f64; 2], [f64; 2], [f64; 2], bool)| {
            let middle = [0.5 * (from[0] + to[0]), 0.5 * (from[1] + to[1])];
            let out = |squares: f64| [middle[0] + squares * outward[0], middle[1] + squares * outward[1]];
            let reach = [out(-REACH), out(if outer { REACH } else { strip })].map(|p| found.px(p));
            Self::new([found.px(from), found.px(to)], found.px(middle), reach, outer)
        };
        sides.into_iter().filter_map(side).collect()
    }

    fn new(ends: [[f64; 2]; 2], middle: [f64; 2], [black, white]: [[f64; 2]; 2], outer: bool) -> Option<Self> {
        let along = unit(ends[0], ends[1])?;
        let normal = [along[1], -along[0]];
        let over = |p: [f64; 2]| (p[0] - middle[0]) * normal[0] + (p[1] - middle[1]) * normal[1];
        let sign = over(white).signum();
        let outward = normal.map(|n| n * sign);
        Some(Self { ends, outward, black_px: -sign * over(black), white_px: sign * over(white), outer })
    }

    /// The part of the white that is white by itself, and how far it is looked at, px.
    fn white_plain_px(&self) -> [f64; 2] {
        if self.outer { [PLAIN * self.white_px, self.white_px] } else { [0.35 * self.white_px, 0.65 * self.white_px] }
    }

    /// `None` where it leaves the image, is too short, or has no step.
    fn width_px(&self, image: &GrayImage) -> Option<f64> {
        let [_, to_px] = self.white_plain_px();
        let wide_enough = (1.0 - PLAIN) * self.black_px >= PLAIN_MIN_PX && to_px >= 2.0 * PLAIN_MIN_PX;
        let straight = wide_enough.then(|| self.straightened(image)).flatten()?;
        straight.profile(image, ALONG)?.width_px(&straight)
    }

    /// The same side where the image has it: lenses bend boards by some pixels.
    fn straightened(&self, image: &GrayImage) -> Option<Self> {
        let middle = 0.5 * (ALONG[0] + ALONG[1]);
        let near = self.profile(image, [ALONG[0], middle])?.crossing(self, 0.5)?;
        let far = self.profile(image, [middle, ALONG[1]])?.crossing(self, 0.5)?;
        // The two halves are centred at 0.35 and 0.65 of the side.
        let slope = (far - near) / (0.5 * (ALONG[1] - ALONG[0]));
        let shift = |at: f64| near + (at - 0.5 * (ALONG[0] + middle)) * slope;
        let moved = |p: [f64; 2], by: f64| [p[0] + by * self.outward[0], p[1] + by * self.outward[1]];
        let ends = [moved(self.ends[0], shift(0.0)), moved(self.ends[1], shift(1.0))];
        let along = unit(ends[0], ends[1])?;
        let normal = [along[1], -along[0]];
        let sign = (normal[0] * self.outward[0] + normal[1] * self.outward[1]).signum();
        Some(Self { ends, outward: normal.map(|n| n * sign), ..*self })
    }

    fn profile(&self, image: &GrayImage, along: [f64; 2]) -> Option<Profile> {
        let [from, to] = self.ends;
        let at = |part: f64, out_px: f64| [0, 1].map(|i| from[i] + part * (to[i] - from[i]) + out_px * self.outward[i]);
        let (low_px, high_px) = (-self.black_px, self.white_plain_px()[1]);
        let quad = Quad([at(along[0], low_px), at(along[1], low_px), at(along[1], high_px), at(along[0], high_px)]);
        let (right, bottom) = (image.width as f64 - 1.0, image.height as f64 - 1.0);
        let inside = quad.0.iter().all(|[x, y]| (0.0..=right).contains(x) && (0.0..=bottom).contains(y));
        if !inside {
            return None;
        }
        let mut bins = vec![[0.0; 3]; ((high_px - low_px) / BIN_PX) as usize + 2];
        for (x, y) in quad.pixels(image) {
            let out_px = (x as f64 - from[0]) * self.outward[0] + (y as f64 - from[1]) * self.outward[1];
            if let Some([count, sum_px, sum]) = bins.get_mut(((out_px - low_px) / BIN_PX).max(0.0) as usize) {
                *count += 1.0;
                *sum_px += out_px;
                *sum += f64::from(image.at(x, y));
            }
        }
        let filled = bins.into_iter().filter(|[count, ..]| *count > 0.0);
        Some(Profile(filled.map(|[count, sum_px, sum]| [sum_px / count, sum / count]).collect()))
    }
}

fn unit(from: [f64; 2], to: [f64; 2]) -> Option<[f64; 2]> {
    let (x, y) = (to[0] - from[0], to[1] - from[1]);
    let length = x.hypot(y);
    (length > 1e-9).then(|| [x / length, y / length])
}

/// Mean values over the distance from the edge, px, black to white.
struct Profile(Vec<[f64; 2]>);

impl Profile {
    fn mean(&self, [from_px, to_px]: [f64; 2]) -> Option<f64> {
        let within: Vec<f64> = self.0.iter().filter(|p| (from_px..=to_px).contains(&p[0])).map(|p| p[1]).collect();
        (!within.is_empty()).then(|| within.iter().sum::<f64>() / within.len() as f64)
    }

    /// The same with black 0 and white 1; `None` without a step.
    fn steps(&self, side: &Side) -> Option<Vec<[f64; 2]>> {
        let black = self.mean([-side.black_px, -PLAIN * side.black_px])?;
        let white = self.mean(side.white_plain_px())?;
        (white - black >= STEP_MIN).then(|| self.0.iter().map(|p| [p[0], (p[1] - black) / (white - black)]).collect())
    }

    /// The crossing of half the step that is nearest to the expected edge, as an index of the bin before it.
    fn middle(steps: &[[f64; 2]]) -> Option<usize> {
        let crossings = (0..steps.len().saturating_sub(1)).filter(|&i| steps[i][1] < 0.5 && steps[i + 1][1] >= 0.5);
        crossings.min_by(|&a, &b| steps[a][0].abs().total_cmp(&steps[b][0].abs()))
    }

    /// Where the step passes `level`, next to its middle, px.
    fn crossing(&self, side: &Side, level: f64) -> Option<f64> {
        Self::cross(&self.steps(side)?, level)
    }

    fn cross(steps: &[[f64; 2]], level: f64) -> Option<f64> {
        let middle = Self::middle(steps)?;
        let passes = |i: &usize| steps[*i][1] <= level && steps[i + 1][1] > level;
        let before =
            if level <= 0.5 { (0..=middle).rev().find(passes) } else { (middle..steps.len() - 1).find(passes) };
        let [[x0, v0], [x1, v1]] = [steps[before?], steps[before? + 1]];
        Some(x0 + (level - v0) / (v1 - v0) * (x1 - x0))
    }

    fn width_px(&self, side: &Side) -> Option<f64> {
        let steps = self.steps(side)?;
        Some(Self::cross(&steps, 0.9)? - Self::cross(&steps, 0.1)?)
    }
}
