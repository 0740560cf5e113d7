//! An 8-bit gray image: the currency between events, cv, vision and the simulator.
//!
//! Uses nothing of the crate. It stands above `board` because blink images, event images and camera
//! images are all of this type, and `events` must not know OpenCV's.

/// A gray image, rows top to bottom, one byte a pixel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GrayImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `height * width` values, row by row.
    pub pixels: Vec<u8>,
}

impl GrayImage {
    /// An image of one value.
    pub fn filled(width: usize, height: usize, value: u8) -> Self {
        Self { width, height, pixels: vec![value; width * height] }
    }

    /// The value at column `x`, row `y`; panics outside, as slices do.
    pub fn at(&self, x: usize, y: usize) -> u8 {
        self.pixels[y * self.width + x]
    }

    /// The image with black and white exchanged.
    pub fn inverted(&self) -> Self {
        Self { pixels: self.pixels.iter().map(|v| 255 - v).collect(), ..*self }
    }
}
