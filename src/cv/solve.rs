//! OpenCV's solvers: camera calibration, stereo calibration, board pose from a view.

use opencv::calib3d;
use opencv::core::{Mat, Point2f, Point3f, Size, TermCriteria, Vector};

use super::{CvError, mat};
use crate::board::{Board, View};
use crate::geometry::{Frame, Pinhole, Target, Transform};

/// OpenCV's dense solver takes seconds for 73 views where it has to end by its number of steps; these find the
/// same camera to 1e-3 px of focal length.
const MAX_ITERATIONS: i32 = 60;
/// Relative change of the parameters at which a solver has arrived.
const STEP: f64 = 1e-8;

/// A camera and the pose of the board in every view.
#[derive(Debug, Clone)]
pub struct MonoSolution<C: Frame> {
    /// The camera.
    pub camera: Pinhole,
    /// `camera_from_target` of each view, in order.
    pub camera_from_target: Vec<Transform<C, Target>>,
}

/// Where the second camera of a pair stands.
#[derive(Debug, Clone)]
pub struct StereoSolution<A: Frame, B: Frame> {
    /// Takes coordinates of the first camera to the second.
    pub second_from_first: Transform<B, A>,
    /// RMS reprojection error over the points of both cameras, px.
    pub rms_px: f64,
    /// The same for each pair of views, px.
    pub pair_rms_px: Vec<f64>,
}

/// Both planar solutions of a board pose, the better one first.
#[derive(Debug, Clone)]
pub struct BoardPose<C: Frame> {
    /// The better pose.
    pub camera_from_target: Transform<C, Target>,
    /// Its RMS reprojection error, px.
    pub rms_px: f64,
    /// RMS reprojection error of the other planar solution where there is one, px.
    pub other_rms_px: Option<f64>,
}

/// Solves a camera from views of the board; five distortion terms (Zhang 2000).
///
/// `guess` gives the image size; where `guessed` says so, its focal length and centre are the start,
/// else OpenCV starts from the homographies.
pub fn camera<C: Frame>(
    board: &Board,
    views: &[View],
    guess: &Pinhole,
    guessed: bool,
) -> Result<MonoSolution<C>, CvError> {
    let (mut objects, mut images) = (Vector::<Vector<Point3f>>::new(), Vector::<Vector<Point2f>>::new());
    for view in views {
        let (object, image) = mat::points(board, view);
        objects.push(object);
        images.push(image);
    }
    let (mut k, mut d) = (mat::camera_matrix(guess)?, mat::distortion(guess)?);
    let (mut rotations, mut translations) = (Vector::<Mat>::new(), Vector::<Mat>::new());
    let size = Size::new(guess.width as i32, guess.height as i32);
    calib3d::calibrate_camera(
        &objects,
        &images,
        size,
        &mut k,
        &mut d,
        &mut rotations,
        &mut translations,
        if guessed { calib3d::CALIB_USE_INTRINSIC_GUESS } else { 0 },
        TermCriteria::new(3, MAX_ITERATIONS, STEP)?,
    )?;
    let poses = rotations.iter().zip(translations.iter()).map(|(r, t)| mat::pose(&r, &t));
    Ok(MonoSolution { camera: mat::pinhole(&k, &d, guess)?, camera_from_target: poses.collect::<Result<_, _>>()? })
}

/// Solves `second_from_first` from pairs of views with the same corners, intrinsics fixed.
pub fn stereo<A: Frame, B: Frame>(
    board: &Board,
    pairs: &[(View, View)],
    first: &Pinhole,
    second: &Pinhole,
) -> Result<StereoSolution<A, B>, CvError> {
    let mut objects = Vector::<Vector<Point3f>>::new();
    let (mut images_1, mut images_2) = (Vector::<Vector<Point2f>>::new(), Vector::<Vector<Point2f>>::new());
    for (view_1, view_2) in pairs {
        let (object, image_1) = mat::points(board, view_1);
        objects.push(object);
        images_1.push(image_1);
        images_2.push(mat::points(board, view_2).1);
    }
    let (mut k1, mut d1) = (mat::camera_matrix(first)?, mat::distortion(first)?);
    let (mut k2, mut d2) = (mat::camera_matrix(second)?, mat::distortion(second)?);
    let (mut r, mut t, mut per_view) = (Mat::default(), Mat::default(), Mat::default());
    let rms_px = calib3d::stereo_calibrate_extended(
        &objects,
        &images_1,
        &images_2,
        &mut k1,
        &mut d1,
        &mut k2,
        &mut d2,
        Size::new(first.width as i32, first.height as i32),
        &mut r,
        &mut t,
        &mut Mat::default(),
        &mut Mat::default(),
        &mut per_view,
        calib3d::CALIB_FIX_INTRINSIC,
        TermCriteria::new(3, MAX_ITERATIONS, STEP)?,
    )?;
    // OpenCV gives the RMS of each view and camera; a pair has as many points in one as in the other.
    let both = |v: &[f64]| v.iter().map(|e| e * e / 2.0).sum::<f64>().sqrt();
    let pair_rms_px = mat::values(&per_view)?.chunks(2).map(both).collect();
    // OpenCV's R, T take the first camera's coordinates to the second's.
    Ok(StereoSolution { second_from_first: mat::pose_of_matrix(&r, &t)?, rms_px, pair_rms_px })
}

/// Board pose from one view: both planar solutions (IPPE), each refined, the better one first.
pub fn board_pose<C: Frame>(board: &Board, view: &View, camera: &Pinhole) -> Result<BoardPose<C>, CvError> {
    let (object, image) = mat::points(board, view);
    let (k, d) = (mat::camera_matrix(camera)?, mat::distortion(camera)?);
    let (mut rotations, mut translations) = (Vector::<Mat>::new(), Vector::<Mat>::new());
    calib3d::solve_pnp_generic(
        &object,
        &image,
        &k,
        &d,
        &mut rotations,
        &mut translations,
        false,
        calib3d::SolvePnPMethod::SOLVEPNP_IPPE,
        &opencv::core::no_array(),
        &opencv::core::no_array(),
        &mut opencv::core::no_array(),
    )?;
    let mut found = Vec::new();
    for (mut r, mut t) in rotations.iter().zip(translations.iter()) {
        calib3d::solve_pnp_refine_lm(&object, &image, &k, &d, &mut r, &mut t, TermCriteria::new(3, 100, 1e-12)?)?;
        let pose = mat::pose(&r, &t)?;
        found.push((rms_px(board, view, camera, &pose), pose));
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    match found.as_slice() {
        [] => Err(CvError::Unusable("the view has no board pose".into())),
        [(rms_px, pose), rest @ ..] => {
            Ok(BoardPose { camera_from_target: *pose, rms_px: *rms_px, other_rms_px: rest.first().map(|o| o.0) })
        }
    }
}

/// Board pose by EPnP (Lepetit et al. 2009): poor on planes, for reproduction only.
pub fn board_pose_epnp<C: Frame>(board: &Board, view: &View, camera: &Pinhole) -> Result<BoardPose<C>, CvError> {
    let (object, image) = mat::points(board, view);
    let (k, d) = (mat::camera_matrix(camera)?, mat::distortion(camera)?);
    let (mut r, mut t) = (Mat::default(), Mat::default());
    let epnp = calib3d::SolvePnPMethod::SOLVEPNP_EPNP as i32;
    let found = calib3d::solve_pnp(&object, &image, &k, &d, &mut r, &mut t, false, epnp)?;
    if !found {
        return Err(CvError::Unusable("the view has no board pose by EPnP".into()));
    }
    let camera_from_target = mat::pose(&r, &t)?;
    Ok(BoardPose { camera_from_target, rms_px: rms_px(board, view, camera, &camera_from_target), other_rms_px: None })
}

/// RMS reprojection error of a view: `sqrt(mean |e|^2)` over its corners, px.
pub fn rms_px<C>(board: &Board, view: &View, camera: &Pinhole, camera_from_target: &Transform<C, Target>) -> f64 {
    let (sum, count) = squared_errors_px2(board, view, camera, camera_from_target);
    (sum / count as f64).sqrt()
}

/// Sum of squared reprojection errors of a view (px2) and its number of corners.
///
/// A corner behind the camera counts as infinitely wrong.
pub fn squared_errors_px2<C>(
    board: &Board,
    view: &View,
    camera: &Pinhole,
    camera_from_target: &Transform<C, Target>,
) -> (f64, usize) {
    let squared = |corner: &crate::board::Corner| {
        let point = board.corner(corner.id).map(|p| (*camera_from_target * p).coords_m());
        let px = point.and_then(|p| camera.project(&p.into()));
        px.map_or(f64::INFINITY, |[u, v]| (corner.px[0] - u).powi(2) + (corner.px[1] - v).powi(2))
    };
    (view.corners.iter().map(squared).sum(), view.corners.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::board::Corner;
    use crate::geometry::{Event, Rgb};

    fn board() -> Board {
        Board { squares_x: 7, squares_y: 5, square_m: 0.012, marker_m: 0.0096, dictionary: "DICT_4X4_50".into() }
    }

    fn truth() -> Pinhole {
        let distortion = [-0.21, 0.3, 0.0004, -0.0003, 0.0];
        Pinhole { width: 1380, height: 780, fx: 2760.0, fy: 2768.0, cx: 700.0, cy: 380.0, distortion }
    }

    /// Boards that are tilted every way and cover the image.
    fn poses() -> Vec<Transform<Rgb, Target>> {
        let centre =
            Transform::<Target, Target>::from_parts([-0.042, -0.03, 0.0], nalgebra::UnitQuaternion::identity());
        (0..16)
            .map(|i| {
                let a = f64::from(i);
                let tilt = [0.5 * (2.1 * a).sin(), 0.5 * (1.3 * a).cos(), 0.3 * a.sin()];
                let at = [0.02 * (1.7 * a).cos(), 0.01 * (2.3 * a).sin(), 0.29 + 0.03 * (0.9 * a).sin()];
                Transform::from_parts(at, crate::geometry::rotation::from_vector(tilt)) * centre
            })
            .collect()
    }

    fn seen<C>(camera: &Pinhole, pose: &Transform<C, Target>) -> View {
        let px = |id| camera.project(&(*pose * board().corner(id).unwrap()).coords_m().into()).unwrap();
        View::new((0..24).map(|id| Corner::at(id, px(id))).collect())
    }

    #[test]
    fn a_camera_without_noise_is_recovered() {
        let views: Vec<_> = poses().iter().map(|p| seen(&truth(), p)).collect();
        let found = camera::<Rgb>(&board(), &views, &Pinhole::centred(1380, 780, 2700.0), true).unwrap();
        assert!((found.camera.fx - truth().fx).abs() < 0.05, "{:?}", found.camera);
        assert!((found.camera.cx - truth().cx).abs() < 0.05, "{:?}", found.camera);
        for (pose, true_pose) in found.camera_from_target.iter().zip(poses()) {
            assert!(pose.distance_to_m(&true_pose) < 2e-5, "{pose:?} {true_pose:?}");
        }
    }

    #[test]
    fn stereo_gives_second_from_first() {
        let event_from_rgb = Transform::<Event, Rgb>::from_pose_vector([-0.0344, 0.001, 0.002, 0.01, 0.015, -0.003]);
        let pairs: Vec<_> =
            poses().iter().map(|p| (seen(&truth(), p), seen(&truth(), &(event_from_rgb * *p)))).collect();
        let found = stereo::<Rgb, Event>(&board(), &pairs, &truth(), &truth()).unwrap();
        assert!(found.second_from_first.distance_to_m(&event_from_rgb) < 1e-6, "{found:?}");
        assert!(found.second_from_first.angle_to_rad(&event_from_rgb) < 1e-6, "{found:?}");
        assert!(found.rms_px < 1e-3 && found.pair_rms_px.len() == pairs.len());
    }

    #[test]
    fn the_planar_pose_is_found_by_ippe() {
        for pose in poses() {
            let found = board_pose::<Rgb>(&board(), &seen(&truth(), &pose), &truth()).unwrap();
            assert!(found.camera_from_target.distance_to_m(&pose) < 1e-6, "{found:?} {pose:?}");
            assert!(found.rms_px < 1e-3);
        }
    }
}
