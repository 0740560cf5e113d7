//! The ChArUco board in an image: drawing it and finding its corners.
//!
//! Markers are found by one of two modules, as this OpenCV has them; everything after that is common to both.

#[cfg(not(markers_in_objdetect))]
mod contrib;
#[cfg(markers_in_objdetect)]
mod objdetect;

#[cfg(not(markers_in_objdetect))]
use contrib::Dictionary;
#[cfg(markers_in_objdetect)]
use objdetect::Dictionary;
use opencv::core::{Mat, Point2f, Size, TermCriteria, Vector};
use opencv::prelude::*;
use opencv::{calib3d, imgproc};

use super::{CvError, mat};
use crate::board::{Board, Corner, DICTIONARIES, View};
use crate::image::GrayImage;

/// Half width of the window in which a corner of a frame is refined, pixels.
const FRAME_HALF_WINDOW_PX: i32 = 5;
/// The same in an event image as a share of a square's side: just short of the markers, which begin at 0.1.
///
/// Pixels next to an edge see too little change to fire, so black squares shrink by about 2 px and the
/// crossing is an empty gap: a window of 5 px sees hardly anything else.
const EVENT_HALF_WINDOW_SQUARES: f64 = 0.1;
/// Share of a marker cell at each border that is not looked at in an event image, for the same reason.
const EVENT_CELL_MARGIN: f64 = 0.33;
/// Pixels along a cell when an event image is read, for that margin to be some of them.
const EVENT_CELL_PX: i32 = 8;
/// Nearest two marker candidates, as a share of their perimeter.
///
/// With OpenCV's 0.05 a marker of 0.8 of its square is dropped for the outline of the white square around
/// it (their corners are 0.044 of the perimeter apart) wherever black neighbours close that outline.
const MIN_MARKER_DISTANCE_RATE: f64 = 0.02;
/// A corner farther than this from the homography of its view is a false one, pixels.
const OUTLIER_PX: f64 = 3.0;
/// The same as a share of a square's side in the image: a strong lens bends large boards away from any plane.
const OUTLIER_SQUARES: f64 = 0.08;

/// How the cells of a marker are read where their borders say nothing.
#[derive(Debug, Clone, Copy)]
struct Narrowed {
    /// Share of a cell at each border that is not looked at.
    margin_cells: f64,
    /// Pixels along a cell.
    cell_px: i32,
}

/// Checks that OpenCV has the dictionary and that it has enough markers for the board.
pub fn check_dictionary(board: &Board) -> Result<(), CvError> {
    dictionary(board).map(|_| ())
}

/// Draws the board with `px_per_square` pixels a square and no margin: black 0, white 255.
pub fn draw(board: &Board, px_per_square: u32) -> Result<GrayImage, CvError> {
    let size = [board.squares_x, board.squares_y].map(|n| i32::try_from(n * px_per_square).unwrap_or(i32::MAX));
    mat::to_gray(&dictionary(board)?.draw_board(board, Size::new(size[0], size[1]))?)
}

/// The markers of the board in the order of their ids, each with its black border, one pixel a module.
pub fn markers(board: &Board) -> Result<Vec<GrayImage>, CvError> {
    let dictionary = dictionary(board)?;
    let side_px = dictionary.modules() + 2;
    (0..markers_of(board)).map(|id| mat::to_gray(&dictionary.draw(id, side_px)?)).collect()
}

/// What kind of image is looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look {
    /// An image of a frame camera.
    Frame,
    /// Pixels that fired, dark on light.
    Events,
}

/// Finds the board's inner corners; an empty view where there are none.
///
/// Markers without refinement, corners by interpolation between markers, then our own sub-pixel
/// refinement and an outlier step: as good as OpenCV 4.14, and free of the bias of 4.6.
pub fn find_corners(board: &Board, image: &GrayImage, look: Look) -> Result<View, CvError> {
    let image = mat::from_gray(image)?;
    let (mut corners, ids) = dictionary(board)?.find(board, &image, narrowed(look))?;
    if corners.is_empty() {
        return Ok(View::default());
    }
    let corner = |(id, p): (i32, Point2f)| Corner::at(id as u32, [f64::from(p.x), f64::from(p.y)]);
    let view = |corners: &Vector<Point2f>| View::new(ids.iter().zip(corners.iter()).map(corner).collect());
    let half_px = match look {
        Look::Frame => FRAME_HALF_WINDOW_PX,
        Look::Events => (EVENT_HALF_WINDOW_SQUARES * square_px(board, &view(&corners))).clamp(5.0, 15.0) as i32,
    };
    let half = Size::new(half_px, half_px);
    let stop = TermCriteria::new(3, 50, 1e-4)?;
    imgproc::corner_sub_pix(&image, &mut corners, half, Size::new(-1, -1), stop)?;
    without_outliers(board, &view(&corners))
}

/// A corner of a marker.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MarkerCorner {
    /// Id of the marker.
    pub marker: u32,
    /// Where it is on the board, squares from the outer top-left corner.
    pub square: [f64; 2],
    /// Where it is in the image, to a pixel or so.
    pub px: [f64; 2],
}

/// The corners of every marker of the board that is in the image, four for each.
pub fn find_markers(board: &Board, image: &GrayImage, look: Look) -> Result<Vec<MarkerCorner>, CvError> {
    let image = mat::from_gray(image)?;
    let (markers, ids) = dictionary(board)?.markers(&image, narrowed(look))?;
    // Markers are counted along the white squares, row by row.
    let squares = (0..board.squares_y).flat_map(|y| (0..board.squares_x).map(move |x| [x, y]));
    let white: Vec<_> = squares.filter(|[x, y]| (x + y) % 2 == 1).map(|s| s.map(f64::from)).collect();
    let half = 0.5 * board.marker_m / board.square_m;
    let around = [[-half, -half], [half, -half], [half, half], [-half, half]];
    let mut found = Vec::new();
    for (corners, id) in markers.iter().zip(ids.iter()) {
        let Some([x, y]) = usize::try_from(id).ok().and_then(|id| white.get(id)) else { continue };
        found.extend(corners.iter().zip(around).map(|(p, [dx, dy])| MarkerCorner {
            marker: id as u32,
            square: [x + 0.5 + dx, y + 0.5 + dy],
            px: [f64::from(p.x), f64::from(p.y)],
        }));
    }
    Ok(found)
}

fn narrowed(look: Look) -> Option<Narrowed> {
    let narrowed = Narrowed { margin_cells: EVENT_CELL_MARGIN, cell_px: EVENT_CELL_PX };
    (look == Look::Events).then_some(narrowed)
}

/// Median filter over 3x3 pixels.
pub fn median_3x3(image: &GrayImage) -> Result<GrayImage, CvError> {
    let mut filtered = Mat::default();
    imgproc::median_blur(&mat::from_gray(image)?, &mut filtered, 3)?;
    mat::to_gray(&filtered)
}

/// Drops corners that no plane explains: too far from a robust homography.
fn without_outliers(board: &Board, view: &View) -> Result<View, CvError> {
    if view.corners.len() < 6 {
        return Ok(view.clone());
    }
    let (object, image) = mat::points(board, view);
    let plane: Vector<Point2f> = object.iter().map(|p| Point2f::new(p.x, p.y)).collect();
    let homography = calib3d::find_homography(&plane, &image, &mut Mat::default(), calib3d::LMEDS, OUTLIER_PX)?;
    // Where no plane explains the corners the answer is empty, and of no type.
    if homography.rows() != 3 || homography.cols() != 3 {
        return Ok(View::default());
    }
    let h = mat::values(&homography)?;
    let limit_px = OUTLIER_PX.max(OUTLIER_SQUARES * square_px(board, view));
    let near = |(corner, p): (&Corner, Point2f)| {
        let (x, y) = (f64::from(p.x), f64::from(p.y));
        let w = h[6] * x + h[7] * y + h[8];
        let (u, v) = ((h[0] * x + h[1] * y + h[2]) / w, (h[3] * x + h[4] * y + h[5]) / w);
        let keep = (corner.px[0] - u).hypot(corner.px[1] - v) <= limit_px;
        keep.then_some(*corner)
    };
    Ok(View { corners: view.corners.iter().zip(plane.iter()).filter_map(near).collect() })
}

/// Median distance of corners that are neighbours in a row, px; 0 where there are none.
fn square_px(board: &Board, view: &View) -> f64 {
    let columns = board.squares_x - 1;
    let neighbours = view.corners.windows(2).filter(|w| w[0].id + 1 == w[1].id && w[1].id % columns != 0);
    let distance = |w: &[Corner]| (w[0].px[0] - w[1].px[0]).hypot(w[0].px[1] - w[1].px[1]);
    let mut distances: Vec<f64> = neighbours.map(distance).collect();
    distances.sort_by(f64::total_cmp);
    distances.get(distances.len() / 2).copied().unwrap_or(0.0)
}

/// How many markers the board has.
fn markers_of(board: &Board) -> i32 {
    (board.squares_x * board.squares_y / 2) as i32
}

/// The dictionary of the board; it has enough markers for it.
fn dictionary(board: &Board) -> Result<Dictionary, CvError> {
    let name = &board.dictionary;
    let Some(index) = DICTIONARIES.iter().position(|known| known == name) else {
        return Err(CvError::Dictionary(name.clone()));
    };
    let dictionary = Dictionary::numbered(i32::try_from(index).unwrap_or(0))?;
    let (needed, has) = (markers_of(board), dictionary.count());
    if needed > has {
        return Err(CvError::Unusable(format!("the board needs {needed} markers, {name} has {has}")));
    }
    Ok(dictionary)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::board;

    fn board() -> Board {
        Board { squares_x: 7, squares_y: 5, square_m: 0.012, marker_m: 0.0096, dictionary: "DICT_4X4_50".into() }
    }

    /// The drawn board on a white ground, shifted by `at` pixels.
    fn drawn(at: usize) -> GrayImage {
        around(&draw(&board(), 60).unwrap(), at)
    }

    fn around(pattern: &GrayImage, at: usize) -> GrayImage {
        let mut image = GrayImage::filled(pattern.width + 2 * at, pattern.height + 2 * at, 255);
        for y in 0..pattern.height {
            let row = &pattern.pixels[y * pattern.width..][..pattern.width];
            image.pixels[(y + at) * (pattern.width + 2 * at) + at..][..pattern.width].copy_from_slice(row);
        }
        image
    }

    #[test]
    fn every_corner_of_a_drawn_board_is_found_where_it_was_drawn() {
        let ours = board::raster(&board(), &markers(&board()).unwrap(), 60);
        for image in [drawn(50), around(&ours, 50)] {
            assert_corners(&image);
        }
    }

    fn assert_corners(image: &GrayImage) {
        let view = find_corners(&board(), image, Look::Frame).unwrap();
        assert_eq!(view.corners.len(), 24, "{:?}", view.corners);
        for corner in &view.corners {
            // A square border lies between two pixels: half a pixel before the first pixel of the next square.
            let [x, y, _] = board().corner(corner.id).unwrap().xyz_m();
            let truth = [x, y].map(|v| 50.0 + v / 0.012 * 60.0 - 0.5);
            let error = (corner.px[0] - truth[0]).hypot(corner.px[1] - truth[1]);
            assert!(error < 0.05, "corner {} is {error} px off", corner.id);
        }
    }

    #[test]
    fn our_raster_is_the_board_of_opencv_with_every_marker_in_its_place() {
        for (dictionary, marker_m) in
            [("DICT_4X4_50", 0.0096), ("DICT_6X6_250", 0.009), ("DICT_APRILTAG_36h11", 0.0096)]
        {
            let board = Board { dictionary: dictionary.into(), marker_m, ..board() };
            let markers = markers(&board).unwrap();
            let modules = markers[0].width;
            let step = board.whole_px_step(modules as u32).unwrap();
            for px in (1..=8).map(|n| n * step).filter(|px| *px >= 30) {
                let (ours, theirs) = (board::raster(&board, &markers, px), draw(&board, px).unwrap());
                assert_eq!((ours.width, ours.height), (theirs.width, theirs.height));
                let px = px as usize;
                let side = (px as f64 * marker_m / 0.012).round() as usize;
                let (module, margin) = (side / modules, (px - side) / 2);
                // A marker in every second square; the middle of a module is the same whether it is a pixel off or not.
                let squares = (0..35).map(|i| (i % 7, i / 7)).filter(|(x, y)| (x + y) % 2 == 1);
                for ((x, y), marker) in squares.zip(&markers) {
                    let differs = |i: usize| {
                        let (u, v) = (i % side, i / side);
                        ours.at(x * px + margin + u, y * px + margin + v) != marker.at(u / module, v / module)
                    };
                    assert!(!(0..side * side).any(differs), "{dictionary} at {px} px, square {x} {y}");
                    for (i, truth) in marker.pixels.iter().enumerate() {
                        let middle = |i: usize| margin + i * module + module / 2;
                        let (u, v) = (x * px + middle(i % modules), y * px + middle(i / modules));
                        assert_eq!(theirs.at(u, v), *truth, "{dictionary} at {px} px: OpenCV's marker in {x} {y}");
                    }
                }
                let near = ours.pixels.iter().zip(&theirs.pixels).filter(|(a, b)| a == b).count();
                assert!(near as f64 > 0.9 * ours.pixels.len() as f64);
            }
        }
    }

    #[test]
    fn corners_that_no_plane_explains_are_none() {
        let in_a_heap = (0..8).map(|id| Corner::at(id * 3, [100.0, 100.0])).collect();
        assert!(without_outliers(&board(), &View::new(in_a_heap)).unwrap().corners.is_empty());
    }

    #[test]
    fn an_empty_image_has_no_corners_and_a_wrong_dictionary_is_named() {
        assert!(find_corners(&board(), &GrayImage::filled(200, 200, 128), Look::Frame).unwrap().corners.is_empty());
        let wrong = Board { dictionary: "DICT_9X9_1".into(), ..board() };
        assert!(find_corners(&wrong, &drawn(10), Look::Frame).unwrap_err().to_string().contains("`DICT_9X9_1`"));
        let large = Board { squares_x: 20, squares_y: 20, ..board() };
        assert!(check_dictionary(&large).is_err());
    }
}
