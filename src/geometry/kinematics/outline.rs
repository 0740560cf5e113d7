//! The links of an arm as capsules that hold the real arm: what keep-out boxes are checked with.

use nalgebra::{Isometry3, Point3, Vector3};

use super::super::{Capsule, Point};
use super::{Arm, Dh, Joints};

/// The capsules of an arm.
///
/// For a UR5e they follow its drawings: the upper arm runs 0.138 m beside the shoulder axis, the forearm 0.131 m back.
/// They hold every vertex of the shape that its maker publishes with 3.5 mm to spare. An arm counts as a UR5e where
/// its flange is never farther than 20 mm and 2 degrees from that of the nominal one. A calibrated one does: its links
/// are then those of the nominal arm at the same joint positions, thicker by the largest distance found, since
/// its own parameters may lead hundreds of metres away between two joints.
///
/// For any other arm they run from joint to joint, with a radius of 0.08 m.
#[derive(Debug, Clone, PartialEq)]
pub struct Outline {
    /// The arm whose joints carry the capsules: the nominal UR5e, or the arm itself.
    arm: Arm,
    links: Vec<Link>,
}

/// A capsule that a joint carries.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link {
    /// Which part of the arm it is, for messages.
    pub name: &'static str,
    /// How many joints, counted from the base, move it: 0 to 6.
    pub joints: usize,
    /// One end of its axis in the frame of the last of them, metres.
    pub from_m: [f64; 3],
    /// The other end, metres.
    pub to_m: [f64; 3],
    /// Its radius, metres.
    pub radius_m: f64,
}

const fn link(name: &'static str, joints: usize, from_m: [f64; 3], to_m: [f64; 3], radius_m: f64) -> Link {
    Link { name, joints, from_m, to_m, radius_m }
}

/// The links of a UR5e in the frames of `ur5e.urdf`; each joint frame has its axis along z.
///
/// Tubes run along x. The housings of the joints, which are wider than the tubes, lie along the axes of the joints.
const UR5E: [Link; 14] = [
    link("base", 0, [0.0, 0.0, 0.0], [0.0, 0.0, 0.1], 0.08),
    link("shoulder", 1, [0.0, 0.0, 0.14], [0.0, 0.0, 0.19], 0.075),
    link("shoulder", 1, [0.0, 0.0, 0.1625], [0.0, -0.03, 0.1625], 0.08),
    link("upper arm", 2, [0.0, 0.0, 0.1], [0.0, 0.0, 0.175], 0.075),
    link("upper arm", 2, [0.0, 0.0, 0.138], [-0.425, 0.0, 0.138], 0.065),
    link("elbow", 2, [-0.425, 0.0, 0.095], [-0.425, 0.0, 0.175], 0.075),
    link("elbow", 3, [0.0, 0.0, 0.007], [0.0, 0.0, 0.03], 0.07),
    link("forearm", 3, [0.0, 0.0, 0.007], [-0.3922, 0.0, 0.007], 0.055),
    link("forearm", 3, [-0.3922, 0.0, -0.015], [-0.3922, 0.0, 0.03], 0.055),
    link("wrist 1", 4, [0.0, 0.0, 0.09], [0.0, 0.0, 0.1333], 0.055),
    link("wrist 1", 4, [0.0, -0.02, 0.1333], [0.0, 0.02, 0.1333], 0.055),
    link("wrist 2", 5, [0.0, 0.0, 0.08], [0.0, 0.0, 0.0997], 0.055),
    link("wrist 2", 5, [0.0, -0.02, 0.0997], [0.0, 0.02, 0.0997], 0.055),
    link("wrist 3", 6, [0.0, 0.0, 0.065], [0.0, 0.0, 0.08], 0.05),
];

/// Radius of the links of an arm whose shape is not known, metres.
const UNKNOWN_RADIUS_M: f64 = 0.08;
/// Names of the links of an arm whose shape is not known.
const UNKNOWN: [&str; 7] = ["base", "link 1", "link 2", "link 3", "link 4", "link 5", "flange"];
/// A flange this near to that of the nominal UR5e is one of a UR5e: metres.
const SAME_ARM_M: f64 = 0.02;
/// And at this angle, radians.
const SAME_ARM_RAD: f64 = 0.035;
/// Joint positions at which an arm is compared with the nominal UR5e.
const PROBES: u32 = 64;

impl Outline {
    /// The capsules of this arm.
    pub fn of(arm: &Arm) -> Self {
        match distance_from_ur5e_m(arm) {
            Some(off_m) => {
                let thicker = |link: Link| Link { radius_m: link.radius_m + off_m, ..link };
                Self { arm: Dh::UR5E.arm(arm), links: UR5E.map(thicker).to_vec() }
            }
            None => Self { arm: arm.clone(), links: from_joint_to_joint(arm) },
        }
    }

    /// The arm whose joint frames the links are in.
    pub fn arm(&self) -> &Arm {
        &self.arm
    }

    /// The capsules, from base to flange.
    pub fn links(&self) -> &[Link] {
        &self.links
    }

    /// The capsules at these joint positions.
    pub fn capsules(&self, joints_rad: &Joints) -> Vec<(&'static str, Capsule)> {
        let frames = self.arm.joint_frames(joints_rad);
        self.links.iter().map(|link| (link.name, link.at(&frames))).collect()
    }
}

impl Link {
    /// Where it is when the joints of its arm have these frames in `base`.
    pub fn at(&self, joint_frames: &[Isometry3<f64>; 6]) -> Capsule {
        let frame = self.joints.checked_sub(1).and_then(|last| joint_frames.get(last));
        let frame = frame.copied().unwrap_or_else(Isometry3::identity);
        let in_base = |m: [f64; 3]| Point::assume_frame((frame * Point3::from(m)).coords.into());
        Capsule { from: in_base(self.from_m), to: in_base(self.to_m), radius_m: self.radius_m }
    }
}

/// Largest distance between the flange and that of the nominal UR5e, metres; `None`: it is another arm.
fn distance_from_ur5e_m(arm: &Arm) -> Option<f64> {
    let mut worst_m: f64 = 0.0;
    for probe in 0..PROBES {
        // Multiples of irrational numbers spread evenly.
        let turn = |root: f64| ((f64::from(probe) * root.sqrt()).fract() - 0.5) * std::f64::consts::TAU;
        let joints_rad = [2.0, 3.0, 5.0, 7.0, 11.0, 13.0].map(turn);
        let (own, nominal) = (arm.forward(&joints_rad), Dh::UR5E.forward(&joints_rad));
        let off_m = own.distance_to_m(&nominal);
        let same = off_m <= SAME_ARM_M && own.angle_to_rad(&nominal) <= SAME_ARM_RAD;
        if !same {
            return None;
        }
        worst_m = worst_m.max(off_m);
    }
    // Below this it is rounding.
    Some(if worst_m > 1e-9 { worst_m } else { 0.0 })
}

fn from_joint_to_joint(arm: &Arm) -> Vec<Link> {
    let next = arm.joints.iter().map(|joint| &joint.origin).chain([&arm.flange]);
    let links = UNKNOWN.into_iter().zip(next).enumerate();
    links
        .map(|(i, (name, next))| link(name, i, [0.0; 3], Vector3::into(next.translation.vector), UNKNOWN_RADIUS_M))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::tests::some_joints;
    use super::*;

    /// Outermost points of the shape that Universal Robots publishes (visual meshes of its ROS description), measured
    /// in the joint frames here: number of joints that move it, then x, y, z in millimetres.
    const OUTERMOST: [(usize, [f64; 3]); 30] = [
        (0, [75.5, 0.0, 0.0]),
        (0, [0.0, -58.0, 99.0]),
        (1, [48.0, -33.0, 98.6]),
        (1, [0.0, -74.4, 162.5]),
        (1, [39.0, -43.0, 99.0]),
        (1, [0.0, 60.1, 175.0]),
        (1, [-23.0, -51.0, 232.0]),
        (1, [43.0, -35.0, 228.0]),
        (2, [60.6, 0.0, 150.0]),
        (2, [0.0, 60.1, 74.4]),
        (2, [-45.0, 0.0, 209.8]),
        (2, [-200.0, 42.8, 138.0]),
        (2, [-200.0, 0.0, 95.1]),
        (2, [-73.0, 14.0, 81.0]),
        (2, [-425.0, 60.1, 60.2]),
        (2, [-484.6, 0.0, 130.0]),
        (2, [-380.0, 0.0, 209.8]),
        (3, [58.4, 0.0, 60.2]),
        (3, [51.0, 29.0, 60.2]),
        (3, [0.0, -58.0, 60.2]),
        (3, [-200.0, 37.6, 7.0]),
        (3, [-360.0, 22.0, 60.4]),
        (3, [-392.2, 39.4, 0.0]),
        (3, [-431.1, 0.0, 0.0]),
        (3, [-400.0, 0.0, -49.5]),
        (4, [1.0, -53.6, 96.0]),
        (4, [0.0, 56.3, 133.3]),
        (4, [0.0, 0.0, 171.9]),
        (5, [4.0, 53.1, 62.0]),
        (6, [-2.0, -43.5, 67.0]),
    ];

    #[test]
    fn capsules_hold_the_published_shape() {
        let outline = Outline::of(&Arm::ur5e());
        for (joints, mm) in OUTERMOST {
            let at = Vector3::from(mm.map(|v| v / 1e3));
            let inside_m = |link: &Link| {
                let (from, to) = (Vector3::from(link.from_m), Vector3::from(link.to_m));
                let along = to - from;
                let fraction = ((at - from).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
                link.radius_m - (at - from - along * fraction).norm()
            };
            let own = outline.links().iter().filter(|link| link.joints == joints).map(inside_m);
            let best_m = own.fold(f64::MIN, f64::max);
            assert!(best_m > 0.0035 && best_m < 0.08, "{joints} {mm:?}: {best_m}");
        }
    }

    #[test]
    fn links_join_and_lead_to_the_flange() {
        let arm = Arm::ur5e();
        for joints_rad in some_joints(20) {
            let all = arm.link_capsules(&joints_rad);
            let distance_m = |a: &Capsule, b: &Capsule| {
                let steps = || (0..=100).map(|i| f64::from(i) / 100.0);
                let on = |c: &Capsule, f: f64| c.from.coords_m().lerp(&c.to.coords_m(), f);
                steps()
                    .flat_map(|f| steps().map(move |g| (f, g)))
                    .map(|(f, g)| (on(a, f) - on(b, g)).norm())
                    .fold(9.0, f64::min)
            };
            // Each link overlaps the one before it.
            for (a, b) in [(0, 1), (2, 3), (4, 5), (5, 6), (6, 7), (8, 9), (10, 11), (12, 13)] {
                let gap_m = distance_m(&all[a].1, &all[b].1) - all[a].1.radius_m - all[b].1.radius_m;
                assert!(gap_m < 0.0, "{joints_rad:?}: {} and {} are {gap_m} m apart", all[a].0, all[b].0);
            }
            let flange = Point::assume_frame(arm.forward(&joints_rad).translation_m());
            assert!(all[13].1.to.distance_m(flange) < all[13].1.radius_m);
        }
    }

    #[test]
    fn the_upper_arm_runs_beside_the_shoulder() {
        // Arm stretched along -x, z4 along -y: shoulder offset and elbow offset are in y.
        let all = Arm::ur5e().link_capsules(&[0.0; 6]);
        let [x, y, z] = all[4].1.to.xyz_m();
        assert!((x + 0.425).abs() < 1e-12 && (y + 0.138).abs() < 1e-12 && (z - 0.1625).abs() < 1e-12, "{x} {y} {z}");
        let [x, y, z] = all[7].1.to.xyz_m();
        assert!((x + 0.8172).abs() < 1e-12 && (y + 0.007).abs() < 1e-12 && (z - 0.1625).abs() < 1e-12, "{x} {y} {z}");
    }

    #[test]
    fn a_calibrated_arm_has_the_links_of_the_nominal_one() {
        let calibrated = Arm::from_urdf(&Dh::individual().to_urdf("t")).unwrap();
        for joints_rad in some_joints(50) {
            let off_m = calibrated.forward(&joints_rad).distance_to_m(&Dh::UR5E.forward(&joints_rad));
            let nominal = Arm::ur5e().link_capsules(&joints_rad);
            for ((name, found), (_, known)) in calibrated.link_capsules(&joints_rad).iter().zip(&nominal) {
                assert!(found.from.distance_m(known.from) < 1e-9 && found.to.distance_m(known.to) < 1e-9, "{name}");
                let thicker_m = found.radius_m - known.radius_m;
                assert!(thicker_m > 0.5 * off_m && thicker_m < 0.005, "{name}: {thicker_m} {off_m}");
            }
        }
    }

    #[test]
    fn another_arm_is_followed_from_joint_to_joint() {
        let mut dh = Dh::UR5E;
        dh.a_m = [0.0, -0.6127, -0.571_55, 0.0, 0.0, 0.0];
        dh.d_m = [0.1807, 0.0, 0.0, 0.174_15, 0.119_85, 0.116_55];
        let ur10e = Arm::from_urdf(&dh.to_urdf("ur10e")).unwrap();
        for joints_rad in some_joints(5) {
            let all = ur10e.link_capsules(&joints_rad);
            assert_eq!(all.len(), 7);
            assert!(all.iter().all(|(_, c)| c.radius_m == 0.08));
            for pair in all.windows(2) {
                assert!(pair[0].1.to.distance_m(pair[1].1.from) < 1e-12, "{pair:?}");
            }
            let flange = Point::assume_frame(ur10e.forward(&joints_rad).translation_m());
            assert!(all[6].1.to.distance_m(flange) < 1e-12);
        }
        let mut broken = Arm::ur5e();
        broken.flange.translation.vector.x = f64::NAN;
        assert_eq!(broken.link_capsules(&[0.0; 6]).len(), 7);
    }
}
