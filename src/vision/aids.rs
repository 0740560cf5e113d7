//! What helps to mount a camera: sharpness, exposure, contrast, events, and what to turn.
//!
//! Pure: an image and the corners found in it go in, numbers and advice come out. Start at [`Aids`].

mod advice;
mod edges;
#[cfg(test)]
mod tests;

use serde::Serialize;

use super::plane::BoardInImage;
use crate::board::{Board, View};
use crate::cv::{CvError, charuco};
use crate::image::GrayImage;

pub use advice::Reading;

/// Pixels a square of the drawing that tells black squares from white ones.
const DRAWN_PX: u32 = 40;
/// Rim of a black square that is not counted, as a share of its side: pixels next to an edge need not fire.
const RIM: f64 = 0.15;
/// The darkest and the brightest 5 % of the pixels do not decide where dark ends and light begins.
const TAIL: f64 = 0.05;

/// The aids for one board.
#[derive(Debug, Clone)]
pub struct Aids {
    board: Board,
    /// Column and row of every black square without a marker.
    black: Vec<[u32; 2]>,
}

/// What an image of the frame camera says about its mounting.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FrameAids {
    /// Corners found.
    pub corners: usize,
    /// Corners of the board.
    pub expected: usize,
    /// Share of the image that the board covers; absent where it was not found, as is the next.
    pub coverage: Option<f64>,
    /// Median width of the edges of squares, from 10 % to 90 % of the step, px.
    pub edge_width_px: Option<f64>,
    /// Edges that were measured.
    pub edges: usize,
    /// Whether the numbers below are of the board; of the whole image otherwise.
    pub of_board: bool,
    /// Share of the pixels at 0.
    pub at_0: f64,
    /// Share of the pixels at 255.
    pub at_255: f64,
    /// How dark black is: the lower quartile of the darker pixels, 0 to 255.
    pub dark: f64,
    /// How light white is: the upper quartile of the lighter pixels; blur makes the others darker.
    pub light: f64,
    /// (light - dark) / (light + dark).
    pub contrast: f64,
}

/// What a window of events says about the mounting of the event camera.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EventAids {
    /// Corners found.
    pub corners: usize,
    /// Corners of the board.
    pub expected: usize,
    /// Share of the image that the board covers; absent where it was not found, as is the next.
    pub coverage: Option<f64>,
    /// Share of the pixels of black squares that fired in the window.
    pub fill: Option<f64>,
    /// Events a second, thousands.
    pub rate_kev_s: f64,
    /// Length of the window, s.
    pub window_s: f64,
}

impl Aids {
    /// The aids for this board.
    pub fn new(board: &Board) -> Result<Self, CvError> {
        let pattern = charuco::draw(board, DRAWN_PX)?;
        let squares = (0..board.squares_y).flat_map(|y| (0..board.squares_x).map(move |x| [x, y]));
        // Markers leave the rim of their white square free.
        let black = squares.filter(|[x, y]| pattern.at((x * DRAWN_PX) as usize, (y * DRAWN_PX) as usize) == 0);
        Ok(Self { board: board.clone(), black: black.collect() })
    }

    /// Judges an image of the frame camera and the corners found in it.
    pub fn frame(&self, image: &GrayImage, view: &View) -> FrameAids {
        let found = BoardInImage::find(&self.board, view);
        let edges = found.as_ref().map(|found| edges::widths(image, &self.board, &self.black, found));
        let (edge_width_px, edges) = edges.map_or((None, 0), |widths| (median(&widths), widths.len()));
        let tones = match &found {
            Some(found) => Tones::of(found.outline().pixels(image).map(|(x, y)| image.at(x, y))),
            None => Tones::of(image.pixels.iter().copied()),
        };
        let Tones { at_0, at_255, dark, light } = tones;
        FrameAids {
            corners: view.corners.len(),
            expected: self.board.corner_count(),
            coverage: found.as_ref().map(|found| coverage(found, image)),
            edge_width_px,
            edges,
            of_board: found.is_some(),
            at_0,
            at_255,
            dark,
            light,
            contrast: if light + dark > 0.0 { (light - dark) / (light + dark) } else { 0.0 },
        }
    }

    /// Judges a window of `events` events over `window_s`; in `image` pixels that fired are 0.
    pub fn events(&self, image: &GrayImage, view: &View, events: usize, window_s: f64) -> EventAids {
        let found = BoardInImage::find(&self.board, view);
        EventAids {
            corners: view.corners.len(),
            expected: self.board.corner_count(),
            coverage: found.as_ref().map(|found| coverage(found, image)),
            fill: found.as_ref().and_then(|found| self.fill(found, image)),
            rate_kev_s: if window_s > 0.0 { events as f64 / window_s / 1e3 } else { 0.0 },
            window_s,
        }
    }

    fn fill(&self, found: &BoardInImage, image: &GrayImage) -> Option<f64> {
        let (mut fired, mut all) = (0_usize, 0_usize);
        for [x, y] in self.black.iter().map(|square| square.map(f64::from)) {
            let inner = found.quad([x + RIM, y + RIM], [x + 1.0 - RIM, y + 1.0 - RIM]);
            for (x, y) in inner.pixels(image) {
                fired += usize::from(image.at(x, y) == 0);
                all += 1;
            }
        }
        (all > 0).then(|| fired as f64 / all as f64)
    }
}

fn coverage(found: &BoardInImage, image: &GrayImage) -> f64 {
    found.outline().pixels(image).count() as f64 / image.pixels.len().max(1) as f64
}

/// How dark and light pixels are.
struct Tones {
    at_0: f64,
    at_255: f64,
    dark: f64,
    light: f64,
}

impl Tones {
    fn of(values: impl Iterator<Item = u8>) -> Self {
        let mut counts = [0_usize; 256];
        values.for_each(|v| counts[usize::from(v)] += 1);
        let all = counts.iter().sum::<usize>();
        let (low, high) = (quantile(&counts, TAIL), quantile(&counts, 1.0 - TAIL));
        let middle = (low + high) / 2;
        let [mut dark, mut light] = [counts; 2];
        dark[middle + 1..].fill(0);
        light[..=middle].fill(0);
        let share = |count: usize| count as f64 / all.max(1) as f64;
        let of_one_tone = light.iter().all(|count| *count == 0);
        let dark = quantile(&dark, 0.25) as f64;
        let light = if of_one_tone { dark } else { quantile(&light, 0.75) as f64 };
        Self { at_0: share(counts[0]), at_255: share(counts[255]), dark, light }
    }
}

/// The smallest value that a share of all does not exceed.
fn quantile(counts: &[usize; 256], share: f64) -> usize {
    let all = counts.iter().sum::<usize>() as f64;
    let mut sum = 0;
    let reached = |count: &usize| {
        sum += count;
        sum > 0 && sum as f64 >= share * all
    };
    counts.iter().position(reached).unwrap_or(0)
}

fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied()
}
