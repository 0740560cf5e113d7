//! A camera that fails at pose after pose is gone, and going on without it wins nothing.

use crate::geometry::Camera;

/// Poses in a row that were given up because the same camera failed.
#[derive(Debug, Default)]
pub(super) struct Failing {
    camera: Option<Camera>,
    poses: u32,
}

impl Failing {
    /// A pose is given up; `camera` failed there, or something else was wrong. A sentence when `allowed` poses are
    /// reached.
    pub(super) fn gave_up(&mut self, camera: Option<Camera>, why: &str, allowed: u32) -> Option<String> {
        let again = camera.is_some() && camera == self.camera;
        *self = Self { camera, poses: if again { self.poses + 1 } else { u32::from(camera.is_some()) } };
        let camera = self.camera.filter(|_| self.poses >= allowed)?;
        let poses = match self.poses {
            1 => "1 pose".to_owned(),
            poses => format!("{poses} poses in a row"),
        };
        Some(format!("the {camera} camera failed at {poses}, at the last one: {why}"))
    }
}
