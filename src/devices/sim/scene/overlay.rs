//! What lies over the picture of the display: the reflection of a lamp, a gripper in front of it.
//!
//! Points are in `target`: x right, y down, z into the display, origin at the board's top-left corner.

use nalgebra::{Vector2, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::SceneError;
use super::spec::in_range;

/// A lamp that the glass of the display reflects; it lowers the contrast where it is seen.
///
/// The lamp keeps its place before the display, so with a display on the arm it moves along.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Spotlight {
    /// Luminance that it adds at its centre, cd/m2.
    pub cd_m2: f64,
    /// Where a camera straight above it sees its centre, x and y on the board, m.
    pub centre_m: [f64; 2],
    /// Standard deviation of its Gaussian fall-off on the board, m.
    pub radius_m: f64,
    /// Distance of the lamp from the display, m: the reflection then moves with the camera. Absent: it stays.
    #[serde(default)]
    pub lamp_distance_m: Option<f64>,
}

impl Spotlight {
    pub(super) fn check(&self) -> Result<(), SceneError> {
        in_range("display.spotlight.cd_m2", self.cd_m2, 0.0, 1e5)?;
        self.centre_m.iter().try_for_each(|m| in_range("display.spotlight.centre_m", *m, -5.0, 5.0))?;
        in_range("display.spotlight.radius_m", self.radius_m, 1e-4, 5.0)?;
        let distance = |m| in_range("display.spotlight.lamp_distance_m", m, 0.01, 100.0);
        self.lamp_distance_m.map_or(Ok(()), distance)
    }

    /// The reflection as a camera at `camera_in_target` sees it: the lamp mirrored by the display.
    pub(super) fn seen_from(&self, camera_in_target: &Vector3<f64>) -> Reflection {
        let lamp = Vector2::from(self.centre_m);
        let depth_m = (-camera_in_target.z).max(0.0);
        let towards_camera = self.lamp_distance_m.map_or(0.0, |m| m / (m + depth_m));
        let centre_m = lamp + towards_camera * (camera_in_target.xy() - lamp);
        Reflection { peak_cd_m2: self.cd_m2, centre_m, radius_m: self.radius_m }
    }
}

/// The reflection of a lamp on the display.
#[derive(Debug, Clone)]
pub(super) struct Reflection {
    peak_cd_m2: f64,
    centre_m: Vector2<f64>,
    radius_m: f64,
}

impl Reflection {
    /// Luminance that it adds at a point of the display, cd/m2.
    pub(super) fn at(&self, point_m: Vector2<f64>) -> f32 {
        let squared = ((point_m - self.centre_m) / self.radius_m).norm_squared();
        (self.peak_cd_m2 * (-0.5 * squared).exp()) as f32
    }
}

/// Something flat and dark between the display and the cameras, such as a finger of the gripper.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Occluder {
    /// Corners of its outline, x and y in `target`, m; at least three.
    pub corners_m: Vec<[f64; 2]>,
    /// Height above the display, m.
    pub height_m: f64,
    /// Luminance, cd/m2.
    #[serde(default = "dark_cd_m2")]
    pub cd_m2: f64,
}

fn dark_cd_m2() -> f64 {
    1.0
}

impl Occluder {
    pub(super) fn check(&self) -> Result<(), SceneError> {
        in_range("number of display.occluders corners_m", self.corners_m.len() as f64, 3.0, 100.0)?;
        let coordinates = self.corners_m.iter().flatten();
        coordinates.into_iter().try_for_each(|m| in_range("display.occluders.corners_m", *m, -5.0, 5.0))?;
        in_range("display.occluders.height_m", self.height_m, 0.0, 1.0)?;
        in_range("display.occluders.cd_m2", self.cd_m2, 0.0, 1e4)
    }

    /// Whether a point of its plane lies within the outline (even-odd rule).
    pub(super) fn covers(&self, point_m: &Vector2<f64>) -> bool {
        let after = self.corners_m.iter().cycle().skip(1);
        let crossed = |(a, b): &(&[f64; 2], &[f64; 2])| {
            (a[1] > point_m.y) != (b[1] > point_m.y)
                && point_m.x < a[0] + (point_m.y - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
        };
        self.corners_m.iter().zip(after).filter(crossed).count() % 2 == 1
    }
}
