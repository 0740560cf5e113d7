//! Images to and from file formats.

use opencv::core::{Mat, Vector};
use opencv::imgcodecs;
use opencv::prelude::*;

use super::{CvError, mat};
use crate::image::{ColorImage, GrayImage};

/// Encodes losslessly as PNG, fast rather than small.
pub fn encode_png(image: &GrayImage) -> Result<Vec<u8>, CvError> {
    let mut bytes = Vector::<u8>::new();
    let parameters = Vector::from_slice(&[imgcodecs::IMWRITE_PNG_COMPRESSION, 1]);
    imgcodecs::imencode(".png", &mat::from_gray(image)?, &mut bytes, &parameters)?;
    Ok(bytes.to_vec())
}

/// Encodes a colour image losslessly as PNG, fast rather than small.
pub fn encode_color_png(image: &ColorImage) -> Result<Vec<u8>, CvError> {
    encode_color(image, ".png", &[imgcodecs::IMWRITE_PNG_COMPRESSION, 1])
}

/// Encodes as JPEG, for people only; `quality` from 0 to 100.
pub fn encode_jpeg(image: &ColorImage, quality: u8) -> Result<Vec<u8>, CvError> {
    encode_color(image, ".jpg", &[imgcodecs::IMWRITE_JPEG_QUALITY, i32::from(quality.min(100))])
}

fn encode_color(image: &ColorImage, kind: &str, parameters: &[i32]) -> Result<Vec<u8>, CvError> {
    let mut bytes = Vector::<u8>::new();
    imgcodecs::imencode(kind, &mat::from_color(image)?, &mut bytes, &Vector::from_slice(parameters))?;
    Ok(bytes.to_vec())
}

/// Decodes an image file to colour; gray is converted.
pub fn decode_color(bytes: &[u8]) -> Result<ColorImage, CvError> {
    mat::to_color(&decode(bytes, imgcodecs::IMREAD_COLOR)?)
}

/// Decodes an image file to gray; colour is converted.
pub fn decode_gray(bytes: &[u8]) -> Result<GrayImage, CvError> {
    mat::to_gray(&decode(bytes, imgcodecs::IMREAD_GRAYSCALE)?)
}

fn decode(bytes: &[u8], flags: i32) -> Result<Mat, CvError> {
    let not_an_image = || CvError::NotAnImage { bytes: bytes.len() };
    if bytes.is_empty() {
        return Err(not_an_image());
    }
    let decoded = imgcodecs::imdecode(&Vector::<u8>::from_slice(bytes), flags);
    let mat = decoded.map_err(|_| not_an_image())?;
    if mat.empty() {
        return Err(not_an_image());
    }
    Ok(mat)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn png_comes_back_and_garbage_is_refused() {
        let image = GrayImage { width: 5, height: 3, pixels: (0..15).collect() };
        let png = encode_png(&image).unwrap();
        assert_eq!(decode_gray(&png).unwrap(), image);
        for bad in [&b""[..], b"not an image", &png[..20]] {
            assert!(matches!(decode_gray(bad), Err(CvError::NotAnImage { .. })), "{bad:?}");
        }
    }

    #[test]
    fn colours_keep_their_order_in_png_and_nearly_in_jpeg() {
        let mut image = ColorImage::filled(32, 16, [200, 30, 60]);
        assert_eq!(decode_color(&encode_color_png(&image).unwrap()).unwrap(), image);
        let jpeg = decode_color(&encode_jpeg(&image, 90).unwrap()).unwrap();
        assert_eq!((jpeg.width, jpeg.height), (32, 16));
        // One colour everywhere: only the rounding of colour spaces and of one coefficient is left.
        let off = jpeg.pixels.iter().flat_map(|p| (0..3).map(|c| p[c].abs_diff([200, 30, 60][c]))).max().unwrap();
        assert!(off <= 6, "{off}");
        image.pixels.truncate(3);
        assert!(encode_jpeg(&image, 90).is_err(), "fewer pixels than the size says");
    }
}
