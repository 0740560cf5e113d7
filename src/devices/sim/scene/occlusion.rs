//! How much of a pixel something before the display hides.

use nalgebra::{Matrix2, Vector2};

use super::overlay::Occluder;
use super::render::{Hit, Seen};

/// Quarters of a pixel are sampled in this many steps each way.
const SUBSAMPLES: usize = 4;

/// An occluder with the rectangle around it.
pub(super) struct Shadow<'a> {
    pub(super) occluder: &'a Occluder,
    low_m: Vector2<f64>,
    high_m: Vector2<f64>,
}

impl<'a> Shadow<'a> {
    pub(super) fn new(occluder: &'a Occluder) -> Self {
        let corners = || occluder.corners_m.iter().map(|corner| Vector2::from(*corner));
        let bound = |of: fn(f64, f64) -> f64, start: f64| {
            corners().fold(Vector2::repeat(start), |bound, corner| bound.zip_map(&corner, of))
        };
        Self { occluder, low_m: bound(f64::min, f64::INFINITY), high_m: bound(f64::max, f64::NEG_INFINITY) }
    }

    /// Hides what a pixel sees beyond `hit` in the plane of the occluder; `slope` is that of the ray per pixel.
    pub(super) fn cover(&self, seen: &mut Seen, hit: &Hit, slope: &Matrix2<f64>) {
        let slope_m = hit.slope_m * slope;
        let reach_m = Vector2::new(slope_m.row(0).norm(), slope_m.row(1).norm());
        let (low, high) = (self.low_m - reach_m, self.high_m + reach_m);
        let near = (0..2).all(|i| (low[i]..=high[i]).contains(&hit.point_m[i]));
        if !near {
            return;
        }
        for q in 0..4 {
            let share = self.share(hit.point_m, &slope_m, q);
            let mix = |v: f32| v + share * (self.occluder.cd_m2 as f32 - v);
            seen.cd_m2[q] = seen.cd_m2[q].map(mix);
            seen.steady[q] = mix(seen.steady[q]);
        }
    }

    /// Share of a quarter of the pixel that is hidden.
    fn share(&self, point_m: Vector2<f64>, slope_m: &Matrix2<f64>, quarter: usize) -> f32 {
        let step = 0.5 / SUBSAMPLES as f64;
        let offset = |half: usize, i: usize| (half as f64 - 1.0) * 0.5 + (i as f64 + 0.5) * step;
        let sample = |i: &usize| {
            let across = Vector2::new(offset(quarter % 2, i % SUBSAMPLES), offset(quarter / 2, i / SUBSAMPLES));
            self.occluder.covers(&(point_m + slope_m * across))
        };
        let hidden = (0..SUBSAMPLES * SUBSAMPLES).filter(sample).count();
        hidden as f32 / (SUBSAMPLES * SUBSAMPLES) as f32
    }
}
