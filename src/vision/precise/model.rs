//! What an image looks like around an inner corner of the board: two black squares that touch, blurred.
//!
//! Black squares may be smaller or larger than they are (`erosion_px`): pixels next to an edge see too little change
//! to fire, and bright squares bloom. As both squares shrink alike, the corner between them stays where it is.

use nalgebra::SVector;

/// Parameters of a saddle.
pub(super) const PARAMETERS: usize = 11;

/// Values, by name.
pub(super) type Parameters = SVector<f64, PARAMETERS>;

/// Column of the corner; its row is the next.
pub(super) const X: usize = 0;
/// Row of the corner.
pub(super) const Y: usize = 1;
/// Direction of the edge along the board's x, rad.
pub(super) const ALONG_X: usize = 2;
/// Direction of the edge along the board's y, rad.
pub(super) const ALONG_Y: usize = 3;
/// Logarithm of the blur (standard deviation, px).
pub(super) const LN_BLUR: usize = 4;
/// How far black squares are smaller than they are, at each edge, px.
pub(super) const EROSION: usize = 5;
/// Value of white at the corner.
pub(super) const WHITE: usize = 6;
/// How white changes along the columns, per px.
pub(super) const SLOPE_X: usize = 7;
/// How white changes along the rows, per px.
pub(super) const SLOPE_Y: usize = 8;
/// What the first black square (the one at smaller y) adds to white.
pub(super) const FIRST: usize = 9;
/// What the second one adds.
pub(super) const SECOND: usize = 10;

/// Which squares around a corner are black.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Black {
    /// The ones at smaller x and y, and at larger x and y.
    Diagonal,
    /// The ones at larger x and smaller y, and at smaller x and larger y.
    AntiDiagonal,
}

/// The edges of the start, which the signs of distances follow.
#[derive(Debug, Clone, Copy)]
pub(super) struct Signs {
    /// Sign of the normal of the edge along y: towards larger x.
    across_x: f64,
    /// Sign of the normal of the edge along x: towards larger y.
    across_y: f64,
    black: Black,
}

impl Signs {
    /// Of directions of the board's x and y in the image.
    pub(super) fn of(along_x: [f64; 2], along_y: [f64; 2], black: Black) -> Self {
        // The normal of (cos, sin) is (sin, -cos).
        let sign = |of: [f64; 2], towards: [f64; 2]| (of[1] * towards[0] - of[0] * towards[1]).signum();
        Self { across_x: sign(along_y, along_x), across_y: sign(along_x, along_y), black }
    }
}

/// Value and derivatives at `d_px` from the start corner, which the first two parameters are relative to.
pub(super) fn evaluate(p: &Parameters, signs: &Signs, d_px: [f64; 2], shape: &Shape) -> (f64, Parameters) {
    let d = [d_px[0] - p[X], d_px[1] - p[Y]];
    let (nx, ny) = (shape.normal_x, shape.normal_y);
    let u = nx[0] * d[0] + nx[1] * d[1];
    let v = ny[0] * d[0] + ny[1] * d[1];
    // The first black square lies at smaller y.
    let first_u = if signs.black == Black::Diagonal { -1.0 } else { 1.0 };
    let [a, b] = [first_u * u, -first_u * u].map(|t| shape.inside(t));
    let [c, e] = [-v, v].map(|t| shape.inside(t));
    let (first, second) = (a.value * c.value, b.value * e.value);
    let (p1, p2) = (p[FIRST], p[SECOND]);
    let by_u = first_u * (p1 * a.slope * c.value - p2 * b.slope * e.value);
    let by_v = -p1 * a.value * c.slope + p2 * b.value * e.slope;
    let value = p[WHITE] + p[SLOPE_X] * d[0] + p[SLOPE_Y] * d[1] + p1 * first + p2 * second;
    let mut by = Parameters::zeros();
    by[X] = -by_u * nx[0] - by_v * ny[0] - p[SLOPE_X];
    by[Y] = -by_u * nx[1] - by_v * ny[1] - p[SLOPE_Y];
    // The normal (sin, -cos) turns into (cos, sin).
    by[ALONG_X] = by_v * signs.across_y * (shape.along_x[0] * d[0] + shape.along_x[1] * d[1]);
    by[ALONG_Y] = by_u * signs.across_x * (shape.along_y[0] * d[0] + shape.along_y[1] * d[1]);
    by[LN_BLUR] = p1 * (a.by_blur * c.value + a.value * c.by_blur) + p2 * (b.by_blur * e.value + b.value * e.by_blur);
    by[EROSION] = -p1 * (a.slope * c.value + a.value * c.slope) - p2 * (b.slope * e.value + b.value * e.slope);
    by[WHITE] = 1.0;
    by[SLOPE_X] = d[0];
    by[SLOPE_Y] = d[1];
    by[FIRST] = first;
    by[SECOND] = second;
    (value, by)
}

/// What the parameters say about every pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shape {
    along_x: [f64; 2],
    along_y: [f64; 2],
    normal_x: [f64; 2],
    normal_y: [f64; 2],
    per_blur: f64,
    erosion_px: f64,
}

impl Shape {
    pub(super) fn of(p: &Parameters, signs: &Signs) -> Self {
        let along = |angle: f64| [angle.cos(), angle.sin()];
        let (along_x, along_y) = (along(p[ALONG_X]), along(p[ALONG_Y]));
        let normal = |a: [f64; 2], sign: f64| [sign * a[1], -sign * a[0]];
        Self {
            along_x,
            along_y,
            normal_x: normal(along_y, signs.across_x),
            normal_y: normal(along_x, signs.across_y),
            per_blur: (-p[LN_BLUR]).exp(),
            erosion_px: p[EROSION],
        }
    }

    /// Whether a point at this signed distance is inside a blurred edge.
    fn inside(&self, distance_px: f64) -> Inside {
        let z = (distance_px - self.erosion_px) * self.per_blur;
        if z.abs() > 6.0 {
            return Inside { value: if z > 0.0 { 1.0 } else { 0.0 }, slope: 0.0, by_blur: 0.0 };
        }
        let (value, density) = normal(z);
        Inside { value, slope: density * self.per_blur, by_blur: -density * z }
    }
}

/// A blurred step and its derivatives by distance and by the logarithm of the blur.
#[derive(Clone, Copy)]
struct Inside {
    value: f64,
    slope: f64,
    by_blur: f64,
}

/// Distribution and density of the normal distribution; Abramowitz and Stegun (1964) 26.2.17, error below 7.5e-8.
fn normal(z: f64) -> (f64, f64) {
    const DENSITY_AT_0: f64 = 0.398_942_280_401_432_7;
    let density = DENSITY_AT_0 * (-0.5 * z * z).exp();
    let t = 1.0 / (1.0 + 0.231_641_9 * z.abs());
    let series =
        t * (0.319_381_530 + t * (-0.356_563_782 + t * (1.781_477_937 + t * (-1.821_255_978 + t * 1.330_274_429))));
    let tail = density * series;
    (if z > 0.0 { 1.0 - tail } else { tail }, density)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn awkward() -> Vec<(Parameters, Signs)> {
        let of = |along_x: f64, along_y: f64, black| {
            let signs = Signs::of([along_x.cos(), along_x.sin()], [along_y.cos(), along_y.sin()], black);
            let p = [0.3, -0.2, along_x, along_y, -0.1, 0.7, 210.0, 0.2, -0.1, -180.0, -150.0];
            (Parameters::from_column_slice(&p), signs)
        };
        vec![
            of(0.0, 1.57, Black::Diagonal),
            of(0.4, 1.9, Black::AntiDiagonal),
            // A board on its head, and one seen in a mirror.
            of(3.1, -1.6, Black::Diagonal),
            of(0.1, -1.4, Black::AntiDiagonal),
        ]
    }

    #[test]
    fn derivatives_are_those_of_the_values() {
        for (p, signs) in awkward() {
            for d in [[0.0, 0.0], [1.3, -0.7], [-2.0, 3.1], [0.4, 5.0], [-6.0, -0.3]] {
                let at = |p: &Parameters| evaluate(p, &signs, d, &Shape::of(p, &signs)).0;
                let (_, by) = evaluate(&p, &signs, d, &Shape::of(&p, &signs));
                for i in 0..PARAMETERS {
                    let step = 1e-3;
                    let (mut more, mut less) = (p, p);
                    more[i] += step;
                    less[i] -= step;
                    let numeric = (at(&more) - at(&less)) / (2.0 * step);
                    // The distribution is good to 7.5e-8, which the step and 330 gray levels turn into 0.025.
                    assert!((numeric - by[i]).abs() < 0.03 + 1e-3 * by[i].abs(), "{i} at {d:?}: {numeric} {}", by[i]);
                }
            }
        }
    }

    #[test]
    fn black_is_where_the_board_is_black() {
        for (p, signs) in awkward() {
            let shape = Shape::of(&p, &signs);
            let (along_x, along_y) = ([p[ALONG_X].cos(), p[ALONG_X].sin()], [p[ALONG_Y].cos(), p[ALONG_Y].sin()]);
            let at = |x: f64, y: f64| {
                let d = [0, 1].map(|i| p[i] + 8.0 * (x * along_x[i] + y * along_y[i]));
                evaluate(&p, &signs, d, &shape).0
            };
            let diagonal = [at(-1.0, -1.0), at(1.0, 1.0)];
            let anti_diagonal = [at(1.0, -1.0), at(-1.0, 1.0)];
            let (black, white) = match signs.black {
                Black::Diagonal => (diagonal, anti_diagonal),
                Black::AntiDiagonal => (anti_diagonal, diagonal),
            };
            assert!((black[0] - 30.0).abs() < 5.0 && (black[1] - 60.0).abs() < 5.0, "{black:?}");
            assert!(white.iter().all(|w| (w - 210.0).abs() < 5.0), "{white:?}");
        }
    }

    #[test]
    fn the_distribution_is_that_of_the_tables() {
        for (z, value) in [(0.0, 0.5), (1.0, 0.841_344_746), (-1.96, 0.024_997_895), (3.0, 0.998_650_102)] {
            assert!((normal(z).0 - value).abs() < 1e-7, "{z}");
        }
    }
}
