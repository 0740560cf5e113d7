//! Each camera by itself, then the pair: the paper's procedure on OpenCV's solvers.
//!
//! RMS is `sqrt(mean over points of |e|^2)`, after rejection; for the pair over both cameras.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::problem::{CameraSetup, PoseData, Problem};
use super::settings::{Pnp, Settings};
use crate::board::{Board, View};
use crate::cv::{self, solve};
use crate::geometry::{Camera, Event, Frame, Pinhole, Rgb, Sensor, Target, Transform};

/// A camera that was solved or taken over, and how each view fits.
#[derive(Debug, Clone)]
pub struct SolvedCamera {
    /// The intrinsics.
    pub pinhole: Pinhole,
    /// RMS over the views used, px.
    pub rms_px: f64,
    /// Corners in the views used.
    pub points: usize,
    /// What became of the view of each pose, by index of the pose.
    pub views: BTreeMap<usize, ViewFit>,
}

/// How one view fits its camera.
#[derive(Debug, Clone)]
pub struct ViewFit {
    /// RMS reprojection error, px; absent where the view could not be fitted.
    pub rms_px: Option<f64>,
    /// Why the view was left out; absent where it was used.
    pub rejected: Option<String>,
    /// What of a view that was used was left out.
    pub note: Option<String>,
}

impl SolvedCamera {
    /// Number of views that were used.
    pub fn views_used(&self) -> usize {
        self.views.values().filter(|v| v.rejected.is_none()).count()
    }

    /// Number of views that were left out.
    pub fn views_rejected(&self) -> usize {
        self.views.len() - self.views_used()
    }
}

/// Where the event camera stands before the frame camera, and how each pair fits.
#[derive(Debug, Clone)]
pub struct SolvedStereo {
    /// Takes coordinates of the frame camera to the event camera.
    pub event_from_rgb: Transform<Event, Rgb>,
    /// RMS over both cameras and all pairs used, px.
    pub rms_px: f64,
    /// Pairs used.
    pub pairs_used: usize,
    /// Pairs left out for their error.
    pub pairs_rejected: usize,
    /// Corner ids seen by both cameras over all corners of all poses with both images, 0 to 1.
    pub corner_rate: f64,
}

/// Fewest views that a camera is solved from.
const MIN_VIEWS: usize = 4;

/// Share of the board's corners that were found, over all poses with an image; 0 to 1.
pub fn corner_rate(board: &Board, poses: &[PoseData], camera: Camera) -> Option<f64> {
    let counts: Vec<_> = poses.iter().filter_map(|p| p.views.get(&camera)).map(|v| v.corners.len()).collect();
    let possible = board.corner_count() * counts.len();
    (possible > 0).then(|| counts.iter().sum::<usize>() as f64 / possible as f64)
}

/// Solves one camera from all its views, drops once the views that fit badly, and solves again.
///
/// The error says in words what was missing.
pub fn solve_camera(problem: &Problem, camera: Camera, setup: &CameraSetup) -> Result<SolvedCamera, String> {
    solve_camera_within(problem, camera, setup, problem.settings.reject_view_above_px)
}

/// The same where views are dropped above another limit, px.
pub fn solve_camera_within(
    problem: &Problem,
    camera: Camera,
    setup: &CameraSetup,
    limit: f64,
) -> Result<SolvedCamera, String> {
    let (usable, mut fits) = sort_views(problem, camera);
    let views =
        |indices: &[usize]| -> Vec<View> { indices.iter().map(|i| problem.poses[*i].views[&camera].clone()).collect() };
    let first = solve_views(&problem.board, &views(&usable), camera, setup)?;
    let mut kept = Vec::new();
    for (index, rms_px) in usable.iter().zip(&first.rms_px) {
        let keep = *rms_px <= limit;
        let rejected = (!keep).then(|| format!("rms {rms_px:.2} px is above {limit} px"));
        if keep {
            kept.push(*index);
        }
        fits.insert(*index, ViewFit { rms_px: Some(*rms_px), rejected, note: None });
    }
    let last =
        if kept.len() == usable.len() { first } else { solve_views(&problem.board, &views(&kept), camera, setup)? };
    let (mut sum, mut points) = (0.0, 0);
    for (index, rms_px) in kept.iter().zip(&last.rms_px) {
        let corners = problem.poses[*index].views[&camera].corners.len();
        sum += rms_px * rms_px * corners as f64;
        points += corners;
        fits.insert(*index, ViewFit { rms_px: Some(*rms_px), rejected: None, note: None });
    }
    Ok(SolvedCamera { pinhole: last.pinhole, rms_px: (sum / points as f64).sqrt(), points, views: fits })
}

/// Takes a camera over and says how the views of this session fit it.
pub fn judge_known_camera(problem: &Problem, camera: Camera, pinhole: &Pinhole) -> SolvedCamera {
    let (usable, mut fits) = sort_views(problem, camera);
    let limit = problem.settings.reject_view_above_px;
    let (mut sum, mut points) = (0.0, 0);
    for index in usable {
        let view = &problem.poses[index].views[&camera];
        let fit = match board_pose(&problem.board, view, pinhole, problem.settings.pnp) {
            Ok(pose) if pose.rms_px <= limit => {
                sum += pose.rms_px * pose.rms_px * view.corners.len() as f64;
                points += view.corners.len();
                ViewFit { rms_px: Some(pose.rms_px), rejected: None, note: None }
            }
            Ok(pose) => {
                let rejected = format!("rms {:.2} px is above {limit} px with the intrinsics taken over", pose.rms_px);
                ViewFit { rms_px: Some(pose.rms_px), rejected: Some(rejected), note: None }
            }
            Err(error) => ViewFit { rms_px: None, rejected: Some(error.to_string()), note: None },
        };
        fits.insert(index, fit);
    }
    let rms_px = if points > 0 { (sum / points as f64).sqrt() } else { f64::NAN };
    SolvedCamera { pinhole: *pinhole, rms_px, points, views: fits }
}

/// Board pose of one view by the method that the settings name.
pub fn board_pose(
    board: &Board,
    view: &View,
    camera: &Pinhole,
    pnp: Pnp,
) -> Result<solve::BoardPose<Sensor>, cv::CvError> {
    match pnp {
        Pnp::Ippe => solve::board_pose(board, view, camera),
        Pnp::Epnp => solve::board_pose_epnp(board, view, camera),
    }
}

/// Share of the corners that both cameras saw, over all poses with both images, and the number of those with usable
/// views; `None` without any.
pub fn pair_corner_rate(problem: &Problem) -> Option<(f64, usize)> {
    let (mut common, mut possible, mut pairs) = (0, 0, 0);
    for pose in &problem.poses {
        let (Some(a), Some(b)) = (pose.views.get(&Camera::Rgb), pose.views.get(&Camera::Event)) else { continue };
        common += a.common_with(b).corners.len();
        possible += problem.board.corner_count();
        let usable = |view| usable(&problem.board, view, &problem.settings).is_ok();
        pairs += usize::from(usable(a) && usable(b));
    }
    (possible > 0).then(|| (f64::from(common as u32) / f64::from(possible as u32), pairs))
}

/// Solves the pair from the corners that both cameras saw, intrinsics fixed; drops bad pairs once.
pub fn solve_stereo(problem: &Problem, cameras: &BTreeMap<Camera, SolvedCamera>) -> Result<SolvedStereo, String> {
    let both = (cameras.get(&Camera::Rgb), cameras.get(&Camera::Event));
    let (Some(rgb), Some(event)) = both else { return Err("both cameras are needed".into()) };
    let (mut pairs, mut common, mut possible) = (Vec::new(), 0, 0);
    for (index, pose) in problem.poses.iter().enumerate() {
        let (Some(a), Some(b)) = (pose.views.get(&Camera::Rgb), pose.views.get(&Camera::Event)) else { continue };
        let pair = (a.common_with(b), b.common_with(a));
        common += pair.0.corners.len();
        possible += problem.board.corner_count();
        let used = |camera: &SolvedCamera| camera.views.get(&index).is_some_and(|v| v.rejected.is_none());
        if used(rgb) && used(event) && usable(&problem.board, &pair.0, &problem.settings).is_ok() {
            pairs.push(pair);
        }
    }
    if pairs.len() < 3 {
        return Err(format!("{} pairs of views share enough corners; at least 3 are needed", pairs.len()));
    }
    let corner_rate = f64::from(common as u32) / f64::from(possible as u32);
    let solve = |pairs: &[(View, View)]| {
        solve::stereo::<Rgb, Event>(&problem.board, pairs, &rgb.pinhole, &event.pinhole).map_err(|e| e.to_string())
    };
    let all = pairs.len();
    let mut found = solve(&pairs)?;
    let limit = problem.settings.reject_view_above_px;
    let kept: Vec<_> =
        pairs.into_iter().zip(&found.pair_rms_px).filter(|(_, rms)| **rms <= limit).map(|p| p.0).collect();
    if kept.len() < 3 {
        return Err(format!("only {} of {all} pairs fit within {limit} px; at least 3 are needed", kept.len()));
    }
    if kept.len() < all {
        found = solve(&kept)?;
    }
    let pairs_used = kept.len();
    let event_from_rgb = found.second_from_first;
    Ok(SolvedStereo { event_from_rgb, rms_px: found.rms_px, pairs_used, pairs_rejected: all - pairs_used, corner_rate })
}

/// How the pairs of this session fit a stereo transform that was taken over: RMS over both cameras, px.
///
/// Board poses come from the frame camera alone, so a camera that was moved since shows in full.
pub fn known_stereo_rms_px(
    problem: &Problem,
    cameras: &BTreeMap<Camera, SolvedCamera>,
    event_from_rgb: &Transform<Event, Rgb>,
) -> Option<f64> {
    let (rgb, event) = (cameras.get(&Camera::Rgb)?, cameras.get(&Camera::Event)?);
    let (mut squares, mut points) = (0.0, 0);
    for (index, pose) in problem.poses.iter().enumerate() {
        let used = |camera: &SolvedCamera| camera.views.get(&index).is_some_and(|v| v.rejected.is_none());
        let (Some(a), Some(b)) = (pose.views.get(&Camera::Rgb), pose.views.get(&Camera::Event)) else { continue };
        if !(used(rgb) && used(event)) {
            continue;
        }
        let Ok(found) = solve::board_pose::<Rgb>(&problem.board, a, &rgb.pinhole) else { continue };
        let event_from_target = *event_from_rgb * found.camera_from_target;
        let in_rgb = solve::squared_errors_px2(&problem.board, a, &rgb.pinhole, &found.camera_from_target);
        let in_event = solve::squared_errors_px2(&problem.board, b, &event.pinhole, &event_from_target);
        squares += in_rgb.0 + in_event.0;
        points += in_rgb.1 + in_event.1;
    }
    let rms_px = (squares / f64::from(points as u32)).sqrt();
    rms_px.is_finite().then_some(rms_px)
}

/// Whether a view can be solved from: enough corners, not on one line. The error says why not.
pub fn usable(board: &Board, view: &View, settings: &Settings) -> Result<(), String> {
    let (found, needed) = (view.corners.len(), settings.min_corners);
    if found < needed {
        return Err(format!("{found} of {} corners found, {needed} needed", board.corner_count()));
    }
    let columns = board.squares_x - 1;
    let one_row = view.corners.windows(2).all(|w| w[0].id / columns == w[1].id / columns);
    let one_column = view.corners.windows(2).all(|w| w[0].id % columns == w[1].id % columns);
    let on_one_line = one_row || one_column || on_one_diagonal(board, view);
    if on_one_line { Err("all corners found lie on one line".into()) } else { Ok(()) }
}

fn on_one_diagonal(board: &Board, view: &View) -> bool {
    let at = |i: usize| view.corners.get(i).and_then(|c| board.corner(c.id)).map(|p| p.coords_m());
    let (Some(a), Some(b)) = (at(0), at(1)) else { return true };
    let cross = |i| at(i).is_some_and(|c: nalgebra::Vector3<f64>| (b - a).cross(&(c - a)).norm() > 1e-9);
    !(2..view.corners.len()).any(cross)
}

fn sort_views(problem: &Problem, camera: Camera) -> (Vec<usize>, BTreeMap<usize, ViewFit>) {
    let (mut good, mut fits) = (Vec::new(), BTreeMap::new());
    for (index, pose) in problem.poses.iter().enumerate() {
        let Some(view) = pose.views.get(&camera) else { continue };
        match usable(&problem.board, view, &problem.settings) {
            Ok(()) => good.push(index),
            Err(why) => {
                fits.insert(index, ViewFit { rms_px: None, rejected: Some(why), note: None });
            }
        }
    }
    (good, fits)
}

struct SolvedViews {
    pinhole: Pinhole,
    rms_px: Vec<f64>,
}

fn solve_views(board: &Board, views: &[View], camera: Camera, setup: &CameraSetup) -> Result<SolvedViews, String> {
    if views.len() < MIN_VIEWS {
        return Err(format!("{camera}: {} usable views, at least {MIN_VIEWS} are needed", views.len()));
    }
    match camera {
        Camera::Rgb => solve_views_of::<Rgb>(board, views, setup),
        Camera::Event => solve_views_of::<Event>(board, views, setup),
    }
    .map_err(|error| format!("{camera}: {error}"))
}

fn solve_views_of<C: Frame>(board: &Board, views: &[View], setup: &CameraSetup) -> Result<SolvedViews, cv::CvError> {
    let guess = Pinhole::centred(setup.width, setup.height, setup.focal_px.unwrap_or(f64::from(setup.width)));
    let found = solve::camera::<C>(board, views, &guess, setup.focal_px.is_some())?;
    let poses: &[Transform<C, Target>] = &found.camera_from_target;
    let rms = |(view, pose): (&View, &Transform<C, Target>)| solve::rms_px(board, view, &found.camera, pose);
    Ok(SolvedViews { pinhole: found.camera, rms_px: views.par_iter().zip(poses).map(rms).collect() })
}
