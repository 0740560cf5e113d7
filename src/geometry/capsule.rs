//! Capsules, and how far they are from boxes: what keep-out boxes are checked with.

use nalgebra::Vector3;

use super::{Base, Point};

/// All points within `radius_m` of the straight line between two points, its axis.
#[derive(Debug, Clone, Copy)]
pub struct Capsule {
    /// One end of the axis.
    pub from: Point<Base>,
    /// The other end; may be the same: a ball.
    pub to: Point<Base>,
    /// Radius, metres.
    pub radius_m: f64,
}

/// Where the axis of a capsule comes nearest to a box.
#[derive(Debug, Clone, Copy)]
pub struct Nearest {
    /// Distance from the axis to the box, metres; 0 where the axis enters it.
    pub distance_m: f64,
    /// The point of the axis.
    pub on_axis: Point<Base>,
    /// The point of the box.
    pub on_box: Point<Base>,
}

impl Capsule {
    /// The shortest distance from the axis to the box from `min_m` to `max_m`, edges parallel to those of `base`.
    ///
    /// Exact: along the axis, the squared distance is convex and made of at most seven parabolas, which meet where
    /// the axis crosses the planes of the faces. A number that is not finite, or a box that is none, counts as inside.
    pub fn axis_to_box(&self, min_m: &[f64; 3], max_m: &[f64; 3]) -> Nearest {
        let (from, to) = (self.from.coords_m(), self.to.coords_m());
        let finite = from.iter().chain(&to).all(|v| v.is_finite());
        let is_box = min_m.iter().zip(max_m).all(|(min, max)| min <= max);
        if !(finite && is_box) {
            return Nearest { distance_m: 0.0, on_axis: self.from, on_box: self.from };
        }
        let along = to - from;
        let (cuts, used) = crossings(&from, &along, min_m, max_m);
        let mut best = nearest_at(0.0, &from, &along, min_m, max_m);
        for piece in cuts[..used].windows(2) {
            let fraction = lowest([piece[0], piece[1]], &from, &along, min_m, max_m);
            let here = nearest_at(fraction, &from, &along, min_m, max_m);
            let farther = here.distance_m >= best.distance_m;
            best = if farther { best } else { here };
        }
        // Sizes beyond what squares can hold end up here.
        if best.distance_m.is_nan() { Nearest { distance_m: 0.0, ..best } } else { best }
    }

    /// Free space between the capsule and the box, metres; negative where it enters, never NaN.
    pub fn gap_to_box_m(&self, min_m: &[f64; 3], max_m: &[f64; 3]) -> f64 {
        let gap_m = self.axis_to_box(min_m, max_m).distance_m - self.radius_m;
        if gap_m.is_nan() { f64::NEG_INFINITY } else { gap_m }
    }
}

/// 0, 1 and the fractions between at which the axis crosses the plane of a face, ascending; the first `.1` count.
fn crossings(from: &Vector3<f64>, along: &Vector3<f64>, min_m: &[f64; 3], max_m: &[f64; 3]) -> ([f64; 8], usize) {
    let mut cuts = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let mut used = 2;
    for i in 0..3 {
        for face_m in [min_m[i], max_m[i]] {
            // No number, or an infinite one, where the axis is parallel to the face.
            let fraction = (face_m - from[i]) / along[i];
            if fraction > 0.0 && fraction < 1.0 {
                cuts[used] = fraction;
                used += 1;
            }
        }
    }
    cuts[..used].sort_by(f64::total_cmp);
    (cuts, used)
}

/// The fraction in the piece at which its parabola is lowest.
fn lowest(piece: [f64; 2], from: &Vector3<f64>, along: &Vector3<f64>, min_m: &[f64; 3], max_m: &[f64; 3]) -> f64 {
    let [first, last] = piece;
    let middle = from + along * (0.5 * (first + last));
    let (mut missing, mut rate) = (0.0, 0.0);
    for i in 0..3 {
        let face_m = middle[i].clamp(min_m[i], max_m[i]);
        if face_m != middle[i] {
            missing += along[i] * (face_m - from[i]);
            rate += along[i] * along[i];
        }
    }
    // Inside, and for an axis without length, 0 / 0: the start of the piece is as good as any.
    (missing / rate).max(first).min(last)
}

fn nearest_at(fraction: f64, from: &Vector3<f64>, along: &Vector3<f64>, min_m: &[f64; 3], max_m: &[f64; 3]) -> Nearest {
    let axis = from + along * fraction;
    let on_box = Vector3::from_fn(|i, _| axis[i].clamp(min_m[i], max_m[i]));
    let point = |v: Vector3<f64>| Point::assume_frame(v.into());
    Nearest { distance_m: (axis - on_box).norm(), on_axis: point(axis), on_box: point(on_box) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MIN: [f64; 3] = [-0.1, -0.2, 0.3];
    const MAX: [f64; 3] = [0.4, 0.1, 0.5];

    fn capsule(from_m: [f64; 3], to_m: [f64; 3]) -> Capsule {
        Capsule { from: Point::assume_frame(from_m), to: Point::assume_frame(to_m), radius_m: 0.05 }
    }

    /// Numbers in -1 to 1, the same every time.
    fn numbers() -> impl FnMut() -> f64 {
        let mut state = 0x9e37_79b9_7f4a_7c15_u64;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        }
    }

    fn sampled_m(capsule: &Capsule, samples: u32) -> f64 {
        let (from, along) = (capsule.from.coords_m(), capsule.to.coords_m() - capsule.from.coords_m());
        let at = |i: u32| nearest_at(f64::from(i) / f64::from(samples), &from, &along, &MIN, &MAX).distance_m;
        (0..=samples).map(at).fold(f64::MAX, f64::min)
    }

    #[test]
    fn distance_is_the_one_that_sampling_finds() {
        let mut next = numbers();
        let (mut inside, mut edges) = (0, 0);
        for case in 0..3000 {
            let mut ends = [[next(), next(), next()], [next(), next(), next()]];
            // Axes along a coordinate, in the plane of a face, and without length.
            if case % 5 == 1 {
                ends[1] = [ends[0][0], ends[0][1], ends[1][2]];
            } else if case % 5 == 2 {
                (ends[0][2], ends[1][2]) = (MAX[2], MAX[2]);
            } else if case % 50 == 3 {
                ends[1] = ends[0];
            }
            let capsule = capsule(ends[0], ends[1]);
            let nearest = capsule.axis_to_box(&MIN, &MAX);
            let length_m = capsule.from.distance_m(capsule.to);
            let sampled_m = sampled_m(&capsule, 500);
            assert!(nearest.distance_m <= sampled_m + 1e-12, "{ends:?}: {nearest:?}, sampled {sampled_m}");
            // The nearest sample is at most half a step away.
            assert!(nearest.distance_m >= sampled_m - length_m / 1000.0 - 1e-12, "{ends:?}: {nearest:?}, {sampled_m}");
            assert!((nearest.on_axis.distance_m(nearest.on_box) - nearest.distance_m).abs() < 1e-12);
            inside += u32::from(nearest.distance_m == 0.0);
            edges += u32::from(nearest.distance_m > 0.0 && nearest.distance_m < sampled_m - 1e-9);
        }
        assert!(inside > 200 && edges > 200, "the cases are too kind: {inside} {edges}");
    }

    #[test]
    fn known_distances() {
        let beside = capsule([0.5, 0.0, 0.0], [0.5, 0.0, 1.0]);
        assert!((beside.axis_to_box(&MIN, &MAX).distance_m - 0.1).abs() < 1e-15);
        assert!((beside.gap_to_box_m(&MIN, &MAX) - 0.05).abs() < 1e-15);
        // Past an edge, along the diagonal of x and y: the corner of the box at (0.4, 0.1).
        let past = capsule([0.6, 0.1, 0.4], [0.4, 0.3, 0.4]);
        assert!((past.axis_to_box(&MIN, &MAX).distance_m - 0.2 / 2.0_f64.sqrt()).abs() < 1e-15);
        let through = capsule([-1.0, 0.0, 0.4], [1.0, 0.0, 0.4]);
        assert_eq!(through.axis_to_box(&MIN, &MAX).distance_m, 0.0);
        assert!((through.gap_to_box_m(&MIN, &MAX) + 0.05).abs() < 1e-15);
        let thin = capsule([0.0, 0.0, 0.0], [0.0, 1e-300, 0.0]);
        assert!((thin.axis_to_box(&MIN, &MAX).distance_m - 0.3).abs() < 1e-15);
    }

    #[test]
    fn what_is_no_number_hits() {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e200] {
            let hit = capsule([5.0, bad, 5.0], [6.0, 5.0, 5.0]);
            let far = bad == 1e200;
            assert_eq!(hit.axis_to_box(&MIN, &MAX).distance_m > 0.0, far, "{bad}");
        }
        let far = capsule([5.0; 3], [6.0; 3]);
        assert_eq!(far.axis_to_box(&[f64::NAN; 3], &MAX).distance_m, 0.0);
        assert_eq!(far.axis_to_box(&MAX, &MIN).distance_m, 0.0);
        assert!(Capsule { radius_m: f64::NAN, ..far }.gap_to_box_m(&MIN, &MAX) < 0.0);
    }
}
