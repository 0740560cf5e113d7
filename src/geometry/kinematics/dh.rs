//! Denavit-Hartenberg parameters, as a controller reports them, and the URDF that says the same.

use std::f64::consts::FRAC_PI_2;
use std::fmt::Write as _;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::super::{Base, Flange, Transform};
use super::{Arm, Joints};

/// Standard Denavit-Hartenberg parameters of six joints, as the controller reports them.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Dh {
    /// Joint offsets, radians.
    pub theta_rad: [f64; 6],
    /// Link lengths, metres.
    pub a_m: [f64; 6],
    /// Link offsets, metres.
    pub d_m: [f64; 6],
    /// Link twists, radians.
    pub alpha_rad: [f64; 6],
}

/// Links after each joint of a UR arm; the flange follows.
const LINKS: [&str; 6] =
    ["shoulder_link", "upper_arm_link", "forearm_link", "wrist_1_link", "wrist_2_link", "wrist_3_link"];

/// Largest torque of each joint of a UR5e, Nm.
const EFFORT_NM: [f64; 6] = [150.0, 150.0, 150.0, 28.0, 28.0, 28.0];

impl Dh {
    /// The nominal UR5e.
    pub const UR5E: Self = Self {
        theta_rad: [0.0; 6],
        a_m: [0.0, -0.425, -0.3922, 0.0, 0.0, 0.0],
        d_m: [0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996],
        alpha_rad: [FRAC_PI_2, 0.0, 0.0, FRAC_PI_2, -FRAC_PI_2, 0.0],
    };

    /// `base_from_flange` at these joint positions: the product of Rz(q + theta) Tz(d) Tx(a) Rx(alpha).
    pub fn forward(&self, joints_rad: &Joints) -> Transform<Base, Flange> {
        let links = (0..6).map(|i| rotation_z(joints_rad[i]) * self.link(i));
        Transform::assume_frames(links.fold(Isometry3::identity(), |sum, link| sum * link))
    }

    fn link(&self, i: usize) -> Isometry3<f64> {
        rotation_z(self.theta_rad[i])
            * Isometry3::from_parts(
                Translation3::new(self.a_m[i], 0.0, self.d_m[i]),
                UnitQuaternion::from_axis_angle(&Vector3::x_axis(), self.alpha_rad[i]),
            )
    }

    /// The same arm as a chain of joints with the limits of `like`.
    pub fn arm(&self, like: &Arm) -> Arm {
        let mut arm = like.clone();
        for i in 0..6 {
            arm.joints[i].origin = if i == 0 { Isometry3::identity() } else { self.link(i - 1) };
            arm.joints[i].axis = Vector3::z();
        }
        arm.flange = self.link(5);
        arm
    }

    /// A URDF of this arm: links `base_link`, `base` to `flange` and `tool0`, every number in full, and the joint
    /// limits of the nominal UR5e.
    ///
    /// The frame of a joint in the one before is Rz(theta) Tz(d) Tx(a) Rx(alpha) of the link between: roll alpha and
    /// yaw theta. There is no pitch, so no pair of them is ambiguous.
    /// Where d2, d3 and d4 of a calibrated arm are hundreds of metres and cancel, so are the origins written here: the
    /// flange is right, the frames between are not where the links are.
    pub fn to_urdf(&self, name: &str) -> String {
        let nominal = Arm::ur5e();
        let mut text = format!("<?xml version=\"1.0\"?>\n<robot name=\"{}\">\n", escaped(name));
        for link in ["base_link", "base"].iter().chain(&LINKS).chain(&["flange", "tool0"]) {
            let _ = writeln!(text, "  <link name=\"{link}\"/>");
        }
        text +=
            &fixed("base_link-base_fixed_joint", "base_link", "base", "xyz=\"0 0 0\" rpy=\"0 0 3.141592653589793\"");
        let mut parent = "base";
        for (i, (joint, child)) in nominal.joints.iter().zip(LINKS).enumerate() {
            let origin = if i == 0 { "xyz=\"0 0 0\" rpy=\"0 0 0\"".to_owned() } else { self.origin(i - 1) };
            let [lower, upper] = joint.limits_rad;
            let _ = writeln!(
                text,
                "  <joint name=\"{}\" type=\"revolute\"><parent link=\"{parent}\"/><child link=\"{child}\"/>\
                 <origin {origin}/><axis xyz=\"0 0 1\"/><limit lower=\"{lower}\" upper=\"{upper}\" \
                 effort=\"{}\" velocity=\"{}\"/></joint>",
                joint.name, EFFORT_NM[i], joint.max_speed_rad_s
            );
            parent = child;
        }
        text += &fixed("wrist_3-flange", parent, "flange", &self.origin(5));
        text += &fixed("flange-tool0", "flange", "tool0", "xyz=\"0 0 0\" rpy=\"0 0 0\"");
        text + "</robot>\n"
    }

    /// The attributes of `<origin>` for the link after joint `i`.
    fn origin(&self, i: usize) -> String {
        let (sin, cos) = self.theta_rad[i].sin_cos();
        let (x, y, z) = (self.a_m[i] * cos, self.a_m[i] * sin, self.d_m[i]);
        format!("xyz=\"{x} {y} {z}\" rpy=\"{} 0 {}\"", self.alpha_rad[i], self.theta_rad[i])
    }
}

#[cfg(test)]
impl Dh {
    /// An individual UR5e as controllers report one, millimetres from the nominal one.
    ///
    /// The axes of shoulder lift, elbow and wrist 1 are tilted to each other by `tilt`. The common normal of two such
    /// axes, which the parameters go along, leaves the arm by hundreds of metres: d2, d3 and d4 go there and back.
    pub(crate) fn individual() -> Self {
        let mut dh = Self::UR5E;
        dh.a_m = [5e-5, 0.0, 0.0, 3e-5, -8e-5, 0.0];
        dh.theta_rad = [4e-4, 0.0, 0.0, -3e-4, 2e-4, -5e-4];
        dh.d_m = [0.1628, 0.0, 0.0, 0.1330, 0.0999, 0.0994];
        for (i, length_m, turn, tilt) in [(1, -0.4252, 1.1, 1.1e-3_f64), (2, -0.3919, -0.9, 0.8e-3)] {
            let back_m = -length_m * f64::sin(turn) / tilt.sin();
            (dh.a_m[i], dh.alpha_rad[i]) = (length_m * f64::cos(turn), tilt);
            dh.theta_rad[i] += turn;
            dh.theta_rad[i + 1] -= turn;
            dh.d_m[i] += back_m * tilt.cos();
            dh.d_m[i + 1] -= back_m;
        }
        dh
    }
}

fn fixed(name: &str, parent: &str, child: &str, origin: &str) -> String {
    format!(
        "  <joint name=\"{name}\" type=\"fixed\"><parent link=\"{parent}\"/><child link=\"{child}\"/><origin {origin}/></joint>\n"
    )
}

fn escaped(name: &str) -> String {
    name.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn rotation_z(angle_rad: f64) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::identity(), UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_rad))
}

#[cfg(test)]
mod tests {
    use super::super::tests::some_joints;
    use super::*;

    fn assert_same(dh: &Dh, tolerance: f64) {
        let arm = Arm::from_urdf(&dh.to_urdf("an arm & its <name>")).unwrap();
        for joints_rad in some_joints(200) {
            let (a, b) = (arm.forward(&joints_rad), dh.forward(&joints_rad));
            let (off_m, off_rad) = (a.distance_to_m(&b), a.angle_to_rad(&b));
            assert!(off_m <= tolerance && off_rad <= tolerance, "{joints_rad:?}: {off_m} m, {off_rad} rad");
        }
    }

    #[test]
    fn a_urdf_says_what_the_parameters_say() {
        assert_same(&Dh::UR5E, 1e-12);
        let individual = Dh::individual();
        assert!(individual.d_m[1..4].iter().all(|d| d.abs() > 100.0), "{individual:?}");
        assert_same(&individual, 1e-9);
        let arm = Arm::from_urdf(&Dh::UR5E.to_urdf("ur5e")).unwrap();
        for (found, known) in arm.joints.iter().zip(&Arm::ur5e().joints) {
            assert_eq!((&found.name, found.limits_rad), (&known.name, known.limits_rad));
            assert_eq!(found.max_speed_rad_s, known.max_speed_rad_s);
        }
    }

    #[test]
    fn quarter_turns_of_offset_and_twist_are_exact() {
        for signs in 0..16_u32 {
            let quarter = |bit: u32| if signs >> bit & 1 == 0 { FRAC_PI_2 } else { -FRAC_PI_2 };
            let theta_rad = [quarter(0), 0.3, quarter(1), -0.2, quarter(0), std::f64::consts::PI];
            let alpha_rad = [quarter(2), quarter(3), 0.0, quarter(2), quarter(3), std::f64::consts::PI];
            assert_same(&Dh { theta_rad, alpha_rad, a_m: [0.1, -0.4, 0.0, 0.2, 0.3, -0.1], ..Dh::UR5E }, 1e-12);
        }
    }

    /// Others may write a pitch of a quarter turn: roll and yaw then turn about one axis.
    #[test]
    fn a_urdf_at_gimbal_lock_is_read_exactly() {
        for pitch in [FRAC_PI_2, -FRAC_PI_2] {
            for (roll, yaw) in [(0.0, 0.0), (0.7, 0.2), (-1.1, 2.9)] {
                let turned = format!("<child link=\"base\"/><origin xyz=\"0 0 0\" rpy=\"{roll} {pitch} {yaw}\"/>");
                let text = Dh::UR5E.to_urdf("t").replace("rpy=\"0 0 3.141592653589793\"", "rpy=\"0 0 0\"");
                let text = text.replace("<child link=\"base\"/><origin xyz=\"0 0 0\" rpy=\"0 0 0\"/>", &turned);
                let found = Arm::chain(&urdf_rs::read_from_string(&text).unwrap(), "base_link", "flange").unwrap();
                // Rz(yaw) Ry(pitch) Rx(roll) = Rz(yaw -+ roll) Ry(pitch) there.
                let alone = rotation_z(yaw - roll * pitch.signum());
                let upright = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), pitch);
                let known = alone * Isometry3::from_parts(Translation3::identity(), upright);
                let q = [0.3, -1.2, 1.4, -1.7, -1.5, 0.2];
                let known: Transform<Base, Flange> = Transform::assume_frames(known * Dh::UR5E.forward(&q).iso());
                let off = (found.forward(&q).distance_to_m(&known), found.forward(&q).angle_to_rad(&known));
                assert!(off.0 < 1e-12 && off.1 < 1e-12, "{roll} {pitch} {yaw}: {off:?}");
            }
        }
    }
}
