//! The display as a surface: its pattern, its bent shape, and the light it sends in a direction.

use nalgebra::{Vector2, Vector3};
use rand::Rng as _;

use super::noise::{Stream, rng};
use super::overlay::Reflection;
use super::spec::DisplaySpec;
use super::texture::Texture;
use crate::board::Board;

/// The display with the board on it, in `target`, metres.
#[derive(Debug)]
pub(super) struct Panel {
    pub(super) size_m: [f64; 2],
    pub(super) margin_m: f64,
    pub(super) bezel_m: f64,
    pub(super) texture: Texture,
    pub(super) texels_per_m: f64,
    pub(super) bow: Bow,
    pub(super) spec: DisplaySpec,
}

/// Luminance of code 0 (`base`) and what full white adds (`span`), cd/m2.
#[derive(Debug, Clone, Copy)]
pub(super) struct Emission {
    base: f32,
    span: f32,
    /// The part of `base` that does not come from the backlight.
    pub(super) steady: f32,
}

impl Emission {
    /// Luminance of a share of white, cd/m2.
    pub(super) fn luminance(self, share: f32) -> f32 {
        self.base + self.span * share
    }

    /// With light of another source reflected.
    fn reflecting(self, cd_m2: f32) -> Self {
        Self { base: self.base + cd_m2, steady: self.steady + cd_m2, ..self }
    }
}

impl Panel {
    pub(super) fn new(board: &Board, texture: Texture, spec: DisplaySpec, seed: u64) -> Self {
        let size_m = board.size_m();
        Self {
            size_m,
            margin_m: spec.margin_squares * board.square_m,
            bezel_m: spec.bezel_squares * board.square_m,
            texels_per_m: texture.size()[0] as f64 / size_m[0],
            texture,
            bow: Bow::new(size_m, spec.bow_m, seed),
            spec,
        }
    }

    /// Display row of a point, 0 at the top edge of the white margin to 1 at its bottom edge.
    pub(super) fn scan(&self, y_m: f64) -> f64 {
        ((y_m + self.margin_m) / (self.size_m[1] + 2.0 * self.margin_m)).clamp(0.0, 1.0)
    }

    /// What a point sends in the direction `to_camera` (unit length, in `target`).
    fn emission(&self, to_camera: &Vector3<f64>) -> Emission {
        let s = &self.spec;
        let (h2, v2, facing) = (to_camera.x.powi(2), to_camera.y.powi(2), (-to_camera.z).max(0.0));
        let steep = |square: f64| square.powf(s.leak_power);
        let diagonal = (h2 * v2).powf(0.5 * s.leak_power);
        let leak = s.leak_horizontal * steep(h2) + s.leak_vertical * steep(v2) + s.leak_diagonal * diagonal;
        let lit = if s.off { 0.0 } else { 1.0 };
        let white = lit * s.white_cd_m2 * facing.powf(s.off_axis_dimming);
        let black = (lit * s.black_cd_m2 + leak * white).min(white);
        let steady = s.ambient_cd_m2 as f32;
        Emission { base: (black + s.ambient_cd_m2) as f32, span: (white - black) as f32, steady }
    }

    /// The light towards a camera, for every point of the board.
    pub(super) fn emission_towards(&self, camera_in_target: Vector3<f64>) -> EmissionField {
        let [w, h] = self.size_m;
        let at = |x: f64, y: f64| self.emission(&(camera_in_target - Vector3::new(x, y, 0.0)).normalize());
        let reflection = self.spec.spotlight.as_ref().map(|spot| spot.seen_from(&camera_in_target));
        EmissionField { corners: [at(0.0, 0.0), at(w, 0.0), at(0.0, h), at(w, h)], size_m: self.size_m, reflection }
    }
}

/// Emission over the board: straight between its outer corners.
#[derive(Debug)]
pub(super) struct EmissionField {
    corners: [Emission; 4],
    size_m: [f64; 2],
    reflection: Option<Reflection>,
}

impl EmissionField {
    /// Emission at a point of the display, m.
    pub(super) fn at(&self, point_m: Vector2<f64>) -> Emission {
        let (u, v) = ((point_m.x / self.size_m[0]) as f32, (point_m.y / self.size_m[1]) as f32);
        let [a, b, c, d] = self.corners;
        let mix = |a: f32, b: f32, c: f32, d: f32| {
            let (top, bottom) = (a + u * (b - a), c + u * (d - c));
            (top + v * (bottom - top)).max(0.0)
        };
        let (base, span) = (mix(a.base, b.base, c.base, d.base), mix(a.span, b.span, c.span, d.span));
        Emission { base, span, steady: a.steady }.reflecting(self.reflected(point_m))
    }

    /// What the lamp adds at a point of the display, cd/m2.
    pub(super) fn reflected(&self, point_m: Vector2<f64>) -> f32 {
        self.reflection.as_ref().map_or(0.0, |reflection| reflection.at(point_m))
    }
}

/// Smooth out-of-plane shape: a quadratic with a random axis, zero mean over the board.
#[derive(Debug)]
pub(super) struct Bow {
    size_m: [f64; 2],
    /// Factors of X2, Y2 and XY with X and Y from -1 to 1 over the board; then the mean.
    terms_m: [f64; 3],
    mean_m: f64,
}

impl Bow {
    fn new(size_m: [f64; 2], bow_m: f64, seed: u64) -> Self {
        let mut rng = rng(seed, Stream::Bow, 0, 0);
        let mut term = || rng.random_range(0.3..1.0) * if rng.random() { 1.0 } else { -1.0 };
        let shape = Self { size_m, terms_m: [term(), term(), 0.5 * term()], mean_m: 0.0 };
        let steps = || (0..=20).map(|i| f64::from(i) / 20.0);
        let heights = steps().flat_map(|u| steps().map(move |v| (u, v)));
        let (low, high) = heights
            .map(|(u, v)| shape.height_m(u * size_m[0], v * size_m[1]))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), z| (low.min(z), high.max(z)));
        let terms_m = shape.terms_m.map(|t| t * bow_m / (high - low));
        Self { terms_m, mean_m: (terms_m[0] + terms_m[1]) / 3.0, ..shape }
    }

    /// z of the surface in `target` at a point of the board, m; level beyond 1.5 boards.
    pub(super) fn height_m(&self, x_m: f64, y_m: f64) -> f64 {
        let x = (2.0 * x_m / self.size_m[0] - 1.0).clamp(-1.5, 1.5);
        let y = (2.0 * y_m / self.size_m[1] - 1.0).clamp(-1.5, 1.5);
        self.terms_m[0] * x * x + self.terms_m[1] * y * y + self.terms_m[2] * x * y - self.mean_m
    }
}
