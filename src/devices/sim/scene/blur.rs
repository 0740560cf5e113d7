//! Point spread and glare: a Gaussian over the image of the display, a coarse one over the whole image.

use rayon::prelude::*;

use super::render::Roi;

/// Blurs a plane of `width` columns in place; the edge values go on outside.
pub(super) fn gaussian(plane: &mut [f32], width: usize, sigma_px: f64) {
    let kernel = kernel(sigma_px);
    let radius = kernel.len() / 2;
    if radius == 0 || plane.is_empty() {
        return;
    }
    plane.par_chunks_mut(width).for_each(|row| blur_row(row, &kernel));
    let source = plane.to_vec();
    let height = source.len() / width;
    plane.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        row.fill(0.0);
        for (k, weight) in kernel.iter().enumerate() {
            let from = (y + k).saturating_sub(radius).min(height - 1);
            for (out, v) in row.iter_mut().zip(&source[from * width..]) {
                *out += weight * v;
            }
        }
    });
}

fn blur_row(row: &mut [f32], kernel: &[f32]) {
    let radius = kernel.len() / 2;
    let (Some(&first), Some(&last)) = (row.first(), row.last()) else { return };
    let mut padded = vec![first; radius];
    padded.extend_from_slice(row);
    padded.resize(row.len() + 2 * radius, last);
    row.fill(0.0);
    for (k, weight) in kernel.iter().enumerate() {
        for (out, v) in row.iter_mut().zip(&padded[k..]) {
            *out += weight * v;
        }
    }
}

/// Gaussian weights of odd length, sum 1, cut at four standard deviations.
fn kernel(sigma: f64) -> Vec<f32> {
    let radius = (4.0 * sigma).ceil() as i32;
    let weight = |i: i32| if sigma > 0.0 { (-0.5 * (f64::from(i) / sigma).powi(2)).exp() } else { 1.0 };
    let weights: Vec<f64> = (-radius..=radius).map(weight).collect();
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|w| (w / sum) as f32).collect()
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
        gaussian(&mut values, columns, sigma_px / BLOCK_PX as f64);
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
