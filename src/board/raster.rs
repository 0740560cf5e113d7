//! The board as an image, every marker where it belongs.
//!
//! OpenCV 4.6 draws some markers one pixel up or left of their place.

use super::Board;
use crate::image::GrayImage;

/// The board with `px_per_square` pixels a square and no margin: black 0, white 255.
///
/// `markers[i]` is marker `i` with its border, one pixel a module. At multiples of
/// [`Board::whole_px_step`] all modules have the same number of pixels.
pub fn raster(board: &Board, markers: &[GrayImage], px_per_square: u32) -> GrayImage {
    let px = px_per_square as usize;
    let [columns, rows] = [board.squares_x as usize, board.squares_y as usize];
    let mut image = GrayImage::filled(columns * px, rows * px, 255);
    let mut fill = |[x0, x1]: [usize; 2], [y0, y1]: [usize; 2]| {
        for line in image.pixels.chunks_mut(columns * px).take(y1).skip(y0) {
            line[x0..x1].fill(0);
        }
    };
    let mut next = markers.iter();
    for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
        let (left, top) = (column * px, row * px);
        if (row + column) % 2 == 0 {
            fill([left, left + px], [top, top + px]);
        } else if let Some(marker) = next.next() {
            let edge = edges(board, marker.width, px);
            for (x, y) in (0..marker.height).flat_map(|y| (0..marker.width).map(move |x| (x, y))) {
                if marker.at(x, y) < 128 {
                    fill([left + edge(x), left + edge(x + 1)], [top + edge(y), top + edge(y + 1)]);
                }
            }
        }
    }
    image
}

/// Where module `i` of a marker begins in its square, px.
fn edges(board: &Board, modules: usize, px: usize) -> impl Fn(usize) -> usize {
    let side = px as f64 * board.marker_m / board.square_m;
    let module = side / modules as f64;
    // Whole modules stay whole: the margin is rounded by itself.
    let margin = ((px as f64 - side) / 2.0 + 1e-6).floor();
    move |i| (margin + i as f64 * module).round() as usize
}
