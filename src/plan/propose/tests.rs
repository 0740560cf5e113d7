//! Predictions against solves of made-up sessions, and proposals for the shipped cell.

use std::path::PathBuf;

use nalgebra::{DMatrix, DVector, Isometry3, Point3, Vector3};
use rand::{Rng as _, SeedableRng as _};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;

use super::*;
use crate::config::{self, Mount, parse_cell, parse_trajectory, tour_yaml};
use crate::geometry::{Base, Camera, Pinhole, Tcp, Transform};
use crate::plan::{coverage, expand};

fn cell(name: &str) -> Cell {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("cells").join(name);
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    parse_cell(&text, name).unwrap_or_else(|e| panic!("{e}"))
}

fn wish() -> Wish {
    Wish { poses: 20, seconds: 60.0, seed: 1, depths_m: None }
}

fn quiet(_: usize, _: usize) {}

/// One camera and twelve poses of the shipped set, as a session would see them.
struct Session {
    cell: Cell,
    poses: Vec<Transform<Base, Tcp>>,
}

/// Eight numbers of the lens, six of the camera's place, six of the target's, then six for the error of each robot pose.
const SHARED: usize = 20;
const ROBOT_SIGMA: [f64; 6] = [1e-4, 1e-4, 1e-4, 2e-4, 2e-4, 2e-4];
const CORNER_SIGMA_PX: f64 = 0.1;

impl Session {
    fn new() -> Self {
        let mut cell = cell("sim.yaml");
        cell.rgb = None;
        let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("trajectories/hand-eye-22.yaml");
        let trajectory = parse_trajectory(&std::fs::read_to_string(path).unwrap(), "t").unwrap();
        let plan = expand(&cell, &[(PoseKind::HandEye, trajectory)]).unwrap();
        let poses = plan.poses.iter().take(12).map(|p| p.base_from_tcp).collect();
        Self { cell, poses }
    }

    /// Where every corner is seen, px, for these numbers; written without anything that the prediction uses.
    fn pixels(&self, x: &DVector<f64>) -> Vec<f64> {
        let Mount::Target { base_from_camera, tcp_from_target } = self.cell.nominal.mount else {
            panic!("not carried")
        };
        let small = |at: usize| {
            let (t, r) = (Vector3::new(x[at], x[at + 1], x[at + 2]), Vector3::new(x[at + 3], x[at + 4], x[at + 5]));
            Isometry3::new(t, r)
        };
        let before: Pinhole = self.cell.nominal_camera(Camera::Event).unwrap();
        let mut lens = before;
        lens.fx += x[0];
        lens.fy += x[1];
        lens.cx += x[2];
        lens.cy += x[3];
        lens.distortion = [x[4], x[5], x[6], x[7], 0.0];
        let base_from_camera = base_from_camera.iso() * small(8);
        let tcp_from_target = tcp_from_target.iso() * small(14);
        let mut numbers = Vec::new();
        for (i, base_from_tcp) in self.poses.iter().enumerate() {
            let base_from_tcp = base_from_tcp.iso() * small(SHARED + 6 * i);
            let camera_from_target = base_from_camera.inverse() * base_from_tcp * tcp_from_target;
            for id in 0..self.cell.board.corner_count() as u32 {
                let corner = Point3::from(self.cell.board.corner(id).unwrap().coords_m());
                numbers.extend(lens.project(&(camera_from_target * corner)).unwrap());
            }
        }
        numbers
    }

    /// Steps that are small against the accuracy and large against rounding.
    fn jacobian(&self, size: usize) -> DMatrix<f64> {
        let steps = |k: usize| if k < 4 { 1e-2 } else { 1e-6 };
        let column = |k: usize| {
            let end = |by: f64| {
                let mut x = DVector::zeros(size);
                x[k] = by;
                self.pixels(&x)
            };
            let (back, forth) = (end(-steps(k)), end(steps(k)));
            DVector::from_iterator(back.len(), back.iter().zip(&forth).map(|(a, b)| (b - a) / (2.0 * steps(k))))
        };
        DMatrix::from_columns(&(0..size).map(column).collect::<Vec<_>>())
    }

    /// What least squares makes of one noisy session: the errors of the shared numbers.
    fn solved(&self, jacobian: &DMatrix<f64>, normal: &DMatrix<f64>, rng: &mut Pcg64) -> DVector<f64> {
        let size = jacobian.ncols();
        let mut truth = DVector::zeros(size);
        for k in SHARED..size {
            truth[k] = ROBOT_SIGMA[(k - SHARED) % 6] * rng.sample::<f64, _>(StandardNormal);
        }
        let seen = self.pixels(&truth).into_iter().map(|v| v + CORNER_SIGMA_PX * rng.sample::<f64, _>(StandardNormal));
        let seen = DVector::from_iterator(jacobian.nrows(), seen);
        let cholesky = normal.clone().cholesky().unwrap();
        let mut x = DVector::zeros(size);
        // With the derivative at the truth the steps shrink by the size of the errors: four end far below them.
        for _ in 0..4 {
            let left = &seen - DVector::from_vec(self.pixels(&x));
            let mut right = jacobian.transpose() * left / CORNER_SIGMA_PX.powi(2);
            for k in SHARED..size {
                right[k] -= x[k] / ROBOT_SIGMA[(k - SHARED) % 6].powi(2);
            }
            x += cholesky.solve(&right);
        }
        x.rows(0, SHARED).into_owned()
    }
}

#[test]
fn the_predicted_errors_are_those_of_many_simulated_solves() {
    let session = Session::new();
    let size = SHARED + 6 * session.poses.len();
    let jacobian = session.jacobian(size);
    let mut normal = jacobian.transpose() * &jacobian / CORNER_SIGMA_PX.powi(2);
    for k in SHARED..size {
        normal[(k, k)] += ROBOT_SIGMA[(k - SHARED) % 6].powi(-2);
    }
    let runs = 300;
    let mut rng = Pcg64::seed_from_u64(17);
    let errors: Vec<_> = (0..runs).map(|_| session.solved(&jacobian, &normal, &mut rng)).collect();

    let model = Model::of(&session.cell);
    let told = |sum, pose: &Transform<Base, Tcp>| sum + model.sight(*pose, true).information;
    let sum = session.poses.iter().fold(DMatrix::identity(SHARED, SHARED), told);
    let depths_m = [0.27, 0.33];
    let predicted = Wanted::of(&model, depths_m).accuracy(&sum).unwrap();
    assert_eq!((predicted.stereo_m, predicted.stereo_rad), (None, None));

    // The sigma of n runs is known to 1 / sqrt(2 n); four times that is missed once in 16,000 tries.
    let tolerance = 4.0 / (2.0 * f64::from(runs)).sqrt();
    let rms = |at: usize| (errors.iter().map(|e| e.rows(at, 3).norm_squared()).sum::<f64>() / f64::from(runs)).sqrt();
    for (what, found, wanted) in [("m", rms(8), predicted.camera_m), ("rad", rms(11), predicted.camera_rad)] {
        assert!((found / wanted - 1.0).abs() < tolerance, "{what}: {found:e} in {runs} runs, predicted {wanted:e}");
    }
    // At the worst corner 95 % of the runs stay within the predicted error, at all others as many or more.
    let corners = predict::workspace(&model.nominal, depths_m);
    let within = |corner: &Vector3<f64>| {
        let off = |e: &DVector<f64>| Vector3::new(e[8], e[9], e[10]) + Vector3::new(e[11], e[12], e[13]).cross(corner);
        errors.iter().filter(|e| off(e).norm() <= predicted.workspace_95_m).count() as f64 / f64::from(runs)
    };
    let shares: Vec<f64> = corners.iter().map(within).collect();
    let worst = shares.iter().copied().fold(1.0, f64::min);
    assert!((worst - 0.95).abs() < 4.0 * (0.95 * 0.05 / f64::from(runs)).sqrt(), "{shares:?}");
}

#[test]
fn ninety_five_percent_are_that() {
    let mut rng = Pcg64::seed_from_u64(3);
    for sigma in [[1.0, 1.0, 1.0], [1.0, 1.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.5, 0.2], [3.0, 0.1, 1.0]] {
        let covariance = nalgebra::Matrix3::from_diagonal(&Vector3::from(sigma).map(|s| s * s));
        let radius = predict::radius_95(&covariance);
        let n = 40_000;
        let lengths = (0..n).map(|_| sigma.map(|s| s * rng.sample::<f64, _>(StandardNormal)));
        let inside = lengths.filter(|v| Vector3::from(*v).norm() <= radius).count();
        // The radius may be 2 % off, which is 0.6 % of the draws; the rest is chance.
        let share = inside as f64 / f64::from(n);
        assert!((share - 0.95).abs() < 0.006 + 4.0 * (0.95 * 0.05 / f64::from(n)).sqrt(), "{sigma:?}: {share}");
    }
}

#[test]
fn a_pose_without_the_robot_tells_nothing_about_hand_eye() {
    let session = Session::new();
    let model = Model::of(&session.cell);
    let free = model.sight(session.poses[0], false).information;
    let tied = model.sight(session.poses[0], true).information;
    // The last twelve unknowns are the places of camera and target.
    let of = |m: &DMatrix<f64>| m.view((8, 8), (12, 12)).norm();
    assert!(of(&free) < 1e-6 * of(&tied), "{:e} {:e}", of(&free), of(&tied));
    assert!(free.view((0, 0), (8, 8)).norm() > 0.0);
}

#[test]
fn a_proposal_beats_the_cells_own_poses_in_less_time() {
    let cell = cell("sim.yaml");
    let arm = Arm::ur5e();
    let found = propose(&cell, &arm, &wish(), &quiet).unwrap_or_else(|e| panic!("{e}"));
    // The same seed gives the same tour.
    assert_eq!(propose(&cell, &arm, &wish(), &quiet).as_ref(), Ok(&found));
    let text = tour_yaml("tour", cell.reference_camera(), &found.parts, &["by hand".into()]);
    let tour = parse_trajectory(&text, "tour.yaml").unwrap_or_else(|e| panic!("{e}\n{text}"));
    let plan = expand(&cell, &[(PoseKind::Intrinsics, tour)]).unwrap_or_else(|e| panic!("{e}\n{text}"));
    assert!(plan.poses.len() <= 20 && plan.duration_s <= 60.0, "{} {}", plan.poses.len(), plan.duration_s);
    assert!((plan.duration_s - found.duration_s).abs() < 0.05, "{} {}", plan.duration_s, found.duration_s);
    // What is written gives the poses that were judged.
    let again = accuracy(&cell, &plan, found.depths_m).unwrap();
    assert!(
        (again.workspace_95_m / found.accuracy.workspace_95_m - 1.0).abs() < 1e-6,
        "{again:?} {:?}",
        found.accuracy
    );
    let own = |file: &str, kind| {
        let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("trajectories").join(file);
        (kind, parse_trajectory(&std::fs::read_to_string(path).unwrap(), file).unwrap())
    };
    let own = [
        own("paper-39.yaml", PoseKind::Intrinsics),
        own("hand-eye-22.yaml", PoseKind::HandEye),
        own("distance-6.yaml", PoseKind::Distance),
    ];
    let own = expand(&cell, &own).unwrap();
    let theirs = accuracy(&cell, &own, found.depths_m).unwrap();
    eprintln!("{:.1} s {again:?}\n{:.1} s {theirs:?}", plan.duration_s, own.duration_s);
    assert!(again.workspace_95_m < theirs.workspace_95_m && again.camera_rad < theirs.camera_rad);
    assert!(again.stereo_m < theirs.stereo_m && again.stereo_rad < theirs.stereo_rad);
    assert!(plan.duration_s < own.duration_s, "{} {}", plan.duration_s, own.duration_s);
    // It serves every purpose.
    let of = |kind| plan.poses.iter().filter(|p| p.kind == kind).count();
    assert!(of(PoseKind::HandEye) >= 8 && of(PoseKind::Distance) == 4, "{text}");
    let for_arm: Vec<_> = plan.poses.iter().filter(|p| p.kind == PoseKind::HandEye).map(|p| p.base_from_tcp).collect();
    crate::calibration::observability::carried_target(&for_arm).unwrap().check().unwrap();
    for seen in coverage(&cell, &plan) {
        assert_eq!(seen.advice(), Vec::<String>::new(), "{}", seen.summary());
    }
}

#[test]
fn what_cannot_be_planned_is_refused_in_words() {
    let arm = Arm::ur5e();
    let error = propose(&cell("handheld.yaml"), &arm, &wish(), &quiet).unwrap_err();
    assert!(error.to_string().starts_with("the cell has `robot: none`"), "{error}");
    let sim = cell("sim.yaml");
    let error = propose(&sim, &arm, &Wish { poses: 5, ..wish() }, &quiet).unwrap_err();
    assert_eq!(error, ProposeError::FewPoses { found: 5 });
    let error = propose(&sim, &arm, &Wish { depths_m: Some([3.0, 4.0]), ..wish() }, &quiet).unwrap_err();
    assert!(matches!(error, ProposeError::FewViews { .. }) && error.to_string().contains("--depth-mm"), "{error}");
}

#[test]
fn a_cell_without_nominal_places_is_refused_where_it_is_read() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("cells/sim.yaml");
    let text = std::fs::read_to_string(path).unwrap();
    let without: String = text.lines().filter(|l| !l.contains("event_from_rgb")).map(|l| format!("{l}\n")).collect();
    let error = config::parse_cell(&without, "sim.yaml").unwrap_err().to_string();
    assert!(error.contains("a cell with two cameras needs it"), "{error}");
}

#[test]
fn carried_cameras_are_planned_for_too() {
    let cell = cell("sim-rig.yaml");
    let found = propose(&cell, &Arm::ur5e(), &Wish { poses: 14, ..wish() }, &quiet).unwrap_or_else(|e| panic!("{e}"));
    let text = tour_yaml("tour", cell.reference_camera(), &found.parts, &[]);
    let tour = parse_trajectory(&text, "tour.yaml").unwrap_or_else(|e| panic!("{e}\n{text}"));
    let plan = expand(&cell, &[(PoseKind::HandEye, tour)]).unwrap_or_else(|e| panic!("{e}\n{text}"));
    let for_arm: Vec<_> = plan.poses.iter().filter(|p| p.kind == PoseKind::HandEye).map(|p| p.base_from_tcp).collect();
    crate::calibration::observability::carried_cameras(&for_arm).unwrap().check().unwrap();
    assert!(found.accuracy.workspace_95_m > 0.0 && found.accuracy.workspace_95_m < 0.01, "{:?}", found.accuracy);
}
