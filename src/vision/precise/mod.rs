//! Corners to a few hundredths of a pixel, each with its covariance: a saddle fitted along the edges that meet in it.
//!
//! The same for both cameras: in a frame black squares are dark, in an event image they are what fired. Corners that
//! the markers did not give are looked for where the plane of the others puts them. A corner counts because the fit
//! says so, never because it was expected. Uses `board` and `image`; start at [`frame_corners`] and [`event_corners`].

mod fit;
mod model;
mod patch;
#[cfg(test)]
mod tests;

use nalgebra::{Matrix2, SymmetricEigen};

use super::plane::BoardInImage;
use crate::board::{Board, Corner, View};
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
/// Rounds of looking where the corners found so far put the missing ones.
const ROUNDS: usize = 2;

/// Refines the corners of a frame and looks for those that are missing.
pub fn frame_corners(board: &Board, image: &GrayImage, start: &View) -> View {
    corners(board, &image.into(), start, Light::Frame)
}

/// The same for an event image: how many of the display's transitions each pixel answered.
pub fn event_corners(board: &Board, answered: &FloatImage, start: &View) -> View {
    corners(board, answered, start, Light::Events)
}

fn corners(board: &Board, image: &FloatImage, start: &View, light: Light) -> View {
    let mut found = View::default();
    let mut seen = start.clone();
    for _ in 0..ROUNDS {
        let Some(plane) = BoardInImage::find(board, &seen) else { break };
        let missing = (0..board.corner_count() as u32).filter(|id| found.px(*id).is_none());
        let better = missing.filter_map(|id| {
            let local = local(board, &plane, id, start.px(id))?;
            let fit = fit(image, &local, mask(board, id), light)?;
            accepted(&fit, &local, light).then(|| Corner { covariance_px2: Some(fit.covariance_px2), ..Corner::at(id, fit.px) })
        });
        let all = found.corners.iter().copied().chain(better.collect::<Vec<_>>()).collect();
        found = View::new(all);
        seen = found.clone();
    }
    found
}

/// How the board lies around a corner that was seen at `seen_px`, or is where the plane puts it.
fn local(board: &Board, plane: &BoardInImage, id: u32, seen_px: Option<[f64; 2]>) -> Option<Local> {
    let [x, y, _] = board.corner(id)?.xyz_m().map(|m| m / board.square_m);
    let between = |a: [f64; 2], b: [f64; 2]| [b[0] - a[0], b[1] - a[1]];
    Some(Local {
        at_px: seen_px.unwrap_or_else(|| plane.px([x, y])),
        along_x_px: between(plane.px([x - 0.5, y]), plane.px([x + 0.5, y])),
        along_y_px: between(plane.px([x, y - 0.5]), plane.px([x, y + 0.5])),
    })
}

fn mask(board: &Board, id: u32) -> Mask {
    let columns = board.squares_x - 1;
    Mask {
        marker_margin: 0.5 * (1.0 - board.marker_m / board.square_m),
        // The first square of the board is black.
        diagonal_is_black: (id / columns + id % columns) % 2 == 0,
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
