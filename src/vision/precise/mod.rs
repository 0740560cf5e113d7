//! Corners to a few hundredths of a pixel, each with its covariance: a saddle fitted along the edges that meet in it.
//!
//! The same for both cameras: in a frame black squares are dark, in an event image they are what fired. The markers
//! only say where to look, and corners between markers that were missed are looked for as well. A corner
//! counts because the fit says so, never because it was expected. Uses `board`, `cv` and `image`; start at
//! [`frame_view`] and [`event_view`].

mod fit;
mod model;
mod patch;

use nalgebra::{Matrix2, SymmetricEigen};

use super::plane::BoardInImage;
use crate::board::{Board, Corner, View};
use crate::cv::CvError;
use crate::cv::charuco::{self, Look, MarkerCorner};
use crate::image::{FloatImage, GrayImage};
use fit::{Fit, Light, fit};
use patch::{Local, Mask};

/// Farther from its start than this share of a square a fit has found something else; and at least so many px.
const MOVED_SQUARES: f64 = 0.08;
const MOVED_PX: f64 = 3.0;
/// Edges that turn by more are others.
const TURNED_RAD: f64 = 0.12;
/// Two black squares that differ by more than this factor are not of one display.
const STEP_RATIO: f64 = 2.5;
/// Largest RMS of the residuals of one arm as a share of the step between black and white. In an event image pixels
/// fire or do not: next to an edge the residual is up to half a step.
const FRAME_ARM_RMS: f64 = 0.16;
const EVENT_ARM_RMS: f64 = 0.42;
/// Largest standard deviation of a corner, px, along its worse axis.
const FRAME_SIGMA_PX: f64 = 0.3;
const EVENT_SIGMA_PX: f64 = 0.5;
/// Erosion beyond this is no edge of a square, px.
const EROSION_PX: f64 = 4.5;
/// Smallest step of a frame, gray levels; and of an event image, transitions that a pixel answers.
const FRAME_STEP: f64 = 6.0;
const EVENT_STEP: f64 = 0.2;
/// A pixel that answered so much less than the board does is noise.
const ANSWERED: f32 = 0.4;
/// A board that is worth a look covers at least one in so many pixels.
const BOARD_SHARE: usize = 200;
/// A marker farther from the plane of all, squares, is a false one: lenses bend large boards by less.
const OFF_PLANE_SQUARES: f64 = 0.15;
/// Points so near share what the plane leaves over, squares.
const NEAR_SQUARES: f64 = 1.25;
/// Rounds of looking where the corners found so far put the missing ones.
const ROUNDS: usize = 2;

/// Finds the corners in an image of the frame camera.
pub fn frame_view(board: &Board, image: &GrayImage) -> Result<View, CvError> {
    let markers = markers(board, image, Look::Frame)?;
    Ok(corners(board, &image.into(), markers, Light::Frame))
}

/// Finds the corners in what each pixel of the event camera answered to the display's transitions.
pub fn event_view(board: &Board, answered: &FloatImage) -> Result<View, CvError> {
    let markers = markers(board, &charuco::median_3x3(&dark(answered))?, Look::Events)?;
    Ok(corners(board, answered, markers, Light::Events))
}

/// Black where a pixel answered at least two fifths of what the board answers.
fn dark(answered: &FloatImage) -> GrayImage {
    let mut values = answered.values.clone();
    // So many pixels answer more often than hot ones are many.
    let rank = values.len() / BOARD_SHARE;
    let usual = if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(rank, |a, b| b.total_cmp(a)).1 };
    let limit = (ANSWERED * usual).max(f32::MIN_POSITIVE);
    let pixels = answered.values.iter().map(|v| if *v >= limit { 0 } else { 255 }).collect();
    GrayImage { width: answered.width, height: answered.height, pixels }
}

/// Points of the board, squares, and where they are in the image, px.
type Pairs = Vec<([f64; 2], [f64; 2])>;

/// Corners of markers that lie on one plane; of the negative where the image itself has none.
fn markers(board: &Board, image: &GrayImage, look: Look) -> Result<Pairs, CvError> {
    let found = charuco::find_markers(board, image, look)?;
    let found = if found.is_empty() { charuco::find_markers(board, &image.inverted(), look)? } else { found };
    Ok(on_one_plane(board, found))
}

/// Leaves out, one by one, the marker that fits the plane of all worst.
fn on_one_plane(board: &Board, mut found: Vec<MarkerCorner>) -> Pairs {
    loop {
        let pairs: Pairs = found.iter().map(|c| (c.square, c.px)).collect();
        let Some(plane) = BoardInImage::through(board, &pairs) else { return Pairs::new() };
        let off = |c: &MarkerCorner| {
            let [u, v] = plane.px(c.square);
            (c.px[0] - u).hypot(c.px[1] - v) / square_px(&plane, c.square)
        };
        let worst = found.iter().map(|c| (off(c), c.marker)).max_by(|a, b| a.0.total_cmp(&b.0));
        let Some((off, marker)) = worst else { return pairs };
        let all_fit = off <= OFF_PLANE_SQUARES;
        if all_fit {
            return pairs;
        }
        found.retain(|c| c.marker != marker);
    }
}

/// Mean side of a square about a point of the board, px.
fn square_px(plane: &BoardInImage, [x, y]: [f64; 2]) -> f64 {
    let far = |a: [f64; 2], b: [f64; 2]| (b[0] - a[0]).hypot(b[1] - a[1]);
    0.5 * (far(plane.px([x - 0.5, y]), plane.px([x + 0.5, y])) + far(plane.px([x, y - 0.5]), plane.px([x, y + 0.5])))
}

fn corners(board: &Board, image: &FloatImage, mut seen: Pairs, light: Light) -> View {
    let mut found = View::default();
    for _ in 0..ROUNDS {
        let Some(plane) = BoardInImage::through(board, &seen) else { break };
        let missing = (0..board.corner_count() as u32).filter(|id| found.px(*id).is_none());
        let better = missing.filter_map(|id| {
            let local = local(board, &plane, &seen, id)?;
            let fit = fit(image, &local, mask(board, id), light)?;
            let corner = Corner { covariance_px2: Some(fit.covariance_px2), ..Corner::at(id, fit.px) };
            accepted(&fit, &local, light).then_some(corner)
        });
        let before = found.corners.len();
        found = View::new(found.corners.iter().copied().chain(better.collect::<Vec<_>>()).collect());
        if found.corners.len() == before || found.corners.len() == board.corner_count() {
            break;
        }
        seen = found.corners.iter().filter_map(|c| Some((square(board, c.id)?, c.px))).collect();
    }
    found
}

/// Where a corner is on the board, squares.
fn square(board: &Board, id: u32) -> Option<[f64; 2]> {
    let [x, y, _] = board.corner(id)?.xyz_m().map(|m| m / board.square_m);
    Some([x, y])
}

/// How the board lies around a corner: where the plane puts it, and as far off as the points next to it are.
fn local(board: &Board, plane: &BoardInImage, seen: &Pairs, id: u32) -> Option<Local> {
    let [x, y] = square(board, id)?;
    let between = |a: [f64; 2], b: [f64; 2]| [b[0] - a[0], b[1] - a[1]];
    let (mut off_px, mut count) = ([0.0; 2], 0.0);
    for (at, px) in seen.iter().filter(|(at, _)| (at[0] - x).abs() < NEAR_SQUARES && (at[1] - y).abs() < NEAR_SQUARES) {
        let expected = plane.px(*at);
        off_px = [off_px[0] + px[0] - expected[0], off_px[1] + px[1] - expected[1]];
        count += 1.0;
    }
    let [u, v] = plane.px([x, y]);
    let share = if count > 0.0 { 1.0 / count } else { 0.0 };
    Some(Local {
        at_px: [u + share * off_px[0], v + share * off_px[1]],
        along_x_px: between(plane.px([x - 0.5, y]), plane.px([x + 0.5, y])),
        along_y_px: between(plane.px([x, y - 0.5]), plane.px([x, y + 0.5])),
    })
}

fn mask(board: &Board, id: u32) -> Mask {
    let columns = board.squares_x - 1;
    Mask {
        marker_margin: 0.5 * (1.0 - board.marker_m / board.square_m),
        // The first square of the board is black.
        diagonal_is_black: (id / columns + id % columns).is_multiple_of(2),
    }
}

/// Whether a fit is a corner of the board.
fn accepted(fit: &Fit, local: &Local, light: Light) -> bool {
    let (arm_rms, sigma_px, step) = match light {
        Light::Frame => (FRAME_ARM_RMS, FRAME_SIGMA_PX, -FRAME_STEP),
        Light::Events => (EVENT_ARM_RMS, EVENT_SIGMA_PX, EVENT_STEP),
    };
    let square_px = local.along_x_px[0].hypot(local.along_x_px[1]).min(local.along_y_px[0].hypot(local.along_y_px[1]));
    let [small, large] = {
        let [a, b] = fit.steps.map(|s| s * step.signum());
        [a.min(b), a.max(b)]
    };
    let [xx, xy, yy] = fit.covariance_px2;
    let worst = SymmetricEigen::new(Matrix2::new(xx, xy, xy, yy)).eigenvalues.max();
    fit.moved_px <= (MOVED_SQUARES * square_px).max(MOVED_PX)
        && fit.turned_rad <= TURNED_RAD
        && small >= step.abs()
        && large <= STEP_RATIO * small
        && fit.erosion_px.abs() <= EROSION_PX
        && fit.blur_px <= 0.1 * square_px
        && fit.arm_rms.iter().all(|rms| *rms <= arm_rms)
        && worst > 0.0
        && worst.sqrt() <= sigma_px
}
