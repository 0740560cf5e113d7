//! How a camera sees a point, with derivatives; the nested models of its distortion.

use nalgebra::{Matrix2x3, SMatrix, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use crate::geometry::Pinhole;

/// Numbers of a lens: fx, fy, cx, cy, k1, k2, p1, p2, k3.
pub(super) const LENS: usize = 9;

/// The numbers of a lens, pixels and no unit.
pub(super) type Lens = [f64; LENS];

/// Which terms of distortion are solved; the others are 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Distortion {
    /// None.
    #[serde(rename = "none")]
    None,
    /// Radial of third order.
    #[serde(rename = "k1")]
    K1,
    /// Radial of fifth order.
    #[serde(rename = "k1 k2")]
    K1K2,
    /// Radial of fifth order, and a lens that is not quite centred.
    #[serde(rename = "k1 k2 p1 p2")]
    K1K2P1P2,
    /// All five terms.
    #[serde(rename = "k1 k2 p1 p2 k3")]
    All,
}

impl Distortion {
    /// Simplest first; each has the terms of those before it.
    pub const NESTED: [Self; 5] = [Self::None, Self::K1, Self::K1K2, Self::K1K2P1P2, Self::All];

    /// Number of terms, in the order k1, k2, p1, p2, k3.
    pub fn terms(self) -> usize {
        match self {
            Self::None => 0,
            Self::K1 => 1,
            Self::K1K2 => 2,
            Self::K1K2P1P2 => 4,
            Self::All => 5,
        }
    }

    /// The terms in words.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::K1 => "k1",
            Self::K1K2 => "k1 k2",
            Self::K1K2P1P2 => "k1 k2 p1 p2",
            Self::All => "k1 k2 p1 p2 k3",
        }
    }
}

/// The numbers of a camera.
pub(super) fn of_pinhole(camera: &Pinhole) -> Lens {
    let [k1, k2, p1, p2, k3] = camera.distortion;
    [camera.fx, camera.fy, camera.cx, camera.cy, k1, k2, p1, p2, k3]
}

/// The camera of these numbers, with the image of `like`.
pub(super) fn to_pinhole(lens: &Lens, like: &Pinhole) -> Pinhole {
    let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = *lens;
    Pinhole { width: like.width, height: like.height, fx, fy, cx, cy, distortion: [k1, k2, p1, p2, k3] }
}

/// Where a point is seen, and how that changes.
pub(super) struct Seen {
    /// Position, px.
    pub(super) px: Vector2<f64>,
    /// By the numbers of the lens.
    pub(super) by_lens: SMatrix<f64, 2, LENS>,
    /// By the point in the camera, px/m.
    pub(super) by_point: Matrix2x3<f64>,
}

/// Where a point in the camera (m) is seen, px; `None` at or behind the camera.
pub(super) fn project(lens: &Lens, point: &Vector3<f64>) -> Option<Vector2<f64>> {
    let in_front = point.z > 1e-6;
    if !in_front {
        return None;
    }
    let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = *lens;
    let (x, y) = (point.x / point.z, point.y / point.z);
    let r2 = x * x + y * y;
    let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
    let bent_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
    let bent_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
    Some(Vector2::new(fx * bent_x + cx, fy * bent_y + cy))
}

/// The same with its derivatives.
pub(super) fn project_with_slopes(lens: &Lens, point: &Vector3<f64>) -> Option<Seen> {
    let in_front = point.z > 1e-6;
    if !in_front {
        return None;
    }
    let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = *lens;
    let inverse_z = 1.0 / point.z;
    let (x, y) = (point.x * inverse_z, point.y * inverse_z);
    let r2 = x * x + y * y;
    let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
    let radial_slope = k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2);
    let bent_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
    let bent_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
    let xx = fx * (radial + 2.0 * x * x * radial_slope + 2.0 * p1 * y + 6.0 * p2 * x);
    let yy = fy * (radial + 2.0 * y * y * radial_slope + 6.0 * p1 * y + 2.0 * p2 * x);
    let mixed = 2.0 * x * y * radial_slope + 2.0 * p1 * x + 2.0 * p2 * y;
    let (xy, yx) = (fx * mixed, fy * mixed);
    let by_point = Matrix2x3::new(xx, xy, -(xx * x + xy * y), yx, yy, -(yx * x + yy * y)) * inverse_z;
    let (r4, r6) = (r2 * r2, r2 * r2 * r2);
    let terms = [
        [bent_x, 0.0],
        [0.0, bent_y],
        [1.0, 0.0],
        [0.0, 1.0],
        [fx * x * r2, fy * y * r2],
        [fx * x * r4, fy * y * r4],
        [fx * 2.0 * x * y, fy * (r2 + 2.0 * y * y)],
        [fx * (r2 + 2.0 * x * x), fy * 2.0 * x * y],
        [fx * x * r6, fy * y * r6],
    ];
    let by_lens = SMatrix::<f64, 2, LENS>::from_fn(|row, column| terms[column][row]);
    Some(Seen { px: Vector2::new(fx * bent_x + cx, fy * bent_y + cy), by_lens, by_point })
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRUTH: Lens = [2760.0, 2768.0, 700.0, 380.0, -0.21, 0.3, 0.0014, -0.0013, 0.7];

    #[test]
    fn the_slopes_are_those_of_small_differences() {
        for point in [[0.02, -0.01, 0.3], [-0.07, 0.05, 0.25], [0.0, 0.0, 1.0], [0.1, 0.1, 0.21]].map(Vector3::from) {
            let seen = project_with_slopes(&TRUTH, &point).unwrap();
            for i in 0..LENS {
                let step = 1e-6 * TRUTH[i].abs().max(1.0);
                let moved = |sign: f64| {
                    let mut lens = TRUTH;
                    lens[i] += sign * step;
                    project(&lens, &point).unwrap()
                };
                let slope = (moved(1.0) - moved(-1.0)) / (2.0 * step);
                assert!((slope - seen.by_lens.column(i)).norm() < 1e-6 * (1.0 + slope.norm()), "{i} at {point}");
            }
            for i in 0..3 {
                let step = Vector3::ith(i, 1e-7);
                let ends = [1.0, -1.0].map(|sign| project(&TRUTH, &(point + step * sign)).unwrap());
                let slope = (ends[0] - ends[1]) / 2e-7;
                assert!((slope - seen.by_point.column(i)).norm() < 1e-6 * (1.0 + slope.norm()), "{i} at {point}");
            }
        }
    }

    #[test]
    fn it_is_the_pinhole_of_the_program() {
        let like = Pinhole::centred(1380, 780, 1.0);
        let camera = to_pinhole(&TRUTH, &like);
        assert_eq!(of_pinhole(&camera), TRUTH);
        let point = Vector3::new(-0.05, 0.03, 0.3);
        let px = Vector2::from(camera.project(&point.into()).unwrap());
        assert!((px - project(&TRUTH, &point).unwrap()).norm() < 1e-9);
        assert!((px - project_with_slopes(&TRUTH, &point).unwrap().px).norm() < 1e-9);
        assert!(project(&TRUTH, &Vector3::new(0.0, 0.0, -0.3)).is_none());
    }
}
