//! A made-up session of 73 poses, as large and as uneven as real ones; nothing of it was measured.

use std::collections::BTreeMap;

use serde_json::json;

use crate::board::Board;
use crate::calibration::checks::{BaseDistance, DistanceScore, PairDistance, PoseDistance, TargetInBase, TargetToTcp};
use crate::calibration::checks::{PlaceScore, PosePlace};
use crate::calibration::gates::{Status, Verdict};
use crate::calibration::hand_eye::{HandEyeMethod, Influence, METHODS, Uncertainty, UncertaintyMethod};
use crate::calibration::kinematics::{ConstantPart, KinematicsResult, ModelMismatch, PoseMismatch};
use crate::calibration::observability::Observability;
use crate::calibration::result::{
    CalibrationResult, CameraResult, ChecksResult, HandEyeResult, PairedBy, PoseCamera, PoseResult, Provenance,
    StereoResult, Timing,
};
use crate::calibration::settings::{Gates, Method, PoseKind, Settings};
use crate::geometry::{Base, Camera, Sensor, Target, Tcp, Transform, rotation};

const TRUTH_M: f64 = 0.0678;

/// Numbers from -1 to 1 that are the same everywhere.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

fn base_from_camera() -> Transform<Base, Sensor> {
    Transform::from_pose_vector([0.1258, -0.5678, 0.3839, 1.6, -1.55, 0.62])
}

fn tcp_from_target() -> Transform<Tcp, Target> {
    Transform::from_pose_vector([-0.031, -0.022, 0.058, 0.01, -0.02, 1.57])
}

/// 39 for intrinsics, 22 for hand-eye, 12 in pairs for distances.
fn kind_of(index: usize) -> (PoseKind, String) {
    match index {
        0..39 => (PoseKind::Intrinsics, format!("grid-{:02}", index + 1)),
        39..61 => (PoseKind::HandEye, format!("orbit-{:02}", index - 38)),
        _ => {
            let pair = (index - 61) / 2;
            (PoseKind::Distance, format!("move-{}{}", pair + 1, if index % 2 == 1 { "a" } else { "b" }))
        }
    }
}

fn pose(index: usize, noise: &mut Noise) -> PoseResult {
    let (kind, pose_id) = kind_of(index);
    let spread = if kind == PoseKind::HandEye { 1.0 } else { 0.45 };
    let turn = [0.0; 3].map(|_: f64| 0.45 * spread * noise.next());
    let at = [0.05 * noise.next(), 0.035 * noise.next(), 0.31 + 0.05 * noise.next()];
    let camera_from_target =
        Transform::<Sensor, Target>::from_pose_vector([at[0], at[1], at[2], turn[0], turn[1], turn[2]]);
    let base_from_tcp = base_from_camera() * camera_from_target * tcp_from_target().inverse();
    let mut view = |typical: f64| {
        let rms_px = Some(typical * (1.0 + 0.25 * noise.next()));
        PoseCamera { corners: 24, rms_px, used: true }
    };
    let cameras = [(Camera::Rgb, view(0.142)), (Camera::Event, view(0.449))].into();
    let stationarity = json!({
        "source": "measured", "from_s": 4.0 * index as f64, "to_s": 4.0 * index as f64 + 0.5, "samples": 250,
        "max_joint_speed_rad_s": 2e-4 * (1.0 + 0.5 * noise.next()), "max_tcp_speed_m_s": 4e-5 * (1.0 + 0.5 * noise.next()),
    });
    PoseResult {
        pose_id,
        kind,
        used: true,
        reason: None,
        cameras,
        hand_eye_residual_m: (kind == PoseKind::HandEye).then(|| 0.7e-3 * (1.0 + 0.8 * noise.next())),
        base_from_tcp: Some(base_from_tcp),
        stationarity: Some(stationarity),
    }
}

fn poses(noise: &mut Noise) -> Vec<PoseResult> {
    let mut poses: Vec<_> = (0..73).map(|i| pose(i, noise)).collect();
    let outlying = poses[11].cameras.get_mut(&Camera::Event).unwrap();
    *outlying = PoseCamera { corners: 19, rms_px: Some(1.834), used: false };
    poses[11].reason = Some("event: rms 1.83 px is above 0.75 px".into());
    poses[27].cameras.get_mut(&Camera::Event).unwrap().corners = 21;
    poses[33].cameras.insert(Camera::Event, PoseCamera { corners: 3, rms_px: None, used: false });
    poses[33].reason = Some("event: 3 of 24 corners found, 6 needed".into());
    poses[37].cameras.clear();
    poses[37].used = false;
    poses[37].reason = Some("skipped: not still after 10 s; joint 4 still moved at 0.0031 rad/s (limit 0.0005)".into());
    poses[46].used = false;
    poses[46].hand_eye_residual_m = None;
    poses[46].reason =
        Some("hand-eye: outlier: 9.8 mm from where the other poses put the target (median 0.7 mm)".into());
    poses
}

fn score(distances_m: &[f64]) -> DistanceScore {
    let n = distances_m.len() as f64;
    let mean_m = distances_m.iter().sum::<f64>() / n;
    let from_mean = || distances_m.iter().map(|d| (d - mean_m).abs());
    let errors = || distances_m.iter().map(|d| (d - TRUTH_M).abs());
    DistanceScore {
        count: distances_m.len(),
        mean_m,
        sigma_m: Some((from_mean().map(|d| d * d).sum::<f64>() / (n - 1.0)).sqrt()),
        bias_m: Some(mean_m - TRUTH_M),
        mae_m: Some(errors().sum::<f64>() / n),
        max_m: Some(errors().fold(0.0, f64::max)),
        max_from_mean_m: from_mean().fold(0.0, f64::max),
    }
}

fn target_to_tcp(poses: &[PoseResult], noise: &mut Noise) -> TargetToTcp {
    let checked = poses.iter().filter(|p| p.used && p.kind != PoseKind::Intrinsics);
    let per_pose: Vec<_> = checked
        .map(|p| {
            let held_out = p.kind == PoseKind::Distance;
            let error_m = if p.pose_id == "orbit-17" { 3.1e-3 } else { 0.1e-3 + 1.4e-3 * noise.next() * noise.next() };
            let distance_m = TRUTH_M + error_m;
            let leave_one_out_m = (!held_out).then_some(TRUTH_M + 1.15 * error_m);
            PoseDistance { pose_id: p.pose_id.clone(), distance_m, error_m: Some(error_m), held_out, leave_one_out_m }
        })
        .collect();
    let all = score(&per_pose.iter().map(|p| p.distance_m).collect::<Vec<_>>());
    TargetToTcp {
        corner_id: 9,
        count: all.count,
        mean_m: all.mean_m,
        sigma_m: all.sigma_m,
        truth_m: Some(TRUTH_M),
        bias_m: all.bias_m,
        mae_m: all.mae_m,
        max_m: all.max_m,
        max_from_mean_m: all.max_from_mean_m,
        held_out: Some(score(&per_pose.iter().filter(|p| p.held_out).map(|p| p.distance_m).collect::<Vec<_>>())),
        leave_one_out: Some(score(&per_pose.iter().filter_map(|p| p.leave_one_out_m).collect::<Vec<_>>())),
        per_pose,
    }
}

fn base_distance(noise: &mut Noise) -> BaseDistance {
    let per_pair = (1..=6).map(|i| {
        let (truth_m, error_m) = (0.02 * f64::from(i), 0.6e-3 * noise.next());
        PairDistance {
            pair: format!("move-{i}"),
            pose_a: format!("move-{i}a"),
            pose_b: format!("move-{i}b"),
            distance_m: truth_m + error_m,
            truth_m,
            error_m,
            vector_error_m: Some(error_m.abs() + 0.2e-3),
            pure_translation: Some(true),
        }
    });
    let per_pair: Vec<_> = per_pair.collect();
    BaseDistance {
        count: 6,
        bias_m: 0.11e-3,
        mae_m: 0.38e-3,
        sigma_m: Some(0.41e-3),
        max_m: 0.59e-3,
        vector_mae_m: Some(0.58e-3),
        vector_max_m: Some(0.79e-3),
        per_pair,
    }
}

fn camera(camera: Camera) -> CameraResult {
    let rgb = camera == Camera::Rgb;
    CameraResult {
        width: if rgb { 1380 } else { 1280 },
        height: if rgb { 780 } else { 720 },
        fx: if rgb { 2666.913 } else { 2469.402 },
        fy: if rgb { 2667.204 } else { 2470.118 },
        cx: if rgb { 691.42 } else { 637.25 },
        cy: if rgb { 391.77 } else { 361.94 },
        distortion: if rgb {
            [-0.0521, 0.1433, 0.00021, -0.00012, -0.0874]
        } else {
            [-0.0488, 0.112, -0.00043, 0.00017, 0.021]
        },
        rms_px: if rgb { 0.1432 } else { 0.4518 },
        views_used: if rgb { 72 } else { 70 },
        views_rejected: if rgb { 0 } else { 2 },
        points: if rgb { 1728 } else { 1677 },
        corner_rate: if rgb { 1.0 } else { 0.983 },
        serial: rgb.then(|| "4104128837".into()),
        lens: Some("12 mm, f/11".into()),
        adjusted: None,
    }
}

fn influence(pose_id: &str, moved_m: f64, scatter_without_m: f64) -> Influence {
    let (translation_change_m, rotation_change_rad) = (moved_m, moved_m * 2.0);
    Influence { pose_id: pose_id.into(), translation_change_m, rotation_change_rad, scatter_without_m }
}

fn hand_eye() -> HandEyeResult {
    let shifted = |(i, method): (usize, &HandEyeMethod)| {
        let i = i as f64;
        let off =
            Transform::<Sensor, Sensor>::from_pose_vector([1e-4 * i, -0.7e-4 * i, 2e-4 * i, 3e-4 * i, 0.0, -1e-4 * i]);
        (*method, serde_json::to_value(base_from_camera() * off).unwrap())
    };
    let uncertainty = Uncertainty {
        translation_sigma_m: [0.31e-3, 0.28e-3, 0.44e-3],
        rotation_sigma_rad: 0.9e-3,
        method: UncertaintyMethod::Jackknife,
        poses: 21,
        scatter_m: 0.742e-3,
        culprit: influence("orbit-17", 0.21e-3, 0.598e-3),
        most_influential: influence("orbit-03", 0.36e-3, 0.731e-3),
    };
    HandEyeResult {
        reference_camera: Camera::Event,
        method: HandEyeMethod::Tsai,
        base_from_camera: Some(base_from_camera()),
        tcp_from_target: Some(tcp_from_target()),
        tcp_from_camera: None,
        base_from_target: None,
        panel: METHODS.iter().take(4).enumerate().map(shifted).collect(),
        panel_failed: [(HandEyeMethod::Daniilidis, "Daniilidis found no finite solution for 21 pairs".into())].into(),
        panel_spread_m: Some(0.7e-3),
        uncertainty: Some(uncertainty),
        refined: None,
        scatter_rms_m: 0.742e-3,
        poses_used: 21,
        observability: Observability {
            poses: 21,
            axis_scatter: [0.47, 0.31, 0.22],
            second_eigenvalue: 0.31,
            condition: 1.21,
            largest_rotation_rad: 1.02,
            main_axis: [0.95, 0.3, 0.1],
            second_axis: [-0.31, 0.94, 0.12],
            axes_frame: "base".into(),
        },
    }
}

fn provenance() -> Provenance {
    let text =
        |pairs: &[(&str, &str)]| pairs.iter().map(|(k, v)| ((*k).into(), (*v).into())).collect::<BTreeMap<_, _>>();
    Provenance {
        opencv: "4.6.0".into(),
        board: Board {
            squares_x: 7,
            squares_y: 5,
            square_m: 0.0088,
            marker_m: 0.00704,
            dictionary: "DICT_4X4_50".into(),
        },
        board_layout: "ChArUco of OpenCV 4.6 and later (first square black)".into(),
        board_frame: "origin at the outer top-left corner, x right, y down, z into the board".into(),
        intrinsics: "solved".into(),
        settings: Settings::usual(Method::Paper),
        gates: Some(Gates {
            rgb_rms_px: Some(0.3),
            event_rms_px: Some(0.6),
            stereo_rms_px: Some(0.5),
            corner_rate: Some(0.95),
            target_to_tcp_sigma_m: Some(0.0015),
            target_to_tcp_max_m: Some(0.003),
            target_to_tcp_bias_m: Some(0.001),
            base_distance_mae_m: Some(0.002),
            base_vector_mae_m: Some(0.002),
            panel_spread_m: Some(0.003),
            kinematics_m: Some(0.01),
            kinematics_rad: None,
        }),
        facts: text(&[("recorded_by", "cellcal 0.1.0"), ("robot", "simulated UR5e over RTDE and URScript")]),
        sha256: text(&[("cell", &"0123456789abcdef".repeat(4)), ("recording", &"fedcba9876543210".repeat(4))]),
    }
}

/// A session that fails one gate, with an outlier, a skipped pose, a solver that failed and a warning.
pub(super) fn session() -> CalibrationResult {
    let mut noise = Noise(7);
    let poses = poses(&mut noise);
    let checks = ChecksResult {
        target_to_tcp: Some(target_to_tcp(&poses, &mut noise)),
        target_in_base: None,
        base_distance: Some(base_distance(&mut noise)),
    };
    CalibrationResult {
        schema_version: 1,
        program_version: "0.1.0".into(),
        session_id: "5d9a31f20c774e18".into(),
        cell: "ur5e-evk4".into(),
        verdict: Verdict {
            status: Status::Fail,
            reasons: vec!["target_to_tcp max 3.10 mm is above the gate 3.00 mm".into()],
        },
        overrides: Vec::new(),
        warnings: vec!["the event camera reported 3 triggers without an exposure".into()],
        not_computed: BTreeMap::new(),
        cameras: Camera::BOTH.into_iter().map(|c| (c, camera(c))).collect(),
        stereo: Some(StereoResult {
            event_from_rgb: Transform::from_pose_vector([0.0344, 0.0006, -0.0012, 0.004, -0.018, 0.003]),
            baseline_m: 0.034_426,
            rotation_deg: 1.0702,
            rms_px: 0.3811,
            pairs_used: 69,
            pairs_rejected: 1,
            corner_rate: 0.981,
            taken_over: false,
            sigma: None,
        }),
        hand_eye: Some(hand_eye()),
        checks,
        display_shape: None,
        uncertainty: Vec::new(),
        kinematics: Some(kinematics()),
        display: None,
        timing: Some(Timing {
            paired_by: PairedBy::Trigger,
            arrival_latency_s: Some(0.0016),
            offset_s: 12.345_678,
            drift_ppm: -3.21,
            residual_rms_s: 4.2e-6,
            windows: [216, 219],
            notes: vec!["3 exposures have no trigger".into()],
        }),
        poses,
        provenance: provenance(),
    }
}

/// The same cell with the cameras on the arm, replayed with changed settings and without gates.
pub(super) fn carried_cameras() -> CalibrationResult {
    let mut result = session();
    let hand_eye = result.hand_eye.as_mut().unwrap();
    let tcp_from_camera = Transform::<Tcp, Sensor>::from_pose_vector([0.02, -0.06, 0.05, 0.1, 0.0, 1.5]);
    hand_eye.base_from_camera = None;
    hand_eye.tcp_from_target = None;
    hand_eye.tcp_from_camera = Some(tcp_from_camera);
    hand_eye.base_from_target = Some(Transform::from_pose_vector([0.05, -0.55, 0.1, 3.1, 0.1, 0.0]));
    hand_eye.panel = [(HandEyeMethod::Tsai, serde_json::to_value(tcp_from_camera).unwrap())].into();
    let per_pose = result.checks.target_to_tcp.take().unwrap().per_pose.into_iter();
    let place = |p: PoseDistance| PosePlace {
        position_m: [0.05 + p.distance_m - TRUTH_M, -0.55, 0.1],
        error_m: (p.distance_m - TRUTH_M).abs(),
        pose_id: p.pose_id,
        held_out: p.held_out,
    };
    let score = PlaceScore { count: 12, mean_m: [0.05, -0.55, 0.1], sigma_m: Some(0.8e-3), max_m: 1.2e-3 };
    result.checks.target_in_base = Some(TargetInBase {
        corner_id: 9,
        count: 33,
        mean_m: [0.05, -0.55, 0.1],
        sigma_m: Some(0.9e-3),
        max_m: 3.1e-3,
        held_out: Some(score),
        leave_one_out: None,
        per_pose: per_pose.map(place).collect(),
    });
    result.checks.base_distance = None;
    result.provenance.gates = None;
    result.verdict = Verdict { status: Status::Inconclusive, reasons: vec!["no gates".into()] };
    result.overrides = vec!["solver.hand_eye=park".into()];
    result
}

/// Nothing but the reasons why there is nothing.
pub(super) fn nothing() -> CalibrationResult {
    let mut result = session();
    result.verdict = Verdict { status: Status::Inconclusive, reasons: vec!["no gates".into()] };
    result.cameras.clear();
    result.poses.clear();
    result.warnings.clear();
    (result.stereo, result.hand_eye, result.timing, result.provenance.gates) = (None, None, None, None);
    result.checks = ChecksResult::default();
    let reasons = [
        ("cameras.rgb", "rgb: 0 usable views, at least 4 are needed"),
        ("stereo", "both cameras are needed"),
        ("hand_eye", "its reference camera was not solved"),
    ];
    result.not_computed = reasons.into_iter().map(|(k, v)| (k.into(), v.into())).collect();
    result
}

fn kinematics() -> KinematicsResult {
    let mismatch = |max_m: f64| ModelMismatch {
        mean_m: 0.8 * max_m,
        max_m,
        mean_rad: 0.002,
        max_rad: 0.003,
        worst_pose: 1,
        per_pose: vec![
            PoseMismatch { pose: 0, position_m: 0.6 * max_m, angle_rad: 0.001 },
            PoseMismatch { pose: 1, position_m: max_m, angle_rad: 0.003 },
        ],
    };
    let transform = Transform::from_parts([0.001, -0.0005, 0.0002], rotation::from_vector([0.0, 0.0, 0.002]));
    KinematicsResult {
        controller_dh: Some(mismatch(2e-5)),
        urdf: Some(mismatch(3.4e-3)),
        urdf_from_controller: Some(ConstantPart { transform, rest_mean_m: 1.1e-3, rest_max_m: 1.6e-3 }),
        not_computed: BTreeMap::new(),
    }
}
