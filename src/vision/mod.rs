//! From images and event windows to views, for both cameras.
//!
//! Uses `board`, `cv`, `events`, `image`. Start at [`frame_view`] and [`event_view`]; [`aids`] tell people who mount
//! cameras what to turn.

pub mod aids;
mod plane;
pub mod precise;

use crate::board::{Board, Corner, View};
use crate::cv::{
    CvError,
    charuco::{self, Look},
};
use crate::image::GrayImage;

/// The corners in an image of the frame camera.
pub fn frame_view(board: &Board, image: &GrayImage) -> Result<View, CvError> {
    or_negative(board, image, Look::Frame)
}

/// The corners in an event image by the paper's method: median 3x3, then as in a frame.
///
/// The image has pixels that fired dark on light, so it has the polarity of the board: white cells do
/// not change and stay silent.
pub fn event_view(board: &Board, image: &GrayImage) -> Result<View, CvError> {
    or_negative(board, &charuco::median_3x3(image)?, Look::Events)
}

/// Tries again on the negative where nothing is found.
fn or_negative(board: &Board, image: &GrayImage, look: Look) -> Result<View, CvError> {
    let view = charuco::find_corners(board, image, look)?;
    if view.corners.is_empty() { charuco::find_corners(board, &image.inverted(), look) } else { Ok(view) }
}

/// One view of several images of the same pose: the mean of each corner that at least half of them show.
///
/// Images without any corner have no say; positions that do not agree within 2 px are no corner.
pub fn fuse(views: &[View]) -> View {
    let views: Vec<&View> = views.iter().filter(|v| !v.corners.is_empty()).collect();
    let mut all: Vec<Corner> = views.iter().flat_map(|v| v.corners.iter().copied()).collect();
    all.sort_by_key(|c| c.id);
    let corners = all.chunk_by(|a, b| a.id == b.id).filter(|seen| 2 * seen.len() >= views.len());
    View { corners: corners.filter_map(mean).collect() }
}

/// Mean of the positions of one corner within 1 px of their median; `None` where fewer than half are.
fn mean(seen: &[Corner]) -> Option<Corner> {
    let median = [0, 1].map(|axis| median(seen.iter().map(|c| c.px[axis]).collect()));
    let near = |c: &&Corner| (c.px[0] - median[0]).hypot(c.px[1] - median[1]) <= 1.0;
    let (mut sum, mut count) = ([0.0; 2], 0_u32);
    for corner in seen.iter().filter(near) {
        sum = [sum[0] + corner.px[0], sum[1] + corner.px[1]];
        count += 1;
    }
    let agreed = 2 * count as usize >= seen.len() && count > 0;
    // Not divided by the number of images: what pixels do wrong they do wrong in every image.
    let covariances: Option<Vec<[f64; 3]>> = seen.iter().filter(near).map(|c| c.covariance_px2).collect();
    let covariance_px2 =
        covariances.map(|all| [0, 1, 2].map(|i| all.iter().map(|c| c[i]).sum::<f64>() / f64::from(count)));
    agreed.then(|| Corner { covariance_px2, ..Corner::at(seen[0].id, sum.map(|s| s / f64::from(count))) })
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    if values.len() % 2 == 1 { values[middle] } else { 0.5 * (values[middle - 1] + values[middle]) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(corners: &[(u32, f64)]) -> View {
        View::new(corners.iter().map(|(id, x)| Corner::at(*id, [*x, 2.0 * x])).collect())
    }

    #[test]
    fn images_of_one_pose_are_averaged_and_strays_left_out() {
        let fused = fuse(&[view(&[(1, 10.0), (2, 20.0)]), view(&[(1, 10.2), (3, 5.0)]), view(&[(1, 14.0), (2, 20.2)])]);
        let ids: Vec<_> = fused.corners.iter().map(|c| c.id).collect();
        assert_eq!(ids, [1, 2]);
        assert!((fused.px(1).unwrap()[0] - 10.1).abs() < 1e-12);
        assert!((fused.px(2).unwrap()[1] - 40.2).abs() < 1e-12);
    }

    #[test]
    fn one_failed_window_of_two_takes_nothing_away() {
        let good = view(&[(1, 10.0), (2, 20.0)]);
        assert_eq!(fuse(&[View::default(), good.clone()]), good);
        assert_eq!(fuse(&[view(&[(1, 10.0)]), good.clone()]), good);
        assert!(fuse(&[view(&[(1, 10.0)]), view(&[(1, 15.0)])]).corners.is_empty(), "two that disagree are no corner");
    }

    #[test]
    fn one_image_stays_as_it_is() {
        let only = view(&[(4, 1.25), (7, 3.5)]);
        assert_eq!(fuse(std::slice::from_ref(&only)), only);
        assert!(fuse(&[]).corners.is_empty());
    }
}
