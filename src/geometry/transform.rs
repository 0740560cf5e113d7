//! Rigid transforms and points that carry their frames in their types.

use std::marker::PhantomData;
use std::ops::Mul;

use nalgebra::{Isometry3, Matrix3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _};

use super::{frames::Frame, rotation};

/// Rigid transform that takes coordinates in `From` to coordinates in `To`. Metres.
pub struct Transform<To, From> {
    iso: Isometry3<f64>,
    frames: PhantomData<fn(From) -> To>,
}

impl<To, From> Clone for Transform<To, From> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<To, From> Copy for Transform<To, From> {}

impl<To, From> PartialEq for Transform<To, From> {
    fn eq(&self, other: &Self) -> bool {
        self.iso == other.iso
    }
}

impl<To: Frame, From: Frame> std::fmt::Debug for Transform<To, From> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}_from_{} {:?} {:?}", To::NAME, From::NAME, self.translation_m(), self.rotation_vector_rad())
    }
}

impl<To, From> Transform<To, From> {
    /// Declares which frames a raw isometry relates. The one place where frames can be got wrong:
    /// keep it at the edges (drivers, OpenCV, files) and say why it is right.
    pub fn assume_frames(iso: Isometry3<f64>) -> Self {
        let iso = Isometry3::from_parts(iso.translation, rotation::canonical(iso.rotation));
        Self { iso, frames: PhantomData }
    }

    /// No displacement and no rotation.
    pub fn identity() -> Self {
        Self::assume_frames(Isometry3::identity())
    }

    /// From a translation in metres and a rotation.
    pub fn from_parts(translation_m: [f64; 3], rotation: UnitQuaternion<f64>) -> Self {
        Self::assume_frames(Isometry3::from_parts(Translation3::from(Vector3::from(translation_m)), rotation))
    }

    /// From x, y, z in metres and an axis-angle vector in radians: the pose of a UR controller.
    pub fn from_pose_vector(pose: [f64; 6]) -> Self {
        let [x, y, z, rx, ry, rz] = pose;
        Self::from_parts([x, y, z], rotation::from_vector([rx, ry, rz]))
    }

    /// From a rotation matrix and a translation in metres; `None` where the matrix is no rotation.
    pub fn from_matrix(rotation_matrix: &Matrix3<f64>, translation_m: Vector3<f64>) -> Option<Self> {
        let rotation = rotation::from_matrix(rotation_matrix)?;
        Some(Self::from_parts(translation_m.into(), rotation))
    }

    /// x, y, z in metres and the axis-angle vector in radians.
    pub fn pose_vector(&self) -> [f64; 6] {
        let (t, r) = (self.translation_m(), self.rotation_vector_rad());
        [t[0], t[1], t[2], r[0], r[1], r[2]]
    }

    /// Swaps the frames.
    pub fn inverse(self) -> Transform<From, To> {
        Transform::assume_frames(self.iso.inverse())
    }

    /// The untyped isometry, for handing to a library.
    pub fn iso(&self) -> &Isometry3<f64> {
        &self.iso
    }

    /// Position of the origin of `From` in `To`, metres.
    pub fn translation_m(&self) -> [f64; 3] {
        self.iso.translation.vector.into()
    }

    /// The rotation, w >= 0.
    pub fn rotation(&self) -> UnitQuaternion<f64> {
        self.iso.rotation
    }

    /// The rotation as a matrix.
    pub fn rotation_matrix(&self) -> Matrix3<f64> {
        *self.iso.rotation.to_rotation_matrix().matrix()
    }

    /// The rotation as an axis-angle vector in radians, length 0 to pi.
    pub fn rotation_vector_rad(&self) -> [f64; 3] {
        rotation::to_vector(&self.iso.rotation).into()
    }

    /// Angle of the rotation in radians, 0 to pi.
    pub fn rotation_angle_rad(&self) -> f64 {
        rotation::to_vector(&self.iso.rotation).norm()
    }

    /// Angle between the rotations of two transforms in radians.
    pub fn angle_to_rad(&self, other: &Self) -> f64 {
        rotation::angle_between_rad(&self.iso.rotation, &other.iso.rotation)
    }

    /// Distance between the origins of two transforms in metres.
    pub fn distance_to_m(&self, other: &Self) -> f64 {
        (self.iso.translation.vector - other.iso.translation.vector).norm()
    }

    /// Point at `fraction` of the way to `other`: straight in translation, on the group in rotation.
    pub fn interpolate(&self, other: &Self, fraction: f64) -> Self {
        let translation = self.iso.translation.vector.lerp(&other.iso.translation.vector, fraction);
        Self::from_parts(translation.into(), rotation::interpolate(&self.iso.rotation, &other.iso.rotation, fraction))
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        self.pose_vector().iter().all(|v| v.is_finite())
    }
}

impl<A, B, C> Mul<Transform<B, C>> for Transform<A, B> {
    type Output = Transform<A, C>;
    fn mul(self, rhs: Transform<B, C>) -> Transform<A, C> {
        Transform::assume_frames(self.iso * rhs.iso)
    }
}

/// A position with its coordinates in frame `F`. Metres.
pub struct Point<F> {
    xyz: Point3<f64>,
    frame: PhantomData<fn() -> F>,
}

impl<F> Clone for Point<F> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<F> Copy for Point<F> {}

impl<F: Frame> std::fmt::Debug for Point<F> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "in {} {:?}", F::NAME, self.xyz_m())
    }
}

impl<F> Point<F> {
    /// The frame's own origin.
    pub fn origin() -> Self {
        Self::assume_frame([0.0; 3])
    }

    /// Declares which frame raw coordinates are in; same care as [`Transform::assume_frames`].
    pub fn assume_frame(xyz_m: [f64; 3]) -> Self {
        Self { xyz: Point3::from(xyz_m), frame: PhantomData }
    }

    /// Coordinates in metres.
    pub fn xyz_m(&self) -> [f64; 3] {
        self.xyz.coords.into()
    }

    /// Coordinates as a vector, in metres.
    pub fn coords_m(&self) -> Vector3<f64> {
        self.xyz.coords
    }

    /// Straight-line distance to `other`, in metres.
    pub fn distance_m(self, other: Self) -> f64 {
        nalgebra::distance(&self.xyz, &other.xyz)
    }
}

impl<A, B> Mul<Point<B>> for Transform<A, B> {
    type Output = Point<A>;
    fn mul(self, point_in_b: Point<B>) -> Point<A> {
        Point::assume_frame((self.iso * point_in_b.xyz).coords.into())
    }
}

#[derive(Serialize, Deserialize)]
struct Stored {
    to: String,
    from: String,
    translation_m: [f64; 3],
    quaternion_xyzw: [f64; 4],
}

impl<To: Frame, From: Frame> Serialize for Transform<To, From> {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        let q = self.iso.rotation.coords;
        Stored {
            to: To::NAME.into(),
            from: From::NAME.into(),
            translation_m: self.translation_m(),
            quaternion_xyzw: [q.x, q.y, q.z, q.w],
        }
        .serialize(s)
    }
}

impl<'de, To: Frame, From: Frame> Deserialize<'de> for Transform<To, From> {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        let stored = Stored::deserialize(d)?;
        if (stored.to.as_str(), stored.from.as_str()) != (To::NAME, From::NAME) {
            let (to, from) = (To::NAME, From::NAME);
            return Err(D::Error::custom(format!(
                "expected {to}_from_{from}, found {}_from_{}",
                stored.to, stored.from
            )));
        }
        let [x, y, z, w] = stored.quaternion_xyzw;
        let q = Quaternion::new(w, x, y, z);
        let unit = (q.norm() - 1.0).abs() <= 1e-6;
        if !unit {
            return Err(D::Error::custom(format!("quaternion_xyzw has length {}, not 1", q.norm())));
        }
        // Not renormalised: what was written comes back to the last bit.
        Ok(Self::from_parts(stored.translation_m, UnitQuaternion::new_unchecked(q)))
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Base, Event};
    use super::*;
    use std::f64::consts::PI;

    fn awkward() -> Vec<Transform<Base, Event>> {
        [
            [0.0; 6],
            [1e-9, 0.0, 0.0, 0.0, 1e-9, 0.0],
            [0.1258, -0.5678, 0.3839, PI, 0.0, 0.0],
            [1e3, -2.0, 0.0, 0.3, -0.2, PI - 1e-7],
        ]
        .map(Transform::from_pose_vector)
        .into()
    }

    #[test]
    fn inverse_undoes_transform() {
        for base_from_event in awkward() {
            let there_and_back = base_from_event.inverse() * base_from_event;
            assert!(there_and_back.distance_to_m(&Transform::identity()) < 1e-9, "{base_from_event:?}");
            assert!(there_and_back.rotation_angle_rad() < 1e-12, "{base_from_event:?}");
        }
    }

    #[test]
    fn a_file_with_swapped_frames_is_refused() {
        let stored = serde_json::to_string(&Transform::<Event, Base>::identity()).unwrap();
        let error = serde_json::from_str::<Transform<Base, Event>>(&stored).unwrap_err();
        assert!(error.to_string().starts_with("expected base_from_event, found event_from_base"), "{error}");
    }

    #[test]
    fn what_is_written_is_read_back_exactly() {
        for base_from_event in awkward() {
            let text = serde_json::to_string(&base_from_event).unwrap();
            let again: Transform<Base, Event> = serde_json::from_str(&text).unwrap();
            assert_eq!(again, base_from_event, "{text}");
        }
    }
}
