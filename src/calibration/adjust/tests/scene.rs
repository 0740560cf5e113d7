//! A made-up cell: two cameras, a display that may be bent, an arm that may be off; everything known.

use std::collections::BTreeMap;

use nalgebra::Isometry3;
use rand::Rng as _;
use rand_pcg::Pcg64;

use crate::board::{Board, Corner, View};
use crate::calibration::adjust::lens;
use crate::calibration::adjust::se3;
use crate::calibration::adjust::shape::{Basis, TERMS};
use crate::calibration::cameras::{SolvedCamera, ViewFit};
use crate::calibration::hand_eye::fixture::{normal, seeded};
use crate::calibration::problem::{CameraSetup, PoseData, Problem};
use crate::calibration::settings::{Carried, Method, PoseKind, Settings};
use crate::geometry::{Base, Camera, Pinhole, Tcp, Transform, rotation};

/// What is true, and how much noise there is.
#[derive(Debug, Clone)]
pub(super) struct Scene {
    pub(super) cameras: BTreeMap<Camera, Pinhole>,
    pub(super) event_from_rgb: Isometry3<f64>,
    pub(super) shape_m: [f64; TERMS],
    pub(super) carried: Carried,
    /// `base_from_rgb` and `tcp_from_target`, or `base_from_target` and `tcp_from_rgb`.
    pub(super) ends: [Isometry3<f64>; 2],
    /// Poses for intrinsics and for hand-eye.
    pub(super) poses: [usize; 2],
    pub(super) noise_px: BTreeMap<Camera, f64>,
    pub(super) robot: [f64; 2],
}

pub(super) fn board() -> Board {
    Board { squares_x: 7, squares_y: 5, square_m: 0.012, marker_m: 0.0096, dictionary: "DICT_4X4_50".into() }
}

fn motion(pose: [f64; 6]) -> Isometry3<f64> {
    *Transform::<Base, Tcp>::from_pose_vector(pose).iso()
}

impl Scene {
    /// The cameras of the paper, with noise as there.
    pub(super) fn paper() -> Self {
        let rgb = Pinhole {
            width: 1380,
            height: 780,
            fx: 2771.0,
            fy: 2773.0,
            cx: 700.0,
            cy: 391.0,
            distortion: [-0.2, 0.3, 0.0, 0.0, 0.0],
        };
        let event = Pinhole {
            width: 1280,
            height: 720,
            fx: 2571.0,
            fy: 2573.0,
            cx: 620.0,
            cy: 370.0,
            distortion: [-0.18, 0.25, 0.0, 0.0, 0.0],
        };
        Self {
            cameras: [(Camera::Rgb, rgb), (Camera::Event, event)].into(),
            event_from_rgb: motion([-0.0344, 0.0008, -0.0011, 0.01, 0.015, -0.005]),
            shape_m: [0.0; TERMS],
            carried: Carried::Target,
            ends: [
                motion([0.125, -0.563, 0.382, 2.1, -2.15, 0.12]),
                motion([-0.031, -0.022, 0.052, 0.02, -0.03, 1.57]),
            ],
            poses: [12, 10],
            noise_px: [(Camera::Rgb, 0.1), (Camera::Event, 0.45)].into(),
            robot: [0.05e-3, 0.1e-3],
        }
    }

    pub(super) fn without_noise(self) -> Self {
        Self { noise_px: self.noise_px.keys().map(|c| (*c, 0.0)).collect(), robot: [0.0; 2], ..self }
    }

    pub(super) fn only(mut self, camera: Camera) -> Self {
        self.cameras.retain(|c, _| *c == camera);
        self
    }

    /// The problem that this gives, and the true `rgb_from_target` of each pose.
    pub(super) fn problem(&self, seed: u64) -> (Problem, Vec<Isometry3<f64>>) {
        let mut rng = seeded(seed);
        let (mut truth, mut poses) = (Vec::new(), Vec::new());
        for i in 0..self.poses[0] + self.poses[1] {
            let rgb_from_target = placed(&mut rng);
            let kind = if i < self.poses[0] { PoseKind::Intrinsics } else { PoseKind::HandEye };
            let views = self.cameras.keys().map(|c| (*c, self.view(*c, &rgb_from_target, &mut rng))).collect();
            poses.push(PoseData {
                id: format!("pose-{i:02}"),
                kind,
                base_from_tcp: Some(Transform::assume_frames(self.robot(&rgb_from_target, &mut rng))),
                views,
                stillness: None,
                skipped: None,
            });
            truth.push(rgb_from_target);
        }
        (self.with_poses(poses), truth)
    }

    fn with_poses(&self, poses: Vec<PoseData>) -> Problem {
        let setup = |(camera, p): (&Camera, &Pinhole)| {
            let (width, height, focal_px) = (p.width, p.height, Some(1.01 * p.fx));
            (*camera, CameraSetup { width, height, serial: None, lens: None, focal_px })
        };
        Problem {
            cell: "made up".into(),
            board: board(),
            carried: self.carried,
            robot_poses: self.poses[1] > 0,
            cameras: self.cameras.iter().map(setup).collect(),
            poses,
            pairs: Vec::new(),
            checks: None,
            settings: Settings::usual(Method::Precise),
            gates: None,
            known: None,
            kinematics: None,
        }
    }

    fn view(&self, camera: Camera, rgb_from_target: &Isometry3<f64>, rng: &mut Pcg64) -> View {
        let camera_from_rgb = if camera == Camera::Rgb { Isometry3::identity() } else { self.event_from_rgb };
        let (pinhole, basis) = (&self.cameras[&camera], Basis::of(&board()));
        let seen = |id: u32| {
            let [x, y, _] = board().corner(id)?.xyz_m();
            let on_board = nalgebra::Point3::new(x, y, basis.height_m(&self.shape_m, id));
            let px = lens::project(&lens::of_pinhole(pinhole), &(camera_from_rgb * rgb_from_target * on_board).coords)?;
            let [dx, dy, _] = normal(rng, self.noise_px[&camera]);
            let px = [px.x + dx, px.y + dy];
            pinhole.sees(px).then(|| Corner::at(id, px))
        };
        View::new((0..24).filter_map(seen).collect())
    }

    /// What the arm says, with its noise.
    fn robot(&self, rgb_from_target: &Isometry3<f64>, rng: &mut Pcg64) -> Isometry3<f64> {
        let [left, right] = self.ends;
        let middle = match self.carried {
            Carried::Target => *rgb_from_target,
            Carried::Cameras => rgb_from_target.inverse(),
        };
        let ([x, y, z], turn) = (normal(rng, self.robot[0]), normal(rng, self.robot[1]));
        let off = Isometry3::from_parts(nalgebra::Translation3::new(x, y, z), rotation::from_vector(turn));
        left * middle * right.inverse() * off
    }

    /// Cameras that are somewhat off, as a first solve leaves them.
    pub(super) fn start(&self, problem: &Problem) -> BTreeMap<Camera, SolvedCamera> {
        let off = |(camera, p): (&Camera, &Pinhole)| {
            let distortion = [-0.15, 0.0, 0.0, 0.0, 0.0];
            let pinhole =
                Pinhole { fx: p.fx * 1.004, fy: p.fy * 1.003, cx: p.cx + 8.0, cy: p.cy - 5.0, distortion, ..*p };
            let fit = ViewFit { rms_px: None, rejected: None, note: None };
            let views = (0..problem.poses.len()).map(|i| (i, fit.clone())).collect();
            (*camera, SolvedCamera { pinhole, rms_px: 1.0, points: 0, views })
        };
        self.cameras.iter().map(off).collect()
    }
}

/// A board that is tilted and shifted before the cameras.
fn placed(rng: &mut Pcg64) -> Isometry3<f64> {
    let mut up_to = |limit: f64| rng.random_range(-limit..limit);
    let (tilt, at) = ([up_to(0.6), up_to(0.6), up_to(1.0)], [up_to(0.03) + 0.012, up_to(0.02), 0.38 + up_to(0.08)]);
    let centre = nalgebra::Translation3::new(-0.042, -0.03, 0.0);
    let turned = Isometry3::from_parts(at.into(), se3::rotation_exp(&tilt.into()));
    turned * centre
}
