//! How well the models of the arm explain the poses that its controller reports.
//!
//! The controller's own pose is primary, forward kinematics is the check: of the parameters that the controller
//! reports (which should agree to rounding) and of the URDF (which, where nominal, is millimetres off: users report
//! 3 to 5 mm, the maker says up to centimetres). Uses `geometry` only. Start at [`compare`].

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use crate::geometry::{
    Base, Flange, Tcp, Transform,
    kinematics::{Arm, Dh, Joints},
    rotation,
};

/// Where the joints were at a pose, and where the controller said that the TCP was.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseKinematics {
    /// Index of the pose in the session.
    pub pose: usize,
    /// Measured joint positions, rad.
    pub joints_rad: Joints,
    /// The controller's pose of the active TCP at the same instant.
    pub base_from_tcp: Transform<Base, Tcp>,
}

/// The models of the arm beside the controller's poses.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct KinematicsResult {
    /// Forward kinematics of the parameters that the controller reports.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub controller_dh: Option<ModelMismatch>,
    /// Forward kinematics of the URDF that the session was planned with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub urdf: Option<ModelMismatch>,
    /// The part of the mismatch of the URDF that is the same at all poses.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub urdf_from_controller: Option<ConstantPart>,
    /// Why a section is absent, by its name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub not_computed: BTreeMap<String, String>,
}

/// Distance of the flange by one model from the flange by the controller.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelMismatch {
    /// Mean distance, m.
    pub mean_m: f64,
    /// Largest distance, m.
    pub max_m: f64,
    /// Mean angle, rad.
    pub mean_rad: f64,
    /// Largest angle, rad.
    pub max_rad: f64,
    /// Index in the session of the pose with the largest distance.
    pub worst_pose: usize,
    /// Each pose.
    pub per_pose: Vec<PoseMismatch>,
}

/// The same at one pose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PoseMismatch {
    /// Index of the pose in the session.
    pub pose: usize,
    /// Distance, m.
    pub position_m: f64,
    /// Angle, rad.
    pub angle_rad: f64,
}

/// A rigid motion that takes the controller's flange positions to those of the URDF as well as one motion can.
///
/// Where little is left, base or joint zero of the URDF are placed differently; where much is left, the arm is an
/// individual that the URDF does not describe.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ConstantPart {
    /// The motion: from `base` of the controller to `base` of the URDF. Its rotation is as good as the poses are wide.
    pub transform: Transform<Base, Base>,
    /// Mean distance that is left, m.
    pub rest_mean_m: f64,
    /// Largest distance that is left, m.
    pub rest_max_m: f64,
}

/// Compares what the controller said with what its parameters, if known, and the URDF say.
///
/// A pose that holds a number that is not finite is not left out: what it makes impossible is absent, with the
/// reason in `not_computed`.
pub fn compare(
    poses: &[PoseKinematics],
    flange_from_tcp: Transform<Flange, Tcp>,
    controller: Option<&Dh>,
    urdf: &Arm,
) -> KinematicsResult {
    let tcp_from_flange = flange_from_tcp.inverse();
    let reported: Vec<_> = poses.iter().map(|pose| pose.base_from_tcp * tcp_from_flange).collect();
    let by_urdf: Vec<_> = poses.iter().map(|pose| urdf.forward(&pose.joints_rad)).collect();
    let mut result = KinematicsResult::default();
    if let Some(dh) = controller {
        let by_dh: Vec<_> = poses.iter().map(|pose| dh.forward(&pose.joints_rad)).collect();
        result.controller_dh = result.noted("controller_dh", mismatch(poses, &reported, &by_dh));
    }
    result.urdf = result.noted("urdf", mismatch(poses, &reported, &by_urdf));
    if result.urdf.is_some() {
        result.urdf_from_controller = result.noted("urdf_from_controller", constant_part(&reported, &by_urdf));
    }
    result
}

impl KinematicsResult {
    /// The largest distance of any model, m.
    pub fn max_m(&self) -> Option<f64> {
        self.models().map(|m| m.max_m).reduce(f64::max)
    }

    /// The largest angle of any model, rad.
    pub fn max_rad(&self) -> Option<f64> {
        self.models().map(|m| m.max_rad).reduce(f64::max)
    }

    fn models(&self) -> impl Iterator<Item = &ModelMismatch> {
        self.controller_dh.iter().chain(&self.urdf)
    }

    fn noted<T>(&mut self, section: &str, found: Result<T, String>) -> Option<T> {
        found.map_err(|why| self.not_computed.insert(section.into(), why)).ok()
    }
}

fn mismatch(
    poses: &[PoseKinematics],
    reported: &[Transform<Base, Flange>],
    modelled: &[Transform<Base, Flange>],
) -> Result<ModelMismatch, String> {
    let pairs = poses.iter().zip(reported.iter().zip(modelled));
    let of = pairs.map(|(pose, (a, b))| PoseMismatch {
        pose: pose.pose,
        position_m: a.distance_to_m(b),
        angle_rad: a.angle_to_rad(b),
    });
    let per_pose: Vec<_> = of.collect();
    let is_number = |p: &&PoseMismatch| p.position_m.is_finite() && p.angle_rad.is_finite();
    if let Some(bad) = per_pose.iter().find(|p| !is_number(p)) {
        return Err(format!("at pose number {} a joint position, the pose or the model is not a number", bad.pose + 1));
    }
    let worst = per_pose.iter().max_by(|a, b| a.position_m.total_cmp(&b.position_m)).ok_or("there are no poses")?;
    let mean = |of: fn(&PoseMismatch) -> f64| per_pose.iter().map(of).sum::<f64>() / per_pose.len() as f64;
    Ok(ModelMismatch {
        mean_m: mean(|p| p.position_m),
        max_m: worst.position_m,
        mean_rad: mean(|p| p.angle_rad),
        max_rad: per_pose.iter().map(|p| p.angle_rad).fold(0.0, f64::max),
        worst_pose: worst.pose,
        per_pose,
    })
}

/// Flange positions must spread at least this far in two directions for their rotation to be known, m (rms).
const SMALLEST_SPREAD_M: f64 = 0.005;

/// Kabsch (1976): the rotation nearest to the sum of outer products of the centred positions.
fn constant_part(
    reported: &[Transform<Base, Flange>],
    modelled: &[Transform<Base, Flange>],
) -> Result<ConstantPart, String> {
    let positions = |all: &[Transform<Base, Flange>]| all.iter().map(|t| t.iso().translation.vector).collect();
    let (from, to): (Vec<Vector3<f64>>, Vec<Vector3<f64>>) = (positions(reported), positions(modelled));
    let count = from.len() as f64;
    let mean = |all: &[Vector3<f64>]| all.iter().sum::<Vector3<f64>>() / count;
    let (from_centre, to_centre) = (mean(&from), mean(&to));
    let pairs = || from.iter().zip(&to);
    let outer: Matrix3<f64> = pairs().map(|(a, b)| (b - to_centre) * (a - from_centre).transpose()).sum();
    let mut spread_m: Vec<f64> = outer.singular_values().iter().map(|s| (s / count).sqrt()).collect();
    spread_m.sort_by(|a, b| b.total_cmp(a));
    let wide = spread_m[1] >= SMALLEST_SPREAD_M;
    let turn = rotation::from_matrix(&outer).filter(|_| wide).ok_or_else(|| {
        format!("the flange positions lie on a line: they spread {:.1} mm across it", spread_m[1] * 1e3)
    })?;
    let rest_m: Vec<f64> = pairs().map(|(a, b)| (turn * (a - from_centre) - (b - to_centre)).norm()).collect();
    Ok(ConstantPart {
        transform: Transform::from_parts((to_centre - turn * from_centre).into(), turn),
        rest_mean_m: rest_m.iter().sum::<f64>() / count,
        rest_max_m: rest_m.iter().copied().fold(0.0, f64::max),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::kinematics::tests::some_joints;

    const OFFSET: [f64; 6] = [0.01, -0.02, 0.04, 0.2, 0.0, 0.1];

    fn tcp() -> Transform<Flange, Tcp> {
        Transform::from_pose_vector(OFFSET)
    }

    /// What a controller with these parameters says at poses of a real session.
    fn said_by(dh: &Dh, count: usize) -> Vec<PoseKinematics> {
        let around = |q: Joints| {
            let centre = [1.6, -1.1, 2.2, -1.15, 1.6, 0.0];
            std::array::from_fn(|i| centre[i] + 0.15 * q[i])
        };
        let at =
            |(pose, joints_rad)| PoseKinematics { pose, joints_rad, base_from_tcp: dh.forward(&joints_rad) * tcp() };
        some_joints(count).into_iter().map(around).enumerate().map(at).collect()
    }

    #[test]
    fn an_individual_arm_is_told_from_its_nominal_model() {
        let individual = Dh::individual();
        let poses = said_by(&individual, 40);
        let result = compare(&poses, tcp(), Some(&individual), &Arm::ur5e());
        let own = result.controller_dh.unwrap();
        assert!(own.max_m < 1e-9 && own.max_rad < 1e-9, "{own:?}");
        let urdf = result.urdf.unwrap();
        assert!((1e-4..5e-3).contains(&urdf.mean_m) && urdf.mean_m < urdf.max_m, "{urdf:?}");
        assert_eq!(urdf.per_pose.len(), 40);
        let worst = urdf.per_pose[urdf.worst_pose];
        assert_eq!((worst.pose, worst.position_m), (urdf.worst_pose, urdf.max_m));
        // By hand, at one pose.
        let known = individual.forward(&poses[7].joints_rad);
        let nominal = Dh::UR5E.forward(&poses[7].joints_rad);
        assert!((urdf.per_pose[7].position_m - known.distance_to_m(&nominal)).abs() < 1e-9);
        assert!((urdf.per_pose[7].angle_rad - known.angle_to_rad(&nominal)).abs() < 1e-9);
        let constant = result.urdf_from_controller.unwrap();
        assert!(constant.rest_mean_m > 1e-4 && constant.rest_mean_m < urdf.mean_m, "{constant:?}");
        assert!(result.not_computed.is_empty());
    }

    #[test]
    fn a_base_that_is_placed_differently_is_found() {
        let urdf_from_controller: Transform<Base, Base> =
            Transform::from_pose_vector([0.003, -0.002, 0.11, 0.0, 0.0, 3.0]);
        let mut poses = said_by(&Dh::UR5E, 30);
        for pose in &mut poses {
            pose.base_from_tcp = urdf_from_controller.inverse() * pose.base_from_tcp;
        }
        let result = compare(&poses, tcp(), None, &Arm::ur5e());
        assert!(result.controller_dh.is_none() && result.urdf.unwrap().mean_m > 0.1);
        let constant = result.urdf_from_controller.unwrap();
        assert!(constant.rest_max_m < 1e-9, "{constant:?}");
        assert!(constant.transform.distance_to_m(&urdf_from_controller) < 1e-9, "{constant:?}");
        assert!(constant.transform.angle_to_rad(&urdf_from_controller) < 1e-9, "{constant:?}");
    }

    #[test]
    fn a_number_that_is_none_is_named() {
        let mut poses = said_by(&Dh::UR5E, 10);
        poses[4].joints_rad[2] = f64::NAN;
        let result = compare(&poses, tcp(), Some(&Dh::UR5E), &Arm::ur5e());
        let why = "at pose number 5 a joint position, the pose or the model is not a number";
        assert_eq!((result.controller_dh, result.urdf, result.urdf_from_controller), (None, None, None));
        assert_eq!(result.not_computed["urdf"], why);
        assert_eq!(result.not_computed["controller_dh"], why);
        let mut poses = said_by(&Dh::UR5E, 10);
        poses[0].base_from_tcp = Transform::from_pose_vector([0.1, f64::NAN, 0.0, 0.0, 0.0, 0.0]);
        assert!(compare(&poses, tcp(), None, &Arm::ur5e()).urdf.is_none());
    }

    #[test]
    fn too_few_poses_have_no_constant_part() {
        let result = compare(&[], tcp(), None, &Arm::ur5e());
        assert_eq!(result.not_computed["urdf"], "there are no poses");
        for count in [1, 2] {
            let result = compare(&said_by(&Dh::UR5E, count), tcp(), None, &Arm::ur5e());
            assert!(result.urdf.is_some() && result.urdf_from_controller.is_none());
            assert!(result.not_computed["urdf_from_controller"].starts_with("the flange positions lie on a line"));
        }
        // A pair of the distance check: a straight line, whatever the number of poses.
        let mut poses = said_by(&Dh::UR5E, 20);
        for (i, pose) in poses.iter_mut().enumerate() {
            pose.joints_rad = said_by(&Dh::UR5E, 1)[0].joints_rad;
            pose.joints_rad[3] += 1e-3 * i as f64;
            pose.base_from_tcp = Dh::UR5E.forward(&pose.joints_rad) * tcp();
        }
        assert!(compare(&poses, tcp(), None, &Arm::ur5e()).urdf_from_controller.is_none());
    }

    #[test]
    fn a_result_is_read_back() {
        let result = compare(&said_by(&Dh::individual(), 12), tcp(), None, &Arm::ur5e());
        let text = serde_json::to_string(&result).unwrap();
        assert!(!text.contains("null") && !text.contains("controller_dh"), "{text}");
        assert_eq!(serde_json::from_str::<KinematicsResult>(&text).unwrap(), result);
    }
}
