//! The core that all solvers share: relative motions `A X = X B` of all pairs of poses.
//!
//! Two measures keep every solver right near 0 and near 180 deg, whatever `X` is:
//! - The camera frame is first turned by a rough rotation that needs no sign of any quaternion (the
//!   linear form of Andreff), so that the unknown left is near the identity, where the parameters of
//!   Tsai and Daniilidis are regular; as published, both are singular for half turns.
//! - After that turn the rotations of A and B are nearly equal, so the sign of the quaternion of B is
//!   the one nearer to that of A. Near 180 deg `w >= 0` alone picks by noise (OpenCV issue 24871).

use nalgebra::{Isometry3, Matrix3, Matrix4, Quaternion, Translation3, UnitQuaternion, Vector3};

use super::{HandEyeError, HandEyeMethod, andreff, breakdown};
use crate::geometry::rotation;

/// One relative motion, seen by the robot (`a`) and by the camera (`b`).
pub(super) struct Motion {
    /// Motion in the frame of the robot side, w >= 0.
    pub(super) a: Isometry3<f64>,
    /// Motion in the turned camera frame, its quaternion on the side of that of `a`.
    pub(super) b: Isometry3<f64>,
}

/// The motions between all pairs of poses, i < j, in the turned camera frame.
pub(super) struct Motions {
    /// The motions.
    pub(super) list: Vec<Motion>,
    /// The turn of the camera frame: the answer is the solvers' transform times this.
    pub(super) prior: UnitQuaternion<f64>,
}

impl Motions {
    /// From loops `(A_i, B_i)` for which `A_i X B_i` is the same for all i.
    pub(super) fn of(method: HandEyeMethod, loops: &[(Isometry3<f64>, Isometry3<f64>)]) -> Result<Self, HandEyeError> {
        let mut list = Vec::new();
        for (j, later) in loops.iter().enumerate() {
            for earlier in &loops[..j] {
                list.push(Motion { a: later.0.inverse() * earlier.0, b: later.1 * earlier.1.inverse() });
            }
        }
        let rough = andreff::linear(&list).ok_or(breakdown(method, loops.len()))?;
        let allowed = andreff::MIN_UNIQUENESS;
        let unique = rough.uniqueness >= allowed;
        if !unique {
            return Err(HandEyeError::Ambiguous { pairs: loops.len(), found: rough.uniqueness, allowed });
        }
        let prior = rough.rotation;
        for motion in &mut list {
            motion.a.rotation = rotation::canonical(motion.a.rotation);
            let b = prior * motion.b * prior.inverse();
            let same_side = motion.a.rotation.coords.dot(&b.rotation.coords) >= 0.0;
            let q = if same_side { b.rotation } else { negated(b.rotation) };
            motion.b = Isometry3::from_parts(b.translation, q);
        }
        Ok(Self { list, prior })
    }

    /// Adds the translation to a rotation: least squares of `(R_A - I) t = R t_B - t_A` over all motions.
    pub(super) fn with_translation(&self, rotation: Option<UnitQuaternion<f64>>) -> Option<Isometry3<f64>> {
        let rotation = rotation?;
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for Motion { a, b } in &self.list {
            let turn = a.rotation.to_rotation_matrix().matrix() - Matrix3::identity();
            normal += turn.transpose() * turn;
            right += turn.transpose() * (rotation * b.translation.vector - a.translation.vector);
        }
        let translation = normal.cholesky()?.solve(&right);
        Some(Isometry3::from_parts(Translation3::from(translation), rotation))
    }
}

/// The same rotation on the other side of the quaternion sphere.
fn negated(q: UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::from(-q.coords))
}

/// Mean of transforms: arithmetic in translation, chordal in rotation (Markley 2007); `None` without any.
pub(super) fn mean<'a>(transforms: impl Iterator<Item = &'a Isometry3<f64>>) -> Option<Isometry3<f64>> {
    let (mut count, mut translation, mut outer) = (0.0, Vector3::zeros(), Matrix4::zeros());
    for iso in transforms {
        count += 1.0;
        translation += iso.translation.vector;
        outer += iso.rotation.coords * iso.rotation.coords.transpose();
    }
    let coords = -smallest(-outer)?.1;
    let q = rotation::canonical(UnitQuaternion::try_new(Quaternion::from(coords), 1e-9)?);
    Some(Isometry3::from_parts(Translation3::from(translation / count), q))
}

/// Smallest eigenvalue of a symmetric 4 x 4 matrix and its unit vector; `None` if not finite.
pub(super) fn smallest(matrix: Matrix4<f64>) -> Option<(f64, nalgebra::Vector4<f64>)> {
    if !matrix.iter().all(|v| v.is_finite()) {
        return None;
    }
    let eigen = matrix.try_symmetric_eigen(f64::EPSILON, 1000)?;
    let i = eigen.eigenvalues.imin();
    Some((eigen.eigenvalues[i], eigen.eigenvectors.column(i).into_owned()))
}
