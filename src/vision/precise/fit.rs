//! Fits the saddle to a patch by least squares, and says how well the corner is known.

use nalgebra::{Matrix2, SMatrix};

use super::model::{self, Black, PARAMETERS, Parameters, Shape, Signs};
use super::patch::{Local, Mask, Patch, Sample};
use crate::image::FloatImage;

/// A fit has arrived when the corner moves by less, px.
const ARRIVED_PX: f64 = 2e-4;
const STEPS_MAX: usize = 25;
/// Residuals beyond this many standard deviations count less, Huber (1964).
const HUBER: f64 = 2.5;
/// Fewest pixels for eleven parameters.
const SAMPLES_MIN: usize = 80;

/// A corner by the fit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fit {
    /// Where it is, px.
    pub(super) px: [f64; 2],
    /// Covariance (xx, xy, yy), px2; from the residuals themselves, so it needs no model of the noise.
    pub(super) covariance_px2: [f64; 3],
    /// From the start, px.
    pub(super) moved_px: f64,
    /// Directions from the start, rad, the larger one.
    pub(super) turned_rad: f64,
    /// Standard deviation of the blur, px.
    pub(super) blur_px: f64,
    pub(super) erosion_px: f64,
    /// What the two black squares add to white.
    pub(super) steps: [f64; 2],
    /// RMS of the residuals of each arm as a share of the mean step.
    pub(super) arm_rms: [f64; 4],
}

/// What the image is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Light {
    /// Luminance: white may change across the patch.
    Frame,
    /// How often pixels fired: white is silent everywhere.
    Events,
}

type Normal = SMatrix<f64, PARAMETERS, PARAMETERS>;

/// Fits the corner at `local`; `None` where there is too little to fit or no minimum.
pub(super) fn fit(image: &FloatImage, local: &Local, mask: Mask, light: Light) -> Option<Fit> {
    let patch = Patch::cut(image, local, mask)?;
    let enough = patch.samples.len() >= SAMPLES_MIN && patch.samples.len() > patch.outside;
    if !enough {
        return None;
    }
    let black = if mask.diagonal_is_black { Black::Diagonal } else { Black::AntiDiagonal };
    let signs = Signs::of(local.along_x_px, local.along_y_px, black);
    let start = start(&patch.samples, local, light);
    let solver = Solver { samples: &patch.samples, signs, light };
    let found = solver.minimise(start)?;
    solver.judge(&start, &found, local)
}

fn start(samples: &[Sample], local: &Local, light: Light) -> Parameters {
    let mut values: Vec<f64> = samples.iter().map(|s| s.value).collect();
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values[((values.len() - 1) as f64 * share) as usize];
    let (low, high) = (at(0.1), at(0.9));
    let (white, step) = if light == Light::Frame { (high, low - high) } else { (low, high - low) };
    let angle = |a: [f64; 2]| a[1].atan2(a[0]);
    let erosion_px = if light == Light::Frame { 0.0 } else { 0.8 };
    let (along_x, along_y) = (angle(local.along_x_px), angle(local.along_y_px));
    Parameters::from_column_slice(&[0.0, 0.0, along_x, along_y, 0.0, erosion_px, white, 0.0, 0.0, step, step])
}

struct Solver<'a> {
    samples: &'a [Sample],
    signs: Signs,
    light: Light,
}

/// Normal equations at some parameters.
struct Equations {
    normal: Normal,
    right: Parameters,
    cost: f64,
    scale: f64,
}

impl Solver<'_> {
    /// Levenberg-Marquardt (1963).
    fn minimise(&self, start: Parameters) -> Option<Parameters> {
        let mut p = start;
        let mut scale = f64::INFINITY;
        let mut at = self.equations(&p, scale);
        let mut damping = 1e-3;
        for _ in 0..STEPS_MAX {
            let mut damped = at.normal;
            for i in 0..PARAMETERS {
                damped[(i, i)] += damping * at.normal[(i, i)].max(1e-12);
            }
            let step = damped.cholesky()?.solve(&at.right);
            let next = self.within(p + step);
            let then = self.equations(&next, scale);
            let better = then.cost <= at.cost;
            if !better {
                damping *= 10.0;
                if damping > 1e6 {
                    break;
                }
                continue;
            }
            let moved_px = (next[model::X] - p[model::X]).hypot(next[model::Y] - p[model::Y]);
            let gained = at.cost - then.cost;
            (p, damping) = (next, (damping * 0.2).max(1e-9));
            let arrived = moved_px < ARRIVED_PX && gained <= 1e-4 * at.cost;
            // The scale follows the residuals, the first time from rough to robust.
            let first = scale.is_infinite();
            scale = then.scale;
            at = self.equations(&p, scale);
            if arrived && !first {
                break;
            }
        }
        p.iter().all(|v| v.is_finite()).then_some(p)
    }

    /// Keeps blur and erosion where they can be.
    fn within(&self, mut p: Parameters) -> Parameters {
        p[model::LN_BLUR] = p[model::LN_BLUR].clamp(-1.6, 1.6);
        p[model::EROSION] = p[model::EROSION].clamp(-3.0, 5.0);
        if self.light == Light::Events {
            (p[model::SLOPE_X], p[model::SLOPE_Y]) = (0.0, 0.0);
        }
        p
    }

    fn equations(&self, p: &Parameters, scale: f64) -> Equations {
        let shape = Shape::of(p, &self.signs);
        let (mut normal, mut right) = (Normal::zeros(), Parameters::zeros());
        let (mut cost, mut squares) = (0.0, 0.0);
        let limit = HUBER * scale;
        for sample in self.samples {
            let (value, by) = model::evaluate(p, &self.signs, sample.d_px, &shape);
            let residual = sample.value - value;
            let size = residual.abs();
            let weight = if size <= limit { 1.0 } else { limit / size };
            cost += if size <= limit { residual * residual } else { limit * (2.0 * size - limit) };
            squares += residual * residual;
            accumulate(&mut normal, &by, weight);
            right += by * (weight * residual);
        }
        if self.light == Light::Events {
            for i in [model::SLOPE_X, model::SLOPE_Y] {
                normal.row_mut(i).fill(0.0);
                normal.column_mut(i).fill(0.0);
                normal[(i, i)] = 1.0;
                right[i] = 0.0;
            }
        }
        symmetric(&mut normal);
        Equations { normal, right, cost, scale: (squares / self.samples.len() as f64).sqrt().max(1e-9) }
    }

    fn judge(&self, start: &Parameters, p: &Parameters, local: &Local) -> Option<Fit> {
        let shape = Shape::of(p, &self.signs);
        let (mut normal, mut spread) = (Normal::zeros(), Normal::zeros());
        let (mut arms, mut counts) = ([0.0; 4], [0_u32; 4]);
        for sample in self.samples {
            let (value, mut by) = model::evaluate(p, &self.signs, sample.d_px, &shape);
            if self.light == Light::Events {
                (by[model::SLOPE_X], by[model::SLOPE_Y]) = (0.0, 0.0);
            }
            let residual = sample.value - value;
            accumulate(&mut normal, &by, 1.0);
            accumulate(&mut spread, &by, residual * residual);
            arms[sample.arm] += residual * residual;
            counts[sample.arm] += 1;
        }
        for i in 0..PARAMETERS {
            normal[(i, i)] = if normal[(i, i)] > 0.0 { normal[(i, i)] } else { 1.0 };
        }
        symmetric(&mut normal);
        symmetric(&mut spread);
        let inverse = normal.cholesky()?.inverse();
        let free = self.samples.len() as f64 / (self.samples.len() - PARAMETERS) as f64;
        let covariance = inverse * spread * inverse * free;
        let corner = Matrix2::from_fn(|r, c| covariance[(r, c)]);
        let steps = [p[model::FIRST], p[model::SECOND]];
        let step = 0.5 * (steps[0].abs() + steps[1].abs()).max(1e-9);
        let rms = |i: usize| (arms[i] / f64::from(counts[i].max(1))).sqrt() / step;
        let turned = |i: usize| {
            let turn = (p[i] - start[i]).rem_euclid(std::f64::consts::TAU);
            turn.min(std::f64::consts::TAU - turn)
        };
        Some(Fit {
            px: [local.at_px[0] + p[model::X], local.at_px[1] + p[model::Y]],
            covariance_px2: [corner[(0, 0)], corner[(0, 1)], corner[(1, 1)]],
            moved_px: p[model::X].hypot(p[model::Y]),
            turned_rad: turned(model::ALONG_X).max(turned(model::ALONG_Y)),
            blur_px: p[model::LN_BLUR].exp(),
            erosion_px: p[model::EROSION],
            steps,
            arm_rms: [rms(0), rms(1), rms(2), rms(3)],
        })
    }
}

/// Adds `weight * by * by^T`, the lower half only.
fn accumulate(normal: &mut Normal, by: &Parameters, weight: f64) {
    for c in 0..PARAMETERS {
        let factor = weight * by[c];
        for r in c..PARAMETERS {
            normal[(r, c)] += factor * by[r];
        }
    }
}

/// Fills the upper half from the lower one.
fn symmetric(normal: &mut Normal) {
    for c in 0..PARAMETERS {
        for r in c + 1..PARAMETERS {
            normal[(c, r)] = normal[(r, c)];
        }
    }
}
