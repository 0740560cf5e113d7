//! Made-up cells with known truth, for the tests of `calibration`.

use rand::{Rng as _, SeedableRng as _};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;

use super::{EyeInHand, EyeToHand, Pair};
use crate::geometry::{Base, Tcp, Transform, rotation};

/// A generator that gives the same numbers every time.
pub(in crate::calibration) fn seeded(seed: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed)
}

/// Normal numbers of this standard deviation.
pub(in crate::calibration) fn normal(rng: &mut Pcg64, sigma: f64) -> [f64; 3] {
    std::array::from_fn(|_| sigma * rng.sample::<f64, _>(StandardNormal))
}

/// The cell of the paper, where the camera looks back at the robot.
pub(in crate::calibration) fn paper_cell() -> EyeToHand {
    EyeToHand {
        base_from_camera: Transform::from_pose_vector([0.125, -0.563, 0.382, 2.1, -2.15, 0.12]),
        tcp_from_target: Transform::from_pose_vector([-0.031, -0.022, 0.052, 0.02, -0.03, 1.57]),
    }
}

/// Robot poses about one place, each axis turned by up to `turn_rad`.
pub(in crate::calibration) fn spread_poses(count: usize, turn_rad: f64, seed: u64) -> Vec<Transform<Base, Tcp>> {
    let mut rng = seeded(seed);
    let middle = Transform::<Base, Tcp>::from_pose_vector([0.35, -0.2, 0.4, 0.0, 3.1, 0.2]);
    let pose = |_| {
        let mut up_to = |limit: f64| std::array::from_fn(|_| rng.random_range(-limit..limit));
        let (shift, turn): ([f64; 3], [f64; 3]) = (up_to(0.15), up_to(turn_rad));
        middle * Transform::<Tcp, Tcp>::from_parts(shift, rotation::from_vector(turn))
    };
    (0..count).map(pose).collect()
}

/// What a perfect camera sees where the robot carries the target.
pub(in crate::calibration) fn seen_by_static(truth: &EyeToHand, poses: &[Transform<Base, Tcp>]) -> Vec<Pair> {
    let pair = |base_from_tcp: &Transform<Base, Tcp>| Pair {
        base_from_tcp: *base_from_tcp,
        camera_from_target: truth.base_from_camera.inverse() * *base_from_tcp * truth.tcp_from_target,
    };
    poses.iter().map(pair).collect()
}

/// What a perfect camera sees where the robot carries it.
pub(in crate::calibration) fn seen_by_carried(truth: &EyeInHand, poses: &[Transform<Base, Tcp>]) -> Vec<Pair> {
    let pair = |base_from_tcp: &Transform<Base, Tcp>| Pair {
        base_from_tcp: *base_from_tcp,
        camera_from_target: truth.tcp_from_camera.inverse() * base_from_tcp.inverse() * truth.base_from_target,
    };
    poses.iter().map(pair).collect()
}

/// The same with normal errors of the board poses: per axis, in the frame of the board.
pub(in crate::calibration) fn noisy(pairs: &[Pair], sigma_m: f64, sigma_rad: f64, seed: u64) -> Vec<Pair> {
    let mut rng = seeded(seed);
    let mut shaken = |pair: &Pair| {
        let (shift, turn) = (normal(&mut rng, sigma_m), normal(&mut rng, sigma_rad));
        let error = Transform::from_parts(shift, rotation::from_vector(turn));
        Pair { camera_from_target: pair.camera_from_target * error, ..*pair }
    };
    pairs.iter().map(&mut shaken).collect()
}
