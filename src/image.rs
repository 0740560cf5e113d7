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

/// A colour image for people, rows top to bottom.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ColorImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `height * width` pixels, row by row: red, green, blue.
    pub pixels: Vec<[u8; 3]>,
}

impl ColorImage {
    /// An image of one colour.
    pub fn filled(width: usize, height: usize, color: [u8; 3]) -> Self {
        Self { width, height, pixels: vec![color; width * height] }
    }

    /// The colour at column `x`, row `y`; panics outside, as slices do.
    pub fn at(&self, x: usize, y: usize) -> [u8; 3] {
        self.pixels[y * self.width + x]
    }

    /// Colours a pixel; outside nothing happens.
    pub fn put(&mut self, x: i64, y: i64, color: [u8; 3]) {
        let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { return };
        if x < self.width
            && let Some(pixel) = self.pixels.get_mut(y * self.width + x)
        {
            *pixel = color;
        }
    }
}

impl From<&GrayImage> for ColorImage {
    fn from(gray: &GrayImage) -> Self {
        Self { width: gray.width, height: gray.height, pixels: gray.pixels.iter().map(|v| [*v; 3]).collect() }
    }
}

/// An image of real numbers: what is counted or computed pixel by pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct FloatImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `height * width` values, row by row.
    pub values: Vec<f32>,
}

impl From<&GrayImage> for FloatImage {
    fn from(gray: &GrayImage) -> Self {
        Self { width: gray.width, height: gray.height, values: gray.pixels.iter().map(|v| f32::from(*v)).collect() }
    }
}
