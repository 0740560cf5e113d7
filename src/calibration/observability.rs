//! Whether a set of robot poses can tell where the camera is, before moving and before solving.
//!
//! Hand-eye needs rotations about at least two axes that differ clearly. Solvers answer a set without
//! them with finite nonsense (15 cm to 27 m of error, no warning), so it is refused here. Uses
//! `geometry`. Start at [`carried_target`].

use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::geometry::{Base, Frame, Tcp, Transform, rotation};

/// Smallest second eigenvalue of the rotation-axis scatter that is solved; healthy sets have 0.137 to 0.41.
pub const MIN_SECOND_EIGENVALUE: f64 = 0.02;
/// Largest condition of the stacked `[R - I]` that is solved; healthy sets have 1.3 to 2.6.
pub const MAX_CONDITION: f64 = 20.0;
/// Smallest largest relative rotation that is solved, radians (5 deg).
pub const MIN_ROTATION_RAD: f64 = 5.0 * std::f64::consts::PI / 180.0;
/// Fewest poses of a hand-eye solve.
pub const MIN_POSES: usize = 3;
/// Stands for a condition without bound, so that every reported number is finite.
const CONDITION_CAP: f64 = 1e9;

/// How well the rotations between the poses, all pairs, span space.
///
/// With relative rotations of angle `theta` about unit axes `n`, the scatter is the sum of
/// `sin^2(theta/2) n n^T` over all pairs, divided by its trace. The weights make small rotations, whose
/// axes are noise, count little, and need no care at 180 deg.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Observability {
    /// Number of poses.
    pub poses: usize,
    /// Eigenvalues of the scatter, largest first; their sum is 1.
    pub axis_scatter: [f64; 3],
    /// The second of them: 0 where all axes are parallel, at most 0.5.
    pub second_eigenvalue: f64,
    /// Ratio of the largest to the smallest singular value of `[R - I]` stacked over all pairs, the
    /// matrix that the translation is solved with; at least 1, capped at 1e9.
    pub condition: f64,
    /// Largest relative rotation, radians.
    pub largest_rotation_rad: f64,
    /// The axis that most rotations are about, unit length, in `axes_frame`.
    pub main_axis: [f64; 3],
    /// The axis to turn about for a larger second eigenvalue, unit length, in `axes_frame`.
    pub second_axis: [f64; 3],
    /// The frame of the axes: `base` where the target is carried, `tcp` where the cameras are.
    pub axes_frame: String,
}

/// Why a set of poses cannot be solved.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ObservabilityError {
    /// Too few poses.
    #[error(
        "{found} poses are too few for hand-eye: add poses until there are at least {MIN_POSES}, better 10 or more"
    )]
    TooFew {
        /// Usable poses.
        found: usize,
    },
    /// A pose is NaN or infinite.
    #[error("pose {pose} of the set is not finite: drop it or repair its source")]
    NotFinite {
        /// Index in the set, from 0.
        pose: usize,
    },
    /// The poses hardly rotate.
    #[error(
        "the {poses} poses turn by at most {found_deg:.2} deg against each other, {allowed_deg:.0} deg are needed: \
         add poses that tilt the tool by 20 deg or more about two different axes"
    )]
    SmallRotation {
        /// Number of poses.
        poses: usize,
        /// Largest relative rotation, degrees.
        found_deg: f64,
        /// Smallest allowed, degrees.
        allowed_deg: f64,
    },
    /// The axes are nearly parallel.
    #[error(
        "the {poses} poses turn nearly all about one axis, {main} of {frame}: second eigenvalue {second_eigenvalue:.4} \
         (at least {MIN_SECOND_EIGENVALUE}), condition {condition:.1} (at most {MAX_CONDITION}); add at least two poses \
         that turn the tool by 20 deg or more about {second} of {frame}, one each way"
    )]
    ParallelAxes {
        /// Number of poses.
        poses: usize,
        /// Second eigenvalue of the axis scatter.
        second_eigenvalue: f64,
        /// Condition of the stacked `[R - I]`.
        condition: f64,
        /// The axis of nearly all rotations.
        main: Axis,
        /// The axis that is missing.
        second: Axis,
        /// The frame of both axes.
        frame: String,
    },
}

/// A direction, written with two decimals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axis(pub [f64; 3]);

impl std::fmt::Display for Axis {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // Adding 0 turns the -0 of rounding into 0.
        let [x, y, z] = self.0.map(|v| (v * 100.0).round() / 100.0 + 0.0);
        write!(f, "({x:.2}, {y:.2}, {z:.2})")
    }
}

/// Measures the poses of a robot that carries the target before static cameras; axes in `base`.
pub fn carried_target(poses: &[Transform<Base, Tcp>]) -> Result<Observability, ObservabilityError> {
    let tcp_from_base: Vec<_> = poses.iter().map(|p| p.inverse()).collect();
    measure(&tcp_from_base, Base::NAME)
}

/// Measures the poses of a robot that carries the cameras before a static target; axes in `tcp`.
pub fn carried_cameras(poses: &[Transform<Base, Tcp>]) -> Result<Observability, ObservabilityError> {
    measure(poses, Tcp::NAME)
}

/// The relative rotations are `R_j^-1 R_i`, so the axes are in the frame `From`.
fn measure<To, From>(poses: &[Transform<To, From>], frame: &str) -> Result<Observability, ObservabilityError> {
    if poses.len() < MIN_POSES {
        return Err(ObservabilityError::TooFew { found: poses.len() });
    }
    if let Some(pose) = poses.iter().position(|p| !p.is_finite()) {
        return Err(ObservabilityError::NotFinite { pose });
    }
    let rotations: Vec<_> = poses.iter().map(Transform::rotation).collect();
    let (scatter, largest_rotation_rad) = axis_scatter(&rotations);
    let weight = scatter.trace();
    let eigen = (scatter / if weight > 0.0 { weight } else { 1.0 }).symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| eigen.eigenvalues[j].total_cmp(&eigen.eigenvalues[i]));
    let axis_scatter = order.map(|i| eigen.eigenvalues[i].max(0.0));
    let axis = |i: usize| outward(eigen.eigenvectors.column(order[i]).into_owned());
    Ok(Observability {
        poses: poses.len(),
        axis_scatter,
        second_eigenvalue: axis_scatter[1],
        condition: condition(&axis_scatter),
        largest_rotation_rad,
        main_axis: axis(0).into(),
        second_axis: axis(1).into(),
        axes_frame: frame.to_owned(),
    })
}

/// Sum of `sin^2(theta/2) n n^T` over all pairs, and the largest angle in radians.
fn axis_scatter(rotations: &[UnitQuaternion<f64>]) -> (Matrix3<f64>, f64) {
    let (mut scatter, mut largest_rad) = (Matrix3::zeros(), 0.0_f64);
    for (j, later) in rotations.iter().enumerate() {
        for earlier in &rotations[..j] {
            let relative = later.inverse() * earlier;
            let axis = relative.imag();
            scatter += axis * axis.transpose();
            largest_rad = largest_rad.max(rotation::to_vector(&relative).norm());
        }
    }
    (scatter, largest_rad)
}

/// `[R - I]^T [R - I] = 4 sin^2(theta/2) (I - n n^T)`, so the condition follows from the scatter:
/// the square root of `(1 - smallest) / (1 - largest)` of its eigenvalues, whose sum is 1.
fn condition(axis_scatter: &[f64; 3]) -> f64 {
    let [largest, second, smallest] = axis_scatter;
    ((largest + second) / (second + smallest)).sqrt().min(CONDITION_CAP)
}

/// Of the two directions of an axis, the one whose largest component is positive.
fn outward(axis: Vector3<f64>) -> Vector3<f64> {
    if axis[axis.iamax()] < 0.0 { -axis } else { axis }
}

impl Observability {
    /// Refuses a set that no solver can answer, and says which poses to add.
    pub fn check(&self) -> Result<(), ObservabilityError> {
        let &Self { poses, second_eigenvalue, condition, largest_rotation_rad, .. } = self;
        let rotates = largest_rotation_rad >= MIN_ROTATION_RAD;
        if !rotates {
            let (found_deg, allowed_deg) = (largest_rotation_rad.to_degrees(), MIN_ROTATION_RAD.to_degrees());
            return Err(ObservabilityError::SmallRotation { poses, found_deg, allowed_deg });
        }
        let spans = second_eigenvalue >= MIN_SECOND_EIGENVALUE && condition <= MAX_CONDITION;
        if !spans {
            return Err(ObservabilityError::ParallelAxes {
                poses,
                second_eigenvalue,
                condition,
                main: Axis(self.main_axis),
                second: Axis(self.second_axis),
                frame: self.axes_frame.clone(),
            });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn poses(vectors: &[[f64; 3]]) -> Vec<Transform<Base, Tcp>> {
        vectors.iter().map(|v| Transform::from_parts([0.4, -0.1, 0.3], rotation::from_vector(*v))).collect()
    }

    /// Tool down, rolled about the vertical, with errors of the order of a thousandth of a radian.
    fn rolls_only() -> Vec<Transform<Base, Tcp>> {
        let down = Transform::<Base, Tcp>::from_parts([0.4, -0.1, 0.3], rotation::from_vector([3.1, 0.0, 0.0]));
        let roll = |k: i32| {
            let k = f64::from(k);
            let wobble = 1e-3 * (7.0 * k).sin();
            down * Transform::<Tcp, Tcp>::from_parts([0.0; 3], rotation::from_vector([wobble, -wobble, 0.3 * k]))
        };
        (-5..=5).map(roll).collect()
    }

    #[test]
    fn rotations_about_three_axes_are_healthy() {
        let set = poses(&[[0.0; 3], [0.5, 0.0, 0.0], [-0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 0.5]]);
        for found in [carried_target(&set).unwrap(), carried_cameras(&set).unwrap()] {
            assert!(found.second_eigenvalue > 0.137 && found.condition < 2.6, "{found:?}");
            assert!((found.axis_scatter.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            assert!((found.largest_rotation_rad - 1.0).abs() < 1e-12);
            found.check().unwrap();
        }
    }

    #[test]
    fn the_condition_is_that_of_the_stacked_matrix() {
        let set = poses(&[[0.1, 0.2, 0.3], [0.9, -0.3, 0.1], [3.1, 0.1, -0.2], [0.0, 1.0, 0.4]]);
        let mut stacked = Vec::new();
        for (j, later) in set.iter().enumerate() {
            for earlier in &set[..j] {
                let r = (later.inverse() * *earlier).rotation_matrix() - Matrix3::identity();
                stacked.extend(r.row_iter().map(|row| row.into_owned()));
            }
        }
        let singular = nalgebra::OMatrix::<f64, nalgebra::Dyn, nalgebra::U3>::from_rows(&stacked).singular_values();
        let found = carried_cameras(&set).unwrap();
        assert!((found.condition - singular.max() / singular.min()).abs() < 1e-9, "{found:?} {singular}");
    }

    #[test]
    fn parallel_axes_are_refused_with_the_axis_to_add() {
        for found in [carried_target(&rolls_only()).unwrap(), carried_cameras(&rolls_only()).unwrap()] {
            let error = found.check().unwrap_err();
            assert!(matches!(error, ObservabilityError::ParallelAxes { .. }), "{error}");
            assert!(found.second_eigenvalue < 0.0026 && found.condition > 100.0, "{found:?}");
            let text = error.to_string();
            assert!(
                text.contains("turn nearly all about one axis") && text.contains("add at least two poses"),
                "{text}"
            );
            let across = nalgebra::Vector3::from(found.second_axis).dot(&nalgebra::Vector3::from(found.main_axis));
            assert!(across.abs() < 1e-9 && found.main_axis[2].abs() > 0.99, "{found:?}");
        }
        // Exactly parallel: the numbers stay finite.
        let exact = carried_target(&poses(&[[0.0; 3], [0.0, 0.0, 0.5], [0.0, 0.0, 1.0]])).unwrap();
        assert!(exact.condition.is_finite() && exact.check().is_err(), "{exact:?}");
    }

    #[test]
    fn poses_that_hardly_rotate_are_refused() {
        let set = poses(&[[0.0; 3], [0.05, 0.0, 0.0], [0.0, 0.05, 0.0]]);
        let error = carried_target(&set).unwrap().check().unwrap_err();
        assert!(matches!(error, ObservabilityError::SmallRotation { .. }), "{error}");
        let still = carried_target(&poses(&[[0.3; 3]; 4])).unwrap();
        assert!(matches!(still.check(), Err(ObservabilityError::SmallRotation { .. })), "{still:?}");
    }

    #[test]
    fn nan_and_too_few_are_refused() {
        let set = poses(&[[0.0; 3], [f64::NAN, 0.0, 0.0], [0.0, 0.5, 0.0]]);
        assert_eq!(carried_target(&set), Err(ObservabilityError::NotFinite { pose: 1 }));
        assert_eq!(carried_target(&set[..2]), Err(ObservabilityError::TooFew { found: 2 }));
        let healthy = poses(&[[0.0; 3], [0.5, 0.0, 0.0], [0.0, 0.5, 0.0]]);
        let mut spoilt = carried_target(&healthy).unwrap();
        spoilt.check().unwrap();
        spoilt.condition = f64::NAN;
        assert!(spoilt.check().is_err());
    }

    #[test]
    fn the_poses_of_a_real_session_are_healthy() {
        let Ok(data) = std::env::var("CELLCAL_DATA") else {
            eprintln!("CELLCAL_DATA is not set: the real pose set is not read");
            return;
        };
        let folder = std::path::Path::new(&data).join("rct_charuco_static_camera/poses");
        let set: Vec<_> = (0..16).map(|i| real_pose(&folder.join(format!("{i}.yaml")))).collect();
        for found in [carried_target(&set).unwrap(), carried_cameras(&set).unwrap()] {
            eprintln!("{found:?}");
            assert!((0.137..=0.5).contains(&found.second_eigenvalue), "{found:?}");
            assert!((1.0..=2.6).contains(&found.condition), "{found:?}");
            found.check().unwrap();
        }
    }

    /// A pose file: `x: 1.0` and so on for x, y, z (m), qx, qy, qz, qw.
    fn real_pose(path: &std::path::Path) -> Transform<Base, Tcp> {
        let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let value = |key: &str| -> f64 {
            let line = text.lines().find_map(|l| l.split_once(": ").filter(|(k, _)| k.trim() == key));
            line.unwrap_or_else(|| panic!("no {key} in {}", path.display())).1.trim().parse().unwrap()
        };
        let q = nalgebra::Quaternion::new(value("qw"), value("qx"), value("qy"), value("qz"));
        Transform::from_parts(["x", "y", "z"].map(value), UnitQuaternion::from_quaternion(q))
    }
}
