//! The serial chain of an arm, from a URDF or from the controller's Denavit-Hartenberg parameters.
//!
//! Forward kinematics, an inverse by damped least squares from a seed, and the links as capsules, for planning.

mod dh;
mod outline;

use nalgebra::{Isometry3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};

use super::{Base, Capsule, Flange, Transform, rotation};

pub use dh::Dh;
pub use outline::{Link, Outline};

/// Six joint positions, radians.
pub type Joints = [f64; 6];

/// One revolute joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Joint name.
    pub name: String,
    /// Joint frame in the frame of the joint before, at position zero.
    pub origin: Isometry3<f64>,
    /// Axis of rotation in the joint frame, unit length.
    pub axis: Vector3<f64>,
    /// Smallest and largest position, radians.
    pub limits_rad: [f64; 2],
    /// Largest speed, rad/s.
    pub max_speed_rad_s: f64,
}

/// A six-joint arm, from `base` to `flange`.
#[derive(Debug, Clone, PartialEq)]
pub struct Arm {
    /// The joints from base to flange.
    pub joints: [Joint; 6],
    /// Flange in the frame of the last joint.
    pub flange: Isometry3<f64>,
}

/// Why a robot model cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// Not a URDF.
    #[error("the URDF cannot be read: {0}")]
    Urdf(#[from] urdf_rs::UrdfError),
    /// A link is not where it is needed.
    #[error("the URDF has no chain of six revolute joints from link `{from}` to link `{to}`: {why}")]
    Chain {
        /// First link.
        from: String,
        /// Last link.
        to: String,
        /// What is wrong.
        why: String,
    },
}

/// Why a target has no joint positions.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("no joint positions reach the target: the nearest found is {position_mm:.1} mm and {angle_deg:.2} deg away")]
pub struct Unreachable {
    /// Remaining distance, millimetres.
    pub position_mm: f64,
    /// Remaining angle, degrees.
    pub angle_deg: f64,
}

/// Names of the joints of a UR arm, base to wrist.
pub const UR_JOINTS: [&str; 6] =
    ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint"];

/// The URDF of a nominal UR5e, written from its published DH parameters.
pub const UR5E_URDF: &str = include_str!("../ur5e.urdf");

impl Arm {
    /// Reads the chain from link `base` to link `flange` of a URDF.
    pub fn from_urdf(text: &str) -> Result<Self, ModelError> {
        Self::chain(&urdf_rs::read_from_string(text)?, "base", "flange")
    }

    /// The nominal UR5e.
    pub fn ur5e() -> Self {
        // The text is compiled in and a test reads it.
        #[expect(clippy::expect_used, reason = "the compiled-in URDF is read by a test")]
        Self::from_urdf(UR5E_URDF).expect("the compiled-in URDF of the UR5e is valid")
    }

    fn chain(robot: &urdf_rs::Robot, from: &str, to: &str) -> Result<Self, ModelError> {
        let fail = |why: String| ModelError::Chain { from: from.into(), to: to.into(), why };
        let mut upward = Vec::new();
        let mut link = to.to_owned();
        while link != from {
            let joint = robot.joints.iter().find(|j| j.child.link == link);
            let joint = joint.ok_or_else(|| fail(format!("link `{link}` has no parent joint")))?;
            if upward.len() > robot.joints.len() {
                return Err(fail("the joints form a loop".into()));
            }
            link.clone_from(&joint.parent.link);
            upward.push(joint);
        }
        let mut before = Isometry3::identity();
        let mut joints = Vec::new();
        for joint in upward.into_iter().rev() {
            before *= pose_of(&joint.origin);
            if matches!(joint.joint_type, urdf_rs::JointType::Revolute | urdf_rs::JointType::Continuous) {
                joints.push(revolute(joint, before));
                before = Isometry3::identity();
            } else if !matches!(joint.joint_type, urdf_rs::JointType::Fixed) {
                return Err(fail(format!("joint `{}` is neither revolute nor fixed", joint.name)));
            }
        }
        let found = joints.len();
        let joints = joints.try_into().map_err(|_| fail(format!("it has {found} revolute joints")))?;
        Ok(Self { joints, flange: before })
    }

    /// `base_from_flange` at these joint positions.
    pub fn forward(&self, joints_rad: &Joints) -> Transform<Base, Flange> {
        let frames = self.joint_frames(joints_rad);
        Transform::assume_frames(frames[5] * self.flange)
    }

    /// Frame of each joint in `base` after its own rotation.
    pub fn joint_frames(&self, joints_rad: &Joints) -> [Isometry3<f64>; 6] {
        let mut sum = Isometry3::identity();
        std::array::from_fn(|i| {
            let joint = &self.joints[i];
            let turn = UnitQuaternion::from_scaled_axis(joint.axis * joints_rad[i]);
            sum = sum * joint.origin * Isometry3::from_parts(Translation3::identity(), turn);
            sum
        })
    }

    /// The links at these joint positions, as named capsules that hold the real arm; see [`Outline`].
    pub fn link_capsules(&self, joints_rad: &Joints) -> Vec<(&'static str, Capsule)> {
        Outline::of(self).capsules(joints_rad)
    }

    /// Joint positions that bring the flange to `base_from_flange`, starting from `seed_rad`.
    ///
    /// Damped least squares; the answer is the branch of the seed, within 1e-8 m and 1e-8 rad, and is
    /// not checked against the joint limits.
    pub fn inverse(
        &self,
        base_from_flange: &Transform<Base, Flange>,
        seed_rad: &Joints,
    ) -> Result<Joints, Unreachable> {
        let mut q = *seed_rad;
        let mut damping = 1e-6;
        let mut error = self.error_to(base_from_flange, &q);
        for _ in 0..200 {
            if error.norm() < 1e-10 {
                return Ok(q);
            }
            let step = self.damped_step(&q, &error, damping);
            let next: Joints = std::array::from_fn(|i| q[i] + step[i].clamp(-0.3, 0.3));
            let next_error = self.error_to(base_from_flange, &next);
            if next_error.norm() < error.norm() {
                (q, error) = (next, next_error);
                damping = (damping * 0.3).max(1e-12);
            } else {
                damping *= 10.0;
                if damping > 1e6 {
                    break;
                }
            }
        }
        let (position_m, angle_rad) = (error.fixed_rows::<3>(0).norm(), error.fixed_rows::<3>(3).norm());
        let reached = position_m < 1e-8 && angle_rad < 1e-8;
        if reached {
            Ok(q)
        } else {
            Err(Unreachable { position_mm: position_m * 1e3, angle_deg: angle_rad.to_degrees() })
        }
    }

    /// Distance (m) and rotation vector (rad) still missing to the target, in `base`.
    fn error_to(&self, target: &Transform<Base, Flange>, q: &Joints) -> Vector6<f64> {
        let now = self.forward(q);
        let translation = target.iso().translation.vector - now.iso().translation.vector;
        let turn = rotation::to_vector(&(target.rotation() * now.rotation().inverse()));
        Vector6::new(translation.x, translation.y, translation.z, turn.x, turn.y, turn.z)
    }

    fn damped_step(&self, q: &Joints, error: &Vector6<f64>, damping: f64) -> Vector6<f64> {
        let jacobian = self.jacobian(q);
        let normal = jacobian.transpose() * jacobian + Matrix6::identity() * damping;
        let right = jacobian.transpose() * error;
        normal.cholesky().map_or_else(Vector6::zeros, |c| c.solve(&right))
    }

    /// Columns: linear (m/rad) and angular velocity of the flange in `base` per joint speed.
    pub fn jacobian(&self, joints_rad: &Joints) -> Matrix6<f64> {
        let frames = self.joint_frames(joints_rad);
        let tip = (frames[5] * self.flange).translation.vector;
        let mut jacobian = Matrix6::zeros();
        for (i, frame) in frames.iter().enumerate() {
            let axis = frame.rotation * self.joints[i].axis;
            jacobian.fixed_view_mut::<3, 1>(0, i).copy_from(&axis.cross(&(tip - frame.translation.vector)));
            jacobian.fixed_view_mut::<3, 1>(3, i).copy_from(&axis);
        }
        jacobian
    }
}

fn pose_of(pose: &urdf_rs::Pose) -> Isometry3<f64> {
    let [roll, pitch, yaw] = *pose.rpy;
    let [x, y, z] = *pose.xyz;
    Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(roll, pitch, yaw))
}

fn revolute(joint: &urdf_rs::Joint, origin: Isometry3<f64>) -> Joint {
    let axis = Vector3::from(*joint.axis.xyz);
    let [lower, upper] = [joint.limit.lower, joint.limit.upper];
    let full = std::f64::consts::TAU;
    let limits_rad = if lower < upper { [lower, upper] } else { [-full, full] };
    Joint {
        name: joint.name.clone(),
        origin,
        axis: axis.try_normalize(1e-9).unwrap_or_else(Vector3::z),
        limits_rad,
        max_speed_rad_s: joint.limit.velocity,
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Joint positions all over the range, the same every time.
    pub(crate) fn some_joints(count: usize) -> Vec<Joints> {
        let mut state = 7_u64;
        let mut next = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0) * std::f64::consts::PI
        };
        (0..count).map(|_| std::array::from_fn(|_| next())).collect()
    }

    const POSES: [Joints; 3] = [[0.0; 6], [0.3, -1.2, 1.4, -1.7, -1.5, 0.2], [-1.4, -1.9, 2.1, 0.4, 1.2, -2.9]];

    #[test]
    fn urdf_and_dh_agree() {
        let arm = Arm::ur5e();
        for q in POSES {
            let (a, b) = (arm.forward(&q), Dh::UR5E.forward(&q));
            assert!(a.distance_to_m(&b) < 1e-9 && a.angle_to_rad(&b) < 1e-9, "{a:?} {b:?}");
        }
        assert_eq!(arm.joints[0].name, UR_JOINTS[0]);
    }

    #[test]
    fn zero_pose_is_the_published_one() {
        // Stretched along -x: x = a2 + a3, y = -(d4 + d6), z = d1 - d5.
        let t = Arm::ur5e().forward(&[0.0; 6]).translation_m();
        for (found, known) in t.iter().zip([-0.8172, -0.2329, 0.0628]) {
            assert!((found - known).abs() < 1e-9, "{t:?}");
        }
    }

    #[test]
    fn inverse_finds_the_joints_of_its_branch() {
        let arm = Arm::ur5e();
        for q in &POSES[1..] {
            let seed: Joints = std::array::from_fn(|i| q[i] + 0.15);
            let found = arm.inverse(&arm.forward(q), &seed).unwrap();
            assert!(q.iter().zip(found).all(|(a, b)| (a - b).abs() < 1e-6), "{q:?} {found:?}");
        }
        let far = Transform::from_pose_vector([3.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert!(arm.inverse(&far, &POSES[1]).is_err());
    }
}
