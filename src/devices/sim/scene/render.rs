//! What a camera sees of the display in both of its states, in cd/m2, free of noise.

use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use rayon::prelude::*;

use super::blur::{Quarters, Veil};
use super::occlusion::Shadow;
use super::optics::Lens;
use super::panel::{EmissionField, Panel};
use super::texture::Shares;
use crate::geometry::{Target, Transform};

/// Step of the search for the display in the image, px; also the border around what was found.
const SEARCH_STEP_PX: usize = 8;

/// A rectangle of pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Roi {
    pub(super) x: usize,
    pub(super) y: usize,
    pub(super) width: usize,
    pub(super) height: usize,
}

impl Roi {
    /// Index of a pixel within the rectangle.
    pub(super) fn index(&self, x: usize, y: usize) -> Option<usize> {
        let (x, y) = (x.checked_sub(self.x)?, y.checked_sub(self.y)?);
        (x < self.width && y < self.height).then_some(y * self.width + x)
    }
}

/// Both states of the scene in one camera: pattern first, then blended.
#[derive(Debug)]
pub(super) struct Rendered {
    /// Where the display is in the image; the background is everywhere else.
    pub(super) roi: Roi,
    planes: [Vec<f32>; 2],
    /// The part of both that does not come from the backlight; empty where that is steady.
    steady: Vec<f32>,
    /// Display row that each pixel of `roi` sees, 0 to 1.
    pub(super) scan: Vec<f32>,
    veils: [Veil; 2],
    direct_background: f32,
}

impl Rendered {
    /// Renders the display through a lens.
    pub(super) fn new<C>(panel: &Panel, lens: &Lens, camera_from_target: &Transform<C, Target>) -> Self {
        let caster = Caster::new(panel, camera_from_target);
        let roi = find_display(&caster, lens);
        let Cast { mut planes, mut steady, scan } = cast_all(&caster, lens, roi);
        let spec = &panel.spec;
        let background = spec.background_cd_m2 as f32;
        let direct = (1.0 - spec.glare) as f32;
        let size = [lens.optics.width, lens.optics.height];
        let veils = planes.each_mut().map(|plane| {
            let veil = Veil::new(plane, roi, size, background, spec.glare, spec.glare_sigma_px);
            plane.iter_mut().for_each(|v| *v *= direct);
            veil
        });
        steady.iter_mut().for_each(|v| *v *= direct);
        Self { roi, planes, steady, scan, veils, direct_background: direct * background }
    }

    /// Luminance of both states at a pixel, with glare, cd/m2.
    pub(super) fn states(&self, x: usize, y: usize) -> [f32; 2] {
        let index = self.roi.index(x, y);
        [0, 1].map(|s| self.veils[s].at(x, y) + index.map_or(self.direct_background, |i| self.planes[s][i]))
    }

    /// The luminance that does not come from the backlight; glare does.
    pub(super) fn steady(&self, x: usize, y: usize) -> f32 {
        self.roi.index(x, y).and_then(|i| self.steady.get(i).copied()).unwrap_or(self.direct_background)
    }

    /// Luminance at a pixel where the share `blend` of the time is spent in the blended state, cd/m2.
    ///
    /// Glare comes from the whole display, of which `mean_blend` is blended.
    pub(super) fn blended(&self, x: usize, y: usize, blend: impl Fn(f32) -> f32, mean_blend: f32) -> f32 {
        let [dark, bright] = [0, 1].map(|s| self.veils[s].at(x, y));
        let veil = dark + mean_blend * (bright - dark);
        veil + self.roi.index(x, y).map_or(self.direct_background, |i| {
            let [dark, bright] = [0, 1].map(|s| self.planes[s][i]);
            dark + blend(self.scan[i]) * (bright - dark)
        })
    }
}

/// What one camera saw last, with the pose to the last bit.
#[derive(Debug, Default)]
pub(super) struct Renders(Mutex<Option<([u64; 12], Arc<Rendered>)>>);

impl Renders {
    /// As [`Rendered::new`]; kept for the next call with the same pose, so always of one panel and one lens.
    pub(super) fn at<C>(&self, panel: &Panel, lens: &Lens, pose: &Transform<C, Target>) -> Arc<Rendered> {
        let key = bits(pose);
        if let Some((_, seen)) = self.last().as_ref().filter(|(at, _)| *at == key) {
            return Arc::clone(seen);
        }
        let seen = Arc::new(Rendered::new(panel, lens, pose));
        *self.last() = Some((key, Arc::clone(&seen)));
        seen
    }

    fn last(&self) -> std::sync::MutexGuard<'_, Option<([u64; 12], Arc<Rendered>)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The numbers of a pose, bit by bit.
fn bits<C>(pose: &Transform<C, Target>) -> [u64; 12] {
    let (rotation, translation_m) = (pose.rotation_matrix(), pose.translation_m());
    std::array::from_fn(|i| if i < 9 { rotation[i] } else { translation_m[i - 9] }.to_bits())
}

/// The smallest rectangle with the display in it, with a border for the point spread.
fn find_display(caster: &Caster, lens: &Lens) -> Roi {
    let (w, h) = (lens.optics.width, lens.optics.height);
    let coarse = |n: usize| (0..n).step_by(SEARCH_STEP_PX).chain(std::iter::once(n - 1));
    let mut bounds: Option<[usize; 4]> = None;
    for y in coarse(h) {
        for x in coarse(w).filter(|x| caster.meets(lens.ray(*x, y))) {
            let [x0, y0, x1, y1] = bounds.unwrap_or([x, y, x, y]);
            bounds = Some([x0.min(x), y0.min(y), x1.max(x), y1.max(y)]);
        }
    }
    let Some([x0, y0, x1, y1]) = bounds else { return Roi::default() };
    let border = SEARCH_STEP_PX + (4.0 * lens.optics.psf_sigma_px).ceil() as usize;
    let (x, y) = (x0.saturating_sub(border), y0.saturating_sub(border));
    Roi { x, y, width: (x1 + border + 1).min(w) - x, height: (y1 + border + 1).min(h) - y }
}

/// What the pixels of a rectangle see, as the lens blurs it.
struct Cast {
    planes: [Vec<f32>; 2],
    steady: Vec<f32>,
    scan: Vec<f32>,
}

fn cast_all(caster: &Caster, lens: &Lens, roi: Roi) -> Cast {
    let cast = |i: usize| {
        let (x, y) = (roi.x + i % roi.width, roi.y + i / roi.width);
        caster.cast(lens.ray(x, y), || lens.ray_slope(x, y))
    };
    let seen: Vec<Seen> = (0..roi.width * roi.height).into_par_iter().map(cast).collect();
    let blurred = |value: fn(&Seen, usize) -> f32| {
        let quarter = |q: usize| seen.iter().map(|seen| value(seen, q)).collect();
        Quarters { width: roi.width, planes: [0, 1, 2, 3].map(quarter) }.blurred(lens.optics.psf_sigma_px)
    };
    let planes = [blurred(|seen, q| seen.cd_m2[q][0]), blurred(|seen, q| seen.cd_m2[q][1])];
    let modulated = caster.panel.spec.pwm_hz > 0.0;
    let steady = if modulated { blurred(|seen, q| seen.steady[q]) } else { Vec::new() };
    Cast { planes, steady, scan: seen.iter().map(|seen| seen.scan).collect() }
}

/// What the quarters of one pixel (row by row) see before the lens blurs it.
pub(super) struct Seen {
    pub(super) cd_m2: [Shares; 4],
    /// The part of both states that does not come from the backlight.
    pub(super) steady: [f32; 4],
    scan: f32,
}

/// Where a ray meets the display, and how that point moves with the ray (m per unit of ray).
pub(super) struct Hit {
    pub(super) point_m: Vector2<f64>,
    pub(super) slope_m: Matrix2<f64>,
}

/// Follows rays of one camera to the display.
struct Caster<'a> {
    panel: &'a Panel,
    emission: EmissionField,
    occluders: Vec<Shadow<'a>>,
    target_from_camera: Matrix3<f64>,
    camera_in_target: Vector3<f64>,
}

impl<'a> Caster<'a> {
    fn new<C>(panel: &'a Panel, camera_from_target: &Transform<C, Target>) -> Self {
        let inverse = camera_from_target.inverse();
        let camera_in_target = Vector3::from(inverse.translation_m());
        Self {
            panel,
            occluders: panel.spec.occluders.iter().map(Shadow::new).collect(),
            emission: panel.emission_towards(camera_in_target),
            target_from_camera: inverse.rotation_matrix(),
            camera_in_target,
        }
    }

    /// Whether a ray meets anything that is not background.
    fn meets(&self, ray: [f64; 2]) -> bool {
        self.meets_display(ray) || self.meets_occluder(ray)
    }

    /// The point of the bent panel on a ray; `None` behind the camera or behind the display.
    fn hit(&self, ray: [f64; 2]) -> Option<Hit> {
        let r = &self.target_from_camera;
        let direction = r * Vector3::new(ray[0], ray[1], 1.0);
        let from = &self.camera_in_target;
        let in_front = direction.z > 1e-9 && from.z < -1e-6;
        if !in_front {
            return None;
        }
        let lateral = direction.xy() / direction.z;
        let flat = from.xy() - lateral * from.z;
        // The bow is thousands of times flatter than it is wide: two steps leave less than a nanometre.
        let once = flat + lateral * self.panel.bow.height_m(flat.x, flat.y);
        let point_m = flat + lateral * self.panel.bow.height_m(once.x, once.y);
        let depth = -from.z / direction.z;
        let across = r.fixed_view::<2, 2>(0, 0) - lateral * r.fixed_view::<1, 2>(2, 0);
        Some(Hit { point_m, slope_m: across * depth })
    }

    /// Where a ray meets the plane `z_m` of the target in front of the camera.
    fn cross(&self, ray: [f64; 2], z_m: f64) -> Option<Hit> {
        let r = &self.target_from_camera;
        let direction = r * Vector3::new(ray[0], ray[1], 1.0);
        let depth = (z_m - self.camera_in_target.z) / direction.z;
        let in_front = direction.z > 1e-9 && depth > 1e-6;
        let lateral = direction.xy() / direction.z;
        let across = r.fixed_view::<2, 2>(0, 0) - lateral * r.fixed_view::<1, 2>(2, 0);
        in_front.then(|| Hit { point_m: self.camera_in_target.xy() + direction.xy() * depth, slope_m: across * depth })
    }

    fn meets_occluder(&self, ray: [f64; 2]) -> bool {
        let inside = |shadow: &Shadow, hit: Hit| shadow.occluder.covers(&hit.point_m);
        self.occluders.iter().any(|s| self.cross(ray, -s.occluder.height_m).is_some_and(|hit| inside(s, hit)))
    }

    fn meets_display(&self, ray: [f64; 2]) -> bool {
        let border_m = self.panel.margin_m + self.panel.bezel_m;
        self.hit(ray).is_some_and(|hit| {
            let [w, h] = self.panel.size_m;
            (-border_m..=w + border_m).contains(&hit.point_m.x) && (-border_m..=h + border_m).contains(&hit.point_m.y)
        })
    }

    fn cast(&self, ray: [f64; 2], ray_slope: impl FnOnce() -> Matrix2<f64>) -> Seen {
        if self.occluders.is_empty() {
            return self.cast_display(ray, ray_slope);
        }
        let slope = ray_slope();
        let mut seen = self.cast_display(ray, || slope);
        for shadow in self.occluders.iter().rev() {
            if let Some(hit) = self.cross(ray, -shadow.occluder.height_m) {
                shadow.cover(&mut seen, &hit, &slope);
            }
        }
        seen
    }

    fn cast_display(&self, ray: [f64; 2], ray_slope: impl FnOnce() -> Matrix2<f64>) -> Seen {
        let Self { panel, emission, .. } = self;
        let (background, bezel) = (panel.spec.background_cd_m2 as f32, panel.spec.bezel_cd_m2 as f32);
        let Some(hit) = self.hit(ray) else {
            return Seen { cd_m2: [[background; 2]; 4], steady: [background; 4], scan: 0.0 };
        };
        let slope_m = hit.slope_m * ray_slope();
        let reflected = emission.reflected(hit.point_m);
        let emission = emission.at(hit.point_m);
        let texels = hit.point_m * panel.texels_per_m;
        let shares = panel.texture.quarters(texels.x, texels.y, &(slope_m * panel.texels_per_m));
        let scan = panel.scan(hit.point_m.y) as f32;
        // Half the width of a quarter along x and y of the board.
        let half_m = [0, 1].map(|i| 0.25 * slope_m.row(i).norm().max(1e-12));
        if self.lies_within(&hit, half_m) {
            let cd_m2 = shares.map(|quarter| quarter.map(|share| emission.luminance(share)));
            return Seen { cd_m2, steady: [emission.steady; 4], scan };
        }
        let quarter = |q: usize| {
            let side = |second: bool| if second { 0.25 } else { -0.25 };
            let point_m = hit.point_m + slope_m * Vector2::new(side(q % 2 == 1), side(q > 1));
            let body = self.covered(point_m, half_m, panel.margin_m + panel.bezel_m);
            let lit = self.covered(point_m, half_m, panel.margin_m);
            let around = background + body * (bezel + reflected - background);
            let mixed = |inside: f32| around + lit * (inside - around);
            (shares[q].map(|share| mixed(emission.luminance(share))), mixed(emission.steady))
        };
        let quarters = [0, 1, 2, 3].map(quarter);
        Seen { cd_m2: quarters.map(|q| q.0), steady: quarters.map(|q| q.1), scan }
    }

    /// Whether a pixel lies on the lit part of the display altogether.
    fn lies_within(&self, hit: &Hit, half_m: [f64; 2]) -> bool {
        let border_m = self.panel.margin_m;
        // Three half widths from the pixel's centre contain every quarter at any angle.
        (0..2).all(|i| {
            let room_m = 3.0 * half_m[i];
            (room_m - border_m..=self.panel.size_m[i] + border_m - room_m).contains(&hit.point_m[i])
        })
    }

    /// Share of a quarter of a pixel that lies on the board with `border_m` around it.
    fn covered(&self, point_m: Vector2<f64>, half_m: [f64; 2], border_m: f64) -> f32 {
        let axis = |i: usize| {
            let (low, high) = (point_m[i] - half_m[i], point_m[i] + half_m[i]);
            let inside = high.min(self.panel.size_m[i] + border_m) - low.max(-border_m);
            (inside / (2.0 * half_m[i])).clamp(0.0, 1.0)
        };
        (axis(0) * axis(1)) as f32
    }
}
