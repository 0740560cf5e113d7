//! The frame camera: light over an exposure, noise, 8 bits.

use rand::Rng as _;
use rand_distr::StandardNormal;
use rayon::prelude::*;

use super::SceneError;
use super::backlight::Backlight;
use super::blink::Blink;
use super::noise::{Stream, rng};
use super::optics::{Lens, Optics};
use super::render::Rendered;
use super::spec::FrameSpec;
use crate::image::GrayImage;

/// Steps of the table of how long each display row was blended during an exposure.
const ROW_STEPS: usize = 256;

/// The frame camera.
#[derive(Debug)]
pub(super) struct FrameCamera {
    pub(super) lens: Lens,
    spec: FrameSpec,
    /// Gain of each pixel, around 1.
    gains: Vec<f32>,
    dn_per_cd_m2: f32,
    seed: u64,
}

impl FrameCamera {
    /// `white_cd_m2` is the luminance that gives `spec.white_dn`.
    pub(super) fn new(optics: Optics, spec: FrameSpec, white_cd_m2: f64, seed: u64) -> Result<Self, SceneError> {
        spec.check()?;
        let lens = Lens::new(optics)?;
        let mut rng = rng(seed, Stream::FixedPattern, 0, 0);
        let mut gain = || 1.0 + spec.prnu as f32 * rng.sample::<f32, _>(StandardNormal);
        let gains = (0..lens.optics.width * lens.optics.height).map(|_| gain()).collect();
        Ok(Self { dn_per_cd_m2: (spec.white_dn / white_cd_m2) as f32, lens, spec, gains, seed })
    }

    /// One exposure of what was rendered.
    pub(super) fn expose(
        &self,
        seen: &Rendered,
        blink: &Blink,
        backlight: Option<&Backlight>,
        start_s: f64,
        exposure_s: f64,
    ) -> GrayImage {
        let (width, height) = (self.lens.optics.width, self.lens.optics.height);
        let backlit = backlight.map(|backlight| backlight.mean(start_s, exposure_s) as f32);
        let rows = RowBlends::new(blink, start_s, exposure_s);
        let mut image = GrayImage::filled(width, height, 0);
        image.pixels.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            let mut rng = rng(self.seed, Stream::Exposure, start_s.to_bits(), y as u64);
            for (x, pixel) in row.iter_mut().enumerate() {
                let mut light = seen.blended(x, y, |scan| rows.at(scan), rows.mean);
                if let Some(backlit) = backlit {
                    let steady = seen.steady(x, y);
                    light = steady + backlit * (light - steady);
                }
                let signal = light * self.dn_per_cd_m2 * self.gains[y * width + x];
                *pixel = self.read_out(signal, rng.sample(StandardNormal));
            }
        });
        image
    }

    /// One state of the display without noise.
    pub(super) fn state(&self, seen: &Rendered, blended: bool) -> GrayImage {
        let (width, height) = (self.lens.optics.width, self.lens.optics.height);
        let value = |i: usize| seen.states(i % width, i / width)[usize::from(blended)] * self.dn_per_cd_m2;
        let pixels = (0..width * height).into_par_iter().map(|i| value(i).round() as u8).collect();
        GrayImage { width, height, pixels }
    }

    /// Adds shot and read noise (`normal` has mean 0 and deviation 1), then counts.
    fn read_out(&self, signal_dn: f32, normal: f32) -> u8 {
        let FrameSpec { electrons_per_dn, read_noise_dn, .. } = self.spec;
        let variance = signal_dn / electrons_per_dn as f32 + (read_noise_dn * read_noise_dn) as f32;
        (signal_dn + normal * variance.sqrt()).round() as u8
    }
}

/// Share of an exposure that each display row spent in the blended state.
struct RowBlends {
    table: Vec<f32>,
    mean: f32,
}

impl RowBlends {
    fn new(blink: &Blink, start_s: f64, exposure_s: f64) -> Self {
        let scan = |i: usize| i as f64 / ROW_STEPS as f64;
        let table: Vec<f32> = (0..=ROW_STEPS).map(|i| blink.mean_blend(start_s, exposure_s, scan(i)) as f32).collect();
        Self { mean: table.iter().sum::<f32>() / table.len() as f32, table }
    }

    fn at(&self, scan: f32) -> f32 {
        let at = scan * ROW_STEPS as f32;
        let low = (at as usize).min(ROW_STEPS - 1);
        self.table[low] + (at - low as f32) * (self.table[low + 1] - self.table[low])
    }
}
