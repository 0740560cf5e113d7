//! Markers and boards as OpenCV since 4.7 has them, in its own module: Debian 13.

use opencv::core::{Mat, Point2f, Size, Vector};
use opencv::objdetect::{
    self, ArucoDetector, CharucoBoard, CharucoDetector, CharucoParameters, DetectorParameters, RefineParameters,
};
use opencv::prelude::*;

use super::{MIN_MARKER_DISTANCE_RATE, Narrowed};
use crate::board::Board;

/// Markers of one kind, by OpenCV's number.
pub(super) struct Dictionary(objdetect::Dictionary);

impl Dictionary {
    pub(super) fn numbered(number: i32) -> opencv::Result<Self> {
        Ok(Self(objdetect::get_predefined_dictionary_i32(number)?))
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
        objdetect::generate_image_marker(&self.0, id, side_px, &mut image, 1)?;
        Ok(image)
    }

    /// The whole board without a margin.
    pub(super) fn draw_board(&self, board: &Board, size: Size) -> opencv::Result<Mat> {
        let mut image = Mat::default();
        self.charuco(board)?.generate_image(size, &mut image, 0, 1)?;
        Ok(image)
    }

    /// Corners and their ids, as near as markers give them; none without a marker.
    pub(super) fn find(
        &self,
        board: &Board,
        image: &Mat,
        narrowed: Option<Narrowed>,
    ) -> opencv::Result<(Vector<Point2f>, Vector<i32>)> {
        let parameters = parameters(narrowed)?;
        let (charuco, interpolation) = (self.charuco(board)?, CharucoParameters::default()?);
        let detector = CharucoDetector::new(&charuco, &interpolation, &parameters, RefineParameters::new_def()?)?;
        let (mut corners, mut ids) = (Vector::<Point2f>::new(), Vector::<i32>::new());
        let (mut markers, mut marker_ids) = (Vector::<Vector<Point2f>>::new(), Vector::<i32>::new());
        detector.detect_board(image, &mut corners, &mut ids, &mut markers, &mut marker_ids)?;
        Ok((corners, ids))
    }

    /// The four corners of every marker, unrefined, and their ids.
    pub(super) fn markers(
        &self,
        image: &Mat,
        narrowed: Option<Narrowed>,
    ) -> opencv::Result<(Vector<Vector<Point2f>>, Vector<i32>)> {
        let detector = ArucoDetector::new(&self.0, &parameters(narrowed)?, RefineParameters::new_def()?)?;
        let (mut markers, mut ids) = (Vector::<Vector<Point2f>>::new(), Vector::<i32>::new());
        detector.detect_markers_def(image, &mut markers, &mut ids)?;
        Ok((markers, ids))
    }

    fn charuco(&self, board: &Board) -> opencv::Result<CharucoBoard> {
        let squares = Size::new(board.squares_x as i32, board.squares_y as i32);
        CharucoBoard::new_def(squares, board.square_m as f32, board.marker_m as f32, &self.0)
    }
}

/// How markers are looked for: unrefined.
fn parameters(narrowed: Option<Narrowed>) -> opencv::Result<DetectorParameters> {
    let mut parameters = DetectorParameters::default()?;
    parameters.set_corner_refinement_method(objdetect::CornerRefineMethod::CORNER_REFINE_NONE as i32);
    parameters.set_min_marker_distance_rate(MIN_MARKER_DISTANCE_RATE);
    if let Some(Narrowed { margin_cells, cell_px }) = narrowed {
        parameters.set_perspective_remove_ignored_margin_per_cell(margin_cells);
        parameters.set_perspective_remove_pixel_per_cell(cell_px);
    }
    Ok(parameters)
}
