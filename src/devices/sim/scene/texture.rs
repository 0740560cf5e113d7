//! The two states of the display as shares of white, and their means over the footprint of a camera pixel.

use nalgebra::Matrix2;

use crate::board::blend_with_white;
use crate::image::GrayImage;

/// Camera pixels are sampled in this many steps each way; even.
const SUBSAMPLES: usize = 4;
/// Shares of white: the pattern, then the blended state.
pub(super) type Shares = [f32; 2];

/// The display content with a frame of one white texel around it.
#[derive(Debug)]
pub(super) struct Texture {
    width: usize,
    height: usize,
    shares: Vec<Shares>,
    /// Distance to the next texel of another value, in texels, the longer of both axes; 1 at an edge.
    depth: Vec<u8>,
}

impl Texture {
    pub(super) fn new(pattern: &GrayImage, alpha: f64, gamma: f64) -> Self {
        let blended = blend_with_white(pattern, alpha);
        let (width, height) = (pattern.width + 2, pattern.height + 2);
        let share = |code: u8| (f64::from(code) / 255.0).powf(gamma) as f32;
        let mut codes = vec![255; width * height];
        let mut shares = vec![[1.0; 2]; width * height];
        for y in 0..pattern.height {
            for x in 0..pattern.width {
                let i = (y + 1) * width + x + 1;
                codes[i] = pattern.at(x, y);
                shares[i] = [share(pattern.at(x, y)), share(blended.at(x, y))];
            }
        }
        Self { width, height, depth: depth(&codes, width, height), shares }
    }

    /// Columns and rows of the pattern.
    pub(super) fn size(&self) -> [usize; 2] {
        [self.width - 2, self.height - 2]
    }

    /// Means over the four quarters of a camera pixel (row by row) whose centre is at `u`, `v` texels from the
    /// top-left corner of the board.
    ///
    /// `slope` is the change of (u, v) per pixel to the right and per pixel down, as columns.
    pub(super) fn quarters(&self, u: f64, v: f64, slope: &Matrix2<f64>) -> [Shares; 4] {
        let reach = |row: usize| 0.5 * (slope[(row, 0)].abs() + slope[(row, 1)].abs());
        let (reach_u, reach_v) = (reach(0), reach(1));
        let [w, h] = self.size().map(|n| n as f64);
        let touches = u + reach_u > 0.0 && v + reach_v > 0.0 && u - reach_u < w && v - reach_v < h;
        if !touches {
            return [[1.0; 2]; 4];
        }
        let (u, v) = ((u + 1.0) as f32, (v + 1.0) as f32);
        let centre = self.index(u as i32, v as i32);
        if f64::from(self.depth[centre]) > reach_u.max(reach_v) + 1.0 {
            return [self.shares[centre]; 4];
        }
        self.supersampled(u, v, &slope.cast())
    }

    fn supersampled(&self, u: f32, v: f32, slope: &Matrix2<f32>) -> [Shares; 4] {
        let step = 1.0 / SUBSAMPLES as f32;
        // A box as wide as one step: an edge along the grid then moves the mean smoothly, not in jumps.
        let half = |row: usize| (0.5 * step * slope.row(row).norm()).clamp(1e-3, 0.5);
        let (half_u, half_v) = (half(0), half(1));
        let mut sums = [[0.0; 2]; 4];
        for j in 0..SUBSAMPLES {
            let dy = (j as f32 + 0.5) * step - 0.5;
            for i in 0..SUBSAMPLES {
                let dx = (i as f32 + 0.5) * step - 0.5;
                let at_u = u + dx * slope[(0, 0)] + dy * slope[(0, 1)];
                let at_v = v + dx * slope[(1, 0)] + dy * slope[(1, 1)];
                let [a, b] = self.boxed(at_u, half_u, at_v, half_v);
                let sum = &mut sums[j * 2 / SUBSAMPLES * 2 + i * 2 / SUBSAMPLES];
                *sum = [sum[0] + a, sum[1] + b];
            }
        }
        sums.map(|sum| sum.map(|s| s * 4.0 * step * step))
    }

    /// Mean over a box of at most one texel each way.
    fn boxed(&self, u: f32, half_u: f32, v: f32, half_v: f32) -> Shares {
        let ((x, wx), (y, wy)) = (straddle(u, half_u), straddle(v, half_v));
        let [a, b] = [self.index(x, y), self.index(x + 1, y)].map(|i| self.shares[i]);
        let [c, d] = [self.index(x, y + 1), self.index(x + 1, y + 1)].map(|i| self.shares[i]);
        [0, 1].map(|s| {
            let (top, bottom) = (a[s] + wx * (b[s] - a[s]), c[s] + wx * (d[s] - c[s]));
            top + wy * (bottom - top)
        })
    }

    fn index(&self, x: i32, y: i32) -> usize {
        let clamp = |v: i32, n: usize| (v.max(0) as usize).min(n - 1);
        clamp(y, self.height) * self.width + clamp(x, self.width)
    }
}

/// First texel that `centre - half` to `centre + half` touches, and the share of it that lies in the next one.
fn straddle(centre: f32, half: f32) -> (i32, f32) {
    let first = (centre - half).floor();
    (first as i32, ((centre + half - first - 1.0) / (2.0 * half)).clamp(0.0, 1.0))
}

/// Distance of each texel to the next one of another value, by two sweeps.
fn depth(codes: &[u8], width: usize, height: usize) -> Vec<u8> {
    let mut depth = vec![u8::MAX; codes.len()];
    let inside = |x: usize, y: usize, (dx, dy): (isize, isize)| {
        let (x, y) = (x.checked_add_signed(dx)?, y.checked_add_signed(dy)?);
        (x < width && y < height).then_some(y * width + x)
    };
    let before = [(-1, 0), (-1, -1), (0, -1), (1, -1)];
    let after = before.map(|(dx, dy)| (-dx, -dy));
    let mut visit = |x: usize, y: usize, neighbours: &[(isize, isize)]| {
        let here = y * width + x;
        for there in neighbours.iter().filter_map(|n| inside(x, y, *n)) {
            let near = if codes[there] == codes[here] { depth[there].saturating_add(1) } else { 1 };
            depth[here] = depth[here].min(near);
        }
    };
    for y in 0..height {
        (0..width).for_each(|x| visit(x, y, &before));
    }
    for y in (0..height).rev() {
        (0..width).rev().for_each(|x| visit(x, y, &after));
    }
    depth
}
