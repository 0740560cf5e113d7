//! The pinhole camera with Brown-Conrady distortion, as OpenCV's five-term model.

use nalgebra::{Point3, Vector2};
use serde::{Deserialize, Serialize};

/// Intrinsics of a camera, pixels; pixel (0, 0) is the centre of the top-left pixel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pinhole {
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Focal length along x, pixels.
    pub fx: f64,
    /// Focal length along y, pixels.
    pub fy: f64,
    /// Principal point, x.
    pub cx: f64,
    /// Principal point, y.
    pub cy: f64,
    /// k1, k2, p1, p2, k3.
    pub distortion: [f64; 5],
}

impl Pinhole {
    /// A camera without distortion whose axis meets the centre of the image.
    pub fn centred(width: u32, height: u32, focal_px: f64) -> Self {
        let (cx, cy) = ((f64::from(width) - 1.0) / 2.0, (f64::from(height) - 1.0) / 2.0);
        Self { width, height, fx: focal_px, fy: focal_px, cx, cy, distortion: [0.0; 5] }
    }

    /// Where a point in the camera frame (m) is seen, in pixels; `None` at or behind the camera.
    pub fn project(&self, point_in_camera: &Point3<f64>) -> Option<[f64; 2]> {
        let in_front = point_in_camera.z > 1e-9;
        in_front.then(|| {
            let normalised = Vector2::new(point_in_camera.x, point_in_camera.y) / point_in_camera.z;
            let bent = self.distort(normalised);
            [self.fx * bent.x + self.cx, self.fy * bent.y + self.cy]
        })
    }

    /// Bends an ideal image point (at unit depth) as the lens does.
    pub fn distort(&self, ideal: Vector2<f64>) -> Vector2<f64> {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let (x, y) = (ideal.x, ideal.y);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        Vector2::new(
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )
    }

    /// Whether a pixel position lies inside the image.
    pub fn sees(&self, px: [f64; 2]) -> bool {
        (-0.5..f64::from(self.width) - 0.5).contains(&px[0]) && (-0.5..f64::from(self.height) - 0.5).contains(&px[1])
    }
}
