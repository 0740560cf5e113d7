//! A lens on a sensor, and the ray of every pixel.

use nalgebra::{Matrix2, Vector2};
use rand::Rng as _;
use rayon::prelude::*;

use super::SceneError;
use super::noise::{Stream, rng};
use super::spec::in_range;
use crate::geometry::Pinhole;

/// A lens on a sensor; pixel (0, 0) is the centre of the top-left pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Optics {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Focal length along x, px.
    pub fx: f64,
    /// Focal length along y, px.
    pub fy: f64,
    /// Principal point, x, px.
    pub cx: f64,
    /// Principal point, y, px.
    pub cy: f64,
    /// k1, k2, p1, p2, k3 of Brown and Conrady, as OpenCV has them.
    pub distortion: [f64; 5],
    /// Point spread, standard deviation, px.
    pub psf_sigma_px: f64,
}

impl Optics {
    /// An undistorted lens whose axis meets the centre of the sensor.
    pub fn nominal(width: usize, height: usize, focal_px: f64, psf_sigma_px: f64) -> Self {
        let (cx, cy) = ((width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0);
        Self { width, height, fx: focal_px, fy: focal_px, cx, cy, distortion: [0.0; 5], psf_sigma_px }
    }

    /// One lens of the series: focal length +-1 %, principal point +-20 px, k1 about -0.2, k2 about 0.3.
    ///
    /// Uniform within these limits; fy differs from fx by up to 0.05 %, p1 and p2 are up to 3e-4. The two
    /// cameras of a cell need different seeds.
    pub fn drawn(&self, seed: u64) -> Self {
        let mut rng = rng(seed, Stream::Lens, 0, 0);
        let mut within = |limit: f64| rng.random_range(-limit..=limit);
        let focal = 1.0 + within(0.01);
        Self {
            fx: self.fx * focal,
            fy: self.fy * focal * (1.0 + within(5e-4)),
            cx: self.cx + within(20.0),
            cy: self.cy + within(20.0),
            distortion: [-0.2 + within(0.02), 0.3 + within(0.05), within(3e-4), within(3e-4), 0.0],
            ..*self
        }
    }

    /// The same lens as a camera model.
    pub fn pinhole(&self) -> Pinhole {
        let &Self { width, height, fx, fy, cx, cy, distortion, .. } = self;
        Pinhole { width: width as u32, height: height as u32, fx, fy, cx, cy, distortion }
    }

    fn check(&self) -> Result<(), SceneError> {
        in_range("optics.width", self.width as f64, 16.0, 8192.0)?;
        in_range("optics.height", self.height as f64, 16.0, 8192.0)?;
        in_range("optics.fx", self.fx, 50.0, 1e5)?;
        in_range("optics.fy", self.fy, 50.0, 1e5)?;
        in_range("optics.cx", self.cx, -1e4, 2e4)?;
        in_range("optics.cy", self.cy, -1e4, 2e4)?;
        in_range("optics.psf_sigma_px", self.psf_sigma_px, 0.0, 20.0)?;
        self.distortion.iter().try_for_each(|k| in_range("optics.distortion", *k, -100.0, 100.0))
    }
}

/// A lens with the ray of every pixel.
#[derive(Debug)]
pub(super) struct Lens {
    pub(super) optics: Optics,
    pub(super) pinhole: Pinhole,
    /// x and y at unit depth of each pixel centre, row by row.
    rays: Vec<[f32; 2]>,
}

impl Lens {
    /// Refuses distortion that folds the image.
    pub(super) fn new(optics: Optics) -> Result<Self, SceneError> {
        optics.check()?;
        let pinhole = optics.pinhole();
        let ray = |i: usize| {
            let px = [(i % optics.width) as f64, (i / optics.width) as f64];
            let ideal = undistort(&pinhole, px).ok_or(SceneError::Lens { px })?;
            Ok([ideal.x as f32, ideal.y as f32])
        };
        let rays = (0..optics.width * optics.height).into_par_iter().map(ray).collect::<Result<_, SceneError>>()?;
        Ok(Self { optics, pinhole, rays })
    }

    /// x and y at unit depth of a pixel centre.
    pub(super) fn ray(&self, x: usize, y: usize) -> [f64; 2] {
        self.rays[y * self.optics.width + x].map(f64::from)
    }

    /// How the ray changes per pixel to the right and per pixel down, as columns.
    pub(super) fn ray_slope(&self, x: usize, y: usize) -> Matrix2<f64> {
        let (w, h) = (self.optics.width, self.optics.height);
        let step = |(x0, y0): (usize, usize), (x1, y1): (usize, usize)| {
            let (from, to) = (self.ray(x0, y0), self.ray(x1, y1));
            Vector2::new(to[0] - from[0], to[1] - from[1]) / ((x1 - x0) + (y1 - y0)) as f64
        };
        let right = step((x.saturating_sub(1), y), ((x + 1).min(w - 1), y));
        let down = step((x, y.saturating_sub(1)), (x, (y + 1).min(h - 1)));
        Matrix2::from_columns(&[right, down])
    }
}

/// Inverts the distortion by Newton steps; `None` where the lens folds the image.
fn undistort(pinhole: &Pinhole, px: [f64; 2]) -> Option<Vector2<f64>> {
    let bent = Vector2::new((px[0] - pinhole.cx) / pinhole.fx, (px[1] - pinhole.cy) / pinhole.fy);
    let mut ideal = bent;
    for _ in 0..30 {
        let jacobian = distortion_slope(pinhole, ideal);
        let upright = jacobian.determinant() > 0.0 && jacobian[(0, 0)] > 0.0;
        let step = jacobian.try_inverse().filter(|_| upright)? * (pinhole.distort(ideal) - bent);
        ideal -= step;
        if step.norm() < 1e-12 {
            return Some(ideal);
        }
    }
    None
}

/// Derivative of [`Pinhole::distort`].
fn distortion_slope(pinhole: &Pinhole, ideal: Vector2<f64>) -> Matrix2<f64> {
    let [k1, k2, p1, p2, k3] = pinhole.distortion;
    let (x, y) = (ideal.x, ideal.y);
    let r2 = x * x + y * y;
    let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
    let slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
    let cross = 2.0 * (x * y * slope + p1 * x + p2 * y);
    let xx = radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x;
    let yy = radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x;
    Matrix2::new(xx, cross, cross, yy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ray_of_a_pixel_is_seen_at_that_pixel() {
        let lens = Lens::new(Optics::nominal(400, 300, 800.0, 0.9).drawn(3)).unwrap();
        for (x, y) in (0..400).step_by(57).flat_map(|x| (0..300).step_by(23).map(move |y| (x, y))) {
            let [u, v] = lens.ray(x, y);
            let px = lens.pinhole.project(&nalgebra::Point3::new(u, v, 1.0)).unwrap();
            let error = (px[0] - x as f64).hypot(px[1] - y as f64);
            assert!(error < 1e-3, "{x} {y}: {error} px");
        }
    }

    #[test]
    fn lenses_of_a_series_stay_within_tolerance_and_differ() {
        let nominal = Optics::nominal(1280, 720, 2570.0, 0.85);
        let drawn: Vec<_> = (0..200).map(|seed| nominal.drawn(seed)).collect();
        let within = |o: &Optics| (o.fx / 2570.0 - 1.0).abs() <= 0.0101 && (o.cx - nominal.cx).abs() <= 20.0;
        assert!(drawn.iter().all(within));
        let spread = |f: fn(&Optics) -> f64| {
            let mean = drawn.iter().map(f).sum::<f64>() / 200.0;
            (drawn.iter().map(|o| (f(o) - mean).powi(2)).sum::<f64>() / 199.0).sqrt()
        };
        // Uniform within +-20 px: 11.5 px.
        assert!((9.5..13.5).contains(&spread(|o| o.cx)) && (9.5..13.5).contains(&spread(|o| o.cy)));
    }

    #[test]
    fn a_lens_that_folds_the_image_is_refused() {
        let folded = Optics { distortion: [-3.0, 0.0, 0.0, 0.0, 0.0], ..Optics::nominal(400, 300, 300.0, 0.9) };
        assert!(matches!(Lens::new(folded), Err(SceneError::Lens { .. })));
        let blind = Optics { fx: f64::NAN, ..Optics::nominal(400, 300, 300.0, 0.9) };
        assert!(matches!(Lens::new(blind), Err(SceneError::Value { name: "optics.fx", .. })));
    }
}
