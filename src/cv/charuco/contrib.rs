//! Markers and boards as OpenCV before 4.7 has them, in a contributed module: Debian 12, Ubuntu 24.04.

use opencv::aruco;
use opencv::core::{Mat, Point2f, Ptr, Size, Vector};
use opencv::prelude::*;

use super::{MIN_MARKER_DISTANCE_RATE, Narrowed};
use crate::board::Board;

/// Markers of one kind, by OpenCV's number.
pub(super) struct Dictionary(Ptr<aruco::Dictionary>);

impl Dictionary {
    pub(super) fn numbered(number: i32) -> opencv::Result<Self> {
        Ok(Self(aruco::Dictionary::get(number)?))
    }

    /// How many markers it has.
    pub(super) fn count(&self) -> i32 {
        self.0.bytes_list().rows()
    }

    /// Modules along a marker without its border.
    pub(super) fn modules(&self) -> i32 {
        self.0.marker_size()
    }

    /// A marker and its border, `side_px` pixels wide.
    pub(super) fn draw(&self, id: i32, side_px: i32) -> opencv::Result<Mat> {
        let mut image = Mat::default();
        self.0.draw_marker(id, side_px, &mut image, 1)?;
        Ok(image)
    }

    /// The whole board without a margin.
    pub(super) fn draw_board(&self, board: &Board, size: Size) -> opencv::Result<Mat> {
        let mut image = Mat::default();
        self.charuco(board)?.draw(size, &mut image, 0, 1)?;
        Ok(image)
    }

    /// Corners and their ids, as near as markers give them; none without a marker.
    pub(super) fn find(
        &self,
        board: &Board,
        image: &Mat,
        narrowed: Option<Narrowed>,
    ) -> opencv::Result<(Vector<Point2f>, Vector<i32>)> {
        let (markers, marker_ids) = self.markers(image, narrowed)?;
        let (mut corners, mut ids) = (Vector::<Point2f>::new(), Vector::<i32>::new());
        if !marker_ids.is_empty() {
            let charuco = self.charuco(board)?;
            aruco::interpolate_corners_charuco_def(&markers, &marker_ids, image, &charuco, &mut corners, &mut ids)?;
        }
        Ok((corners, ids))
    }

    /// The four corners of every marker, unrefined, and their ids.
    pub(super) fn markers(
        &self,
        image: &Mat,
        narrowed: Option<Narrowed>,
    ) -> opencv::Result<(Vector<Vector<Point2f>>, Vector<i32>)> {
        let mut parameters = aruco::DetectorParameters::create()?;
        parameters.set_corner_refinement_method(aruco::CornerRefineMethod::CORNER_REFINE_NONE as i32);
        parameters.set_min_marker_distance_rate(MIN_MARKER_DISTANCE_RATE);
        if let Some(Narrowed { margin_cells, cell_px }) = narrowed {
            parameters.set_perspective_remove_ignored_margin_per_cell(margin_cells);
            parameters.set_perspective_remove_pixel_per_cell(cell_px);
        }
        let (mut markers, mut ids) = (Vector::<Vector<Point2f>>::new(), Vector::<i32>::new());
        let mut rejected = Vector::<Vector<Point2f>>::new();
        aruco::detect_markers(image, &self.0, &mut markers, &mut ids, &parameters, &mut rejected)?;
        Ok((markers, ids))
    }

    fn charuco(&self, board: &Board) -> opencv::Result<Ptr<aruco::CharucoBoard>> {
        let (x, y) = (board.squares_x as i32, board.squares_y as i32);
        aruco::CharucoBoard::create(x, y, board.square_m as f32, board.marker_m as f32, &self.0)
    }
}
