//! The whole solve: cameras, stereo, hand-eye, checks, gates; a problem in, a result out.
//!
//! Nothing here fails as a whole: a section that cannot be computed is absent and says why.

use std::collections::BTreeMap;

use super::adjust::{self, Adjusted, Refined};
use super::arm::{self, SolvedArm};
use super::cameras::{self, SolvedCamera, SolvedStereo};
use super::gates::{self, Measured, Status, Verdict};
use super::hand_eye::{self, EyeInHand, EyeToHand, HandEyeMethod, Pair, Solution};
use super::problem::{CameraSetup, PoseData, Problem};
use super::result::{
    CalibrationResult, CameraResult, ChecksResult, HandEyeResult, PoseCamera, PoseResult, Provenance, SCHEMA_VERSION,
    StereoResult,
};
use super::settings::{Carried, Method, PoseKind};
use super::verify::{self, AdjustedCamera};
use crate::cv;
use crate::geometry::Camera;

/// Where a problem comes from, for the provenance of its result.
#[derive(Debug, Clone, Default)]
pub struct Origin {
    /// Names the session.
    pub session_id: String,
    /// What was changed against the recorded settings.
    pub overrides: Vec<String>,
    /// Source layout, versions.
    pub facts: BTreeMap<String, String>,
    /// SHA-256 of what went in, by name.
    pub sha256: BTreeMap<String, String>,
}

/// Solves a problem.
pub fn solve(problem: &Problem, origin: Origin) -> CalibrationResult {
    let mut not_computed = BTreeMap::new();
    let cameras = solve_cameras(problem, &mut not_computed);
    let mut adjustment = Adjustment::of(problem, &cameras);
    let cameras = adjustment.all.as_ref().map_or(cameras.clone(), |a| a.cameras(&cameras));
    let stereo = stereo(problem, &adjustment, &cameras, &mut not_computed);
    let mut arm = if problem.robot_poses {
        Arm::solve(problem, &mut adjustment, &cameras, &mut not_computed)
    } else {
        Arm::default()
    };
    let poses = problem.poses.iter().enumerate().map(|(i, p)| pose_result(i, p, &cameras, &arm)).collect();
    let mut warnings = adjustment.warnings();
    warnings.append(&mut arm.warnings);
    if problem.robot_poses {
        warnings.extend(verify::missing_pairs(problem, arm.checks.base_distance.as_ref()));
    }
    let cameras = cameras.iter().map(|(c, s)| (*c, camera_result(problem, &adjustment, *c, s))).collect();
    let mut result = CalibrationResult {
        schema_version: SCHEMA_VERSION,
        program_version: env!("CARGO_PKG_VERSION").into(),
        session_id: origin.session_id,
        cell: problem.cell.clone(),
        verdict: Verdict { status: Status::Inconclusive, reasons: Vec::new() },
        overrides: origin.overrides,
        warnings,
        not_computed,
        cameras,
        stereo,
        hand_eye: arm.result,
        checks: arm.checks,
        display_shape: adjustment.all.as_ref().and_then(|a| a.shape(reference_camera(problem))),
        uncertainty: adjustment.all.as_ref().map(Adjusted::parameters).unwrap_or_default(),
        kinematics: problem.kinematics.clone(),
        timing: None,
        display: None,
        poses,
        provenance: provenance(problem, origin.facts, origin.sha256),
    };
    result.verdict = verdict(problem, &result);
    result
}

fn solve_cameras(problem: &Problem, not_computed: &mut BTreeMap<String, String>) -> BTreeMap<Camera, SolvedCamera> {
    let mut solved = BTreeMap::new();
    for (camera, setup) in &problem.cameras {
        let result = match problem.known.as_ref().and_then(|k| k.cameras.get(camera)) {
            Some(known) => Ok(cameras::judge_known_camera(problem, *camera, &known.pinhole)),
            None => first_solve(problem, *camera, setup),
        };
        match result {
            Ok(camera_solved) if camera_solved.rms_px.is_finite() => {
                solved.insert(*camera, camera_solved);
            }
            Ok(_) => {
                not_computed.insert(format!("cameras.{camera}"), "no usable view".into());
            }
            Err(why) => {
                not_computed.insert(format!("cameras.{camera}"), why);
            }
        }
    }
    solved
}

/// One camera by itself: the answer of `method: paper`, the start of `method: precise`.
fn first_solve(problem: &Problem, camera: Camera, setup: &CameraSetup) -> Result<SolvedCamera, String> {
    let within_limit = cameras::solve_camera(problem, camera, setup);
    match problem.settings.method {
        Method::Paper => within_limit,
        // The adjustment judges the views by itself.
        Method::Precise => {
            within_limit.or_else(|_| cameras::solve_camera_within(problem, camera, setup, f64::INFINITY))
        }
    }
}

/// What `method: precise` adds; nothing for `method: paper`.
#[derive(Default)]
struct Adjustment {
    all: Option<Adjusted>,
    /// What the loop of the robot gave, by the set-up.
    to_hand: Option<Result<Refined<EyeToHand>, String>>,
    in_hand: Option<Result<Refined<EyeInHand>, String>>,
}

impl Adjustment {
    fn of(problem: &Problem, cameras: &BTreeMap<Camera, SolvedCamera>) -> Self {
        if problem.settings.method == Method::Paper {
            return Self::default();
        }
        let mut all = adjust::adjust(problem, cameras);
        let (mut to_hand, mut in_hand) = (None, None);
        let wanted = problem.robot_poses && problem.settings.hand_eye == HandEyeMethod::Refined;
        if let (true, Some(reference)) = (wanted, reference_camera(problem)) {
            match problem.carried {
                Carried::Target => to_hand = all.with_robot(problem, reference),
                Carried::Cameras => in_hand = all.with_robot(problem, reference),
            }
        }
        Self { all: Some(all), to_hand, in_hand }
    }

    fn warnings(&self) -> Vec<String> {
        let mut all: Vec<String> = self.all.iter().flat_map(|a| a.warnings.clone()).collect();
        let failed = [
            self.to_hand.as_ref().and_then(|r| r.as_ref().err()),
            self.in_hand.as_ref().and_then(|r| r.as_ref().err()),
        ];
        all.extend(failed.into_iter().flatten().map(|why| format!("hand-eye: not refined: {why}")));
        all
    }
}

fn stereo(
    problem: &Problem,
    adjustment: &Adjustment,
    cameras: &BTreeMap<Camera, SolvedCamera>,
    not_computed: &mut BTreeMap<String, String>,
) -> Option<StereoResult> {
    if problem.cameras.len() < 2 {
        return None;
    }
    let adjusted = adjustment.all.as_ref().and_then(|a| a.stereo(problem));
    let (solved, sigma) = match adjusted {
        Some((pair, sigma)) => (Ok(pair), Some(sigma)),
        None => (cameras::solve_stereo(problem, cameras), None),
    };
    let known = problem.known.as_ref().and_then(|k| k.event_from_rgb);
    match solved {
        Ok(found) => {
            let SolvedStereo { event_from_rgb, rms_px, pairs_used, pairs_rejected, corner_rate } = found;
            let (event_from_rgb, rms_px) = match known {
                None => (event_from_rgb, rms_px),
                Some(known) => {
                    let Some(rms_px) = cameras::known_stereo_rms_px(problem, cameras, &known) else {
                        let why = "the transform taken over puts the board behind a camera, or no pair is usable";
                        not_computed.insert("stereo".into(), why.into());
                        return None;
                    };
                    (known, rms_px)
                }
            };
            Some(StereoResult {
                event_from_rgb,
                baseline_m: event_from_rgb.iso().translation.vector.norm(),
                rotation_deg: event_from_rgb.rotation_angle_rad().to_degrees(),
                rms_px,
                pairs_used,
                pairs_rejected,
                corner_rate,
                taken_over: known.is_some(),
                sigma: sigma.filter(|_| known.is_none()),
            })
        }
        Err(why) => {
            not_computed.insert("stereo".into(), why);
            None
        }
    }
}

/// Hand-eye and checks, whichever the set-up.
#[derive(Default)]
struct Arm {
    result: Option<HandEyeResult>,
    checks: ChecksResult,
    used: BTreeMap<usize, f64>,
    rejected: BTreeMap<usize, String>,
    warnings: Vec<String>,
}

impl Arm {
    fn solve(
        problem: &Problem,
        adjustment: &mut Adjustment,
        cameras: &BTreeMap<Camera, SolvedCamera>,
        not_computed: &mut BTreeMap<String, String>,
    ) -> Self {
        let reference = reference_camera(problem);
        let Some((camera, solved)) = reference.and_then(|c| cameras.get(&c).map(|s| (c, s))) else {
            not_computed.insert("hand_eye".into(), "its reference camera was not solved".into());
            return Self::default();
        };
        if let Err(why) = problem.settings.check_method() {
            not_computed.insert("hand_eye".into(), why);
            return Self::default();
        }
        let (to_hand, in_hand) = (adjustment.to_hand.take(), adjustment.in_hand.take());
        let adjusted = adjustment.all.as_ref().map(|a| (a, camera));
        let (pairs, missing) = adjustment
            .all
            .as_ref()
            .and_then(|a| a.pairs(problem, camera))
            .map_or_else(|| arm::pairs(problem, camera, solved), |pairs| (pairs, BTreeMap::new()));
        let solution = match problem.carried {
            Carried::Target => arm::solve::<EyeToHand>(problem, &pairs)
                .map(|s| with_refined(s, to_hand))
                .map(|s| Self::to_hand(problem, adjusted.as_ref(), camera, &pairs, s)),
            Carried::Cameras => arm::solve::<EyeInHand>(problem, &pairs)
                .map(|s| with_refined(s, in_hand))
                .map(|s| Self::in_hand(problem, adjusted.as_ref(), camera, &pairs, s)),
        };
        match solution {
            Ok(mut arm) => {
                arm.rejected.extend(missing);
                arm
            }
            Err(why) => {
                not_computed.insert("hand_eye".into(), why);
                // In a carried camera the board's own motion says nothing about distances in `base`.
                let carried = problem.carried == Carried::Target;
                let base_distance =
                    if carried { verify::distances_only(problem, adjusted.as_ref(), &pairs) } else { None };
                let checks = ChecksResult { base_distance, ..ChecksResult::default() };
                Self { checks, rejected: missing, ..Self::default() }
            }
        }
    }

    fn to_hand(
        problem: &Problem,
        adjusted: Option<&AdjustedCamera<'_>>,
        camera: Camera,
        pairs: &BTreeMap<usize, Pair>,
        solved: SolvedArm<EyeToHand>,
    ) -> Self {
        let checks = verify::to_hand(problem, adjusted, pairs, &solved);
        let EyeToHand { base_from_camera, tcp_from_target } = solved.solution;
        let panel = solved.panel.iter().filter_map(|(m, s)| Some((*m, serde_json::to_value(s.base_from_camera).ok()?)));
        let result = HandEyeResult {
            base_from_camera: Some(base_from_camera),
            tcp_from_target: Some(tcp_from_target),
            tcp_from_camera: None,
            base_from_target: None,
            ..hand_eye_result(problem, camera, &solved, panel.collect())
        };
        Self::new(result, checks, solved)
    }

    fn in_hand(
        problem: &Problem,
        adjusted: Option<&AdjustedCamera<'_>>,
        camera: Camera,
        pairs: &BTreeMap<usize, Pair>,
        solved: SolvedArm<EyeInHand>,
    ) -> Self {
        let checks = verify::in_hand(problem, adjusted, pairs, &solved);
        let EyeInHand { tcp_from_camera, base_from_target } = solved.solution;
        let panel = solved.panel.iter().filter_map(|(m, s)| Some((*m, serde_json::to_value(s.tcp_from_camera).ok()?)));
        let result = HandEyeResult {
            base_from_camera: None,
            tcp_from_target: None,
            tcp_from_camera: Some(tcp_from_camera),
            base_from_target: Some(base_from_target),
            ..hand_eye_result(problem, camera, &solved, panel.collect())
        };
        Self::new(result, checks, solved)
    }

    fn new<S>(result: HandEyeResult, checks: ChecksResult, solved: SolvedArm<S>) -> Self {
        let used = solved.residuals.iter().map(|(i, r)| (*i, r.translation_m)).collect();
        let mut warnings = Vec::new();
        if solved.uncertainty.is_none() {
            warnings.push("hand-eye: everything hangs on one pose, so its uncertainty cannot be told".into());
        }
        Self { result: Some(result), checks, used, rejected: solved.rejected, warnings }
    }
}

/// The answer of the adjustment in place of the closed form, where there is one.
fn with_refined<S>(solved: SolvedArm<S>, refined: Option<Result<Refined<S>, String>>) -> SolvedArm<S> {
    match refined {
        Some(Ok(refined)) => solved.with(refined),
        Some(Err(_)) | None => solved,
    }
}

/// The camera that the hand-eye result is for: as set, else event where present.
fn reference_camera(problem: &Problem) -> Option<Camera> {
    let declared = problem.settings.reference_camera;
    declared.or_else(|| problem.cameras.keys().copied().max())
}

fn hand_eye_result<S: Solution>(
    problem: &Problem,
    reference_camera: Camera,
    solved: &SolvedArm<S>,
    panel: BTreeMap<HandEyeMethod, serde_json::Value>,
) -> HandEyeResult {
    let squares = solved.residuals.values().map(|r| r.translation_m * r.translation_m).sum::<f64>();
    HandEyeResult {
        reference_camera,
        method: match (problem.settings.hand_eye, &solved.refined) {
            (HandEyeMethod::Refined, None) => HandEyeMethod::Tsai,
            (method, _) => method,
        },
        base_from_camera: None,
        tcp_from_target: None,
        tcp_from_camera: None,
        base_from_target: None,
        panel,
        panel_failed: solved.panel_failed.clone(),
        panel_spread_m: hand_eye::panel_spread(&solved.panel).map(|s| s.translation_m),
        uncertainty: solved.uncertainty.clone(),
        refined: solved.refined.clone(),
        scatter_rms_m: (squares / solved.residuals.len() as f64).sqrt(),
        poses_used: solved.residuals.len(),
        observability: solved.observability.clone(),
    }
}

fn camera_result(problem: &Problem, adjustment: &Adjustment, camera: Camera, solved: &SolvedCamera) -> CameraResult {
    let CameraSetup { serial, lens, .. } = problem.cameras[&camera].clone();
    let p = solved.pinhole;
    CameraResult {
        width: p.width,
        height: p.height,
        fx: p.fx,
        fy: p.fy,
        cx: p.cx,
        cy: p.cy,
        distortion: p.distortion,
        rms_px: solved.rms_px,
        views_used: solved.views_used(),
        views_rejected: solved.views_rejected(),
        points: solved.points,
        corner_rate: cameras::corner_rate(&problem.board, &problem.poses, camera).unwrap_or(0.0),
        serial,
        lens,
        adjusted: adjustment.all.as_ref().and_then(|a| a.lens(camera)),
    }
}

fn pose_result(index: usize, pose: &PoseData, cameras: &BTreeMap<Camera, SolvedCamera>, arm: &Arm) -> PoseResult {
    let mut reasons: Vec<String> = pose.skipped.iter().cloned().collect();
    let mut seen = BTreeMap::new();
    for (camera, view) in &pose.views {
        let fit = cameras.get(camera).and_then(|c| c.views.get(&index));
        reasons.extend(fit.and_then(|f| f.rejected.as_ref()).map(|why| format!("{camera}: {why}")));
        reasons.extend(fit.and_then(|f| f.note.as_ref()).map(|what| format!("{camera}: {what}")));
        let used = fit.is_some_and(|f| f.rejected.is_none());
        if !cameras.contains_key(camera) {
            reasons.push(format!("{camera}: the camera could not be solved"));
        }
        seen.insert(
            *camera,
            PoseCamera {
                corners: view.corners.len(),
                rms_px: fit.and_then(|f| f.rms_px).filter(|r| r.is_finite()),
                used,
            },
        );
    }
    if let Some(why) = arm.rejected.get(&index).filter(|why| !reasons.contains(*why)) {
        reasons.push(format!("hand-eye: {why}"));
    }
    let wanted_for_arm = pose.kind == PoseKind::HandEye && arm.result.is_some();
    let in_arm = arm.used.contains_key(&index);
    let used = if wanted_for_arm { in_arm } else { seen.values().any(|c| c.used) };
    if seen.is_empty() && reasons.is_empty() {
        reasons.push("no camera delivered a usable image".into());
    }
    PoseResult {
        pose_id: pose.id.clone(),
        kind: pose.kind,
        used,
        reason: (!reasons.is_empty()).then(|| reasons.join("; ")),
        cameras: seen,
        hand_eye_residual_m: arm.used.get(&index).copied(),
        base_from_tcp: pose.base_from_tcp,
        stationarity: pose.stillness.clone(),
    }
}

fn provenance(problem: &Problem, facts: BTreeMap<String, String>, sha256: BTreeMap<String, String>) -> Provenance {
    let intrinsics = problem.known.as_ref().map_or_else(
        || "solved".to_owned(),
        |k| format!("taken over from session {} (result SHA-256 {})", k.source_session, k.source_sha256),
    );
    Provenance {
        opencv: cv::version(),
        board: problem.board.clone(),
        board_layout: "ChArUco of OpenCV 4.6 and later (first square black)".into(),
        board_frame: "origin at the outer top-left corner, x right, y down, z into the board".into(),
        intrinsics,
        settings: problem.settings.clone(),
        gates: problem.gates.clone(),
        facts,
        sha256,
    }
}

fn verdict(problem: &Problem, result: &CalibrationResult) -> Verdict {
    let Some(limits) = &problem.gates else {
        return Verdict { status: Status::Inconclusive, reasons: vec!["no gates".into()] };
    };
    let rms = |camera| result.cameras.get(&camera).map(|c| c.rms_px);
    let target = result.checks.target_to_tcp.as_ref();
    let distance = result.checks.base_distance.as_ref();
    let rate = |camera: &Camera| (*camera, result.cameras.get(camera).map(|c| c.corner_rate));
    let measured = Measured {
        rgb_rms_px: rms(Camera::Rgb),
        event_rms_px: rms(Camera::Event),
        stereo_rms_px: result.stereo.as_ref().map(|s| s.rms_px),
        corner_rate: problem.cameras.keys().map(rate).collect(),
        target_to_tcp_sigma_m: target.and_then(|t| t.sigma_m),
        target_to_tcp_max_m: target.and_then(|t| t.max_m),
        target_to_tcp_bias_m: target.and_then(|t| t.bias_m),
        base_distance_mae_m: distance.map(|d| d.mae_m),
        base_vector_mae_m: distance.and_then(|d| d.vector_mae_m),
        panel_spread_m: result.hand_eye.as_ref().and_then(|h| h.panel_spread_m),
        kinematics_m: result.kinematics.as_ref().and_then(|k| k.max_m()),
        kinematics_rad: result.kinematics.as_ref().and_then(|k| k.max_rad()),
    };
    gates::judge(limits, &measured)
}
