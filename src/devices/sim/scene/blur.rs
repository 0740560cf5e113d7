//! Point spread and glare: a Gaussian over the image of the display, a coarse one over the whole image.

use rayon::prelude::*;

use super::render::Roi;

/// An image at twice the resolution: its pixels at even and odd places, as four planes, row by row.
///
/// The point spread must act on something finer than the pixels: blurring the pixels themselves lets the shape
/// of an edge depend on where it lies between them, and corners are then found up to 0.05 px off.
#[derive(Debug)]
pub(super) struct Quarters {
    pub(super) width: usize,
    pub(super) planes: [Vec<f32>; 4],
}

impl Quarters {
    /// The image at pixel resolution, blurred; what is at the border goes on outside.
    pub(super) fn blurred(self, sigma_px: f64) -> Vec<f32> {
        let Self { width, planes: [even_even, even_odd, odd_even, odd_odd] } = self;
        if even_even.is_empty() {
            return Vec::new();
        }
        let kernel = half_kernel(sigma_px);
        let even = halve_x(&even_even, &even_odd, width, &kernel);
        let odd = halve_x(&odd_even, &odd_odd, width, &kernel);
        halve_y(&even, &odd, width, &kernel)
    }
}

/// Weights of the half pixels on one side of a pixel centre, nearest first; both sides together sum to 1.
fn half_kernel(sigma_px: f64) -> Vec<f32> {
    let gauss = |half_px: i32| match half_px {
        0 => 1.0,
        _ if sigma_px > 0.0 => (-0.125 * (f64::from(half_px) / sigma_px).powi(2)).exp(),
        _ => 0.0,
    };
    let reach = (8.0 * sigma_px).ceil() as i32;
    let weights: Vec<f64> = (0..=reach).map(|k| gauss(k) + gauss(k + 1)).collect();
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|w| (0.5 * w / sum) as f32).collect()
}

/// Blurs along rows and keeps one value for each pair of half pixels.
fn halve_x(even: &[f32], odd: &[f32], width: usize, kernel: &[f32]) -> Vec<f32> {
    let pad = kernel.len() / 2 + 1;
    let padded = |row: &[f32]| {
        let (first, last) = (row.first().copied().unwrap_or(0.0), row.last().copied().unwrap_or(0.0));
        let mut padded = vec![first; pad];
        padded.extend_from_slice(row);
        padded.resize(row.len() + 2 * pad, last);
        padded
    };
    let mut halved = vec![0.0; even.len()];
    let rows = halved.par_chunks_mut(width).zip(even.par_chunks(width)).zip(odd.par_chunks(width));
    rows.for_each(|((out, even), odd)| {
        let (even, odd) = (padded(even), padded(odd));
        for (k, weight) in kernel.iter().enumerate() {
            let (left, right) = if k % 2 == 0 { (&even, &odd) } else { (&odd, &even) };
            let step = k.div_ceil(2);
            for ((out, l), r) in out.iter_mut().zip(&left[pad - step..]).zip(&right[pad + step..]) {
                *out += weight * (l + r);
            }
        }
    });
    halved
}

/// The same along columns.
fn halve_y(even: &[f32], odd: &[f32], width: usize, kernel: &[f32]) -> Vec<f32> {
    let last = even.len() / width - 1;
    let mut halved = vec![0.0; even.len()];
    halved.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        for (k, weight) in kernel.iter().enumerate() {
            let (above, below) = if k % 2 == 0 { (even, odd) } else { (odd, even) };
            let step = k.div_ceil(2);
            let (above, below) = (&above[y.saturating_sub(step) * width..], &below[(y + step).min(last) * width..]);
            for ((out, a), b) in out.iter_mut().zip(above).zip(below) {
                *out += weight * (a + b);
            }
        }
    });
    halved
}

/// Side of the blocks in which glare is computed, px.
const BLOCK_PX: usize = 32;

/// The light that a lens spreads over the whole image, on a coarse grid, cd/m2.
#[derive(Debug)]
pub(super) struct Veil {
    columns: usize,
    rows: usize,
    values: Vec<f32>,
}

impl Veil {
    /// Spreads `share` of an image of `size` px that is `background` outside `roi`.
    pub(super) fn new(plane: &[f32], roi: Roi, size: [usize; 2], background: f32, share: f64, sigma_px: f64) -> Self {
        let [columns, rows] = size.map(|n| n.div_ceil(BLOCK_PX));
        // Blocks hold what exceeds the background, so that nothing changes at the border of the image.
        let mut values = vec![0.0; columns * rows];
        let scale = share as f32 / (BLOCK_PX * BLOCK_PX) as f32;
        for (line, y) in plane.chunks(roi.width.max(1)).zip(roi.y..) {
            for (v, x) in line.iter().zip(roi.x..) {
                values[y / BLOCK_PX * columns + x / BLOCK_PX] += (v - background) * scale;
            }
        }
        let quarters = Quarters { width: columns, planes: [0; 4].map(|_| values.clone()) };
        let mut values = quarters.blurred(sigma_px / BLOCK_PX as f64);
        values.iter_mut().for_each(|v| *v += share as f32 * background);
        Self { columns, rows, values }
    }

    /// Its value at a pixel.
    pub(super) fn at(&self, x: usize, y: usize) -> f32 {
        let split = |v: usize, n: usize| {
            let grid = ((v as f32 + 0.5) / BLOCK_PX as f32 - 0.5).clamp(0.0, (n - 1) as f32);
            let low = grid as usize;
            (low, (low + 1).min(n - 1), grid - low as f32)
        };
        let ((x0, x1, fx), (y0, y1, fy)) = (split(x, self.columns), split(y, self.rows));
        let line = |y: usize| {
            let (a, b) = (self.values[y * self.columns + x0], self.values[y * self.columns + x1]);
            a + fx * (b - a)
        };
        line(y0) + fy * (line(y1) - line(y0))
    }
}
