//! Images to and from file formats.

use opencv::core::Vector;
use opencv::imgcodecs;
use opencv::prelude::*;

use super::{CvError, mat};
use crate::image::GrayImage;

/// Encodes losslessly as PNG, fast rather than small.
pub fn encode_png(image: &GrayImage) -> Result<Vec<u8>, CvError> {
    let mut bytes = Vector::<u8>::new();
    let parameters = Vector::from_slice(&[imgcodecs::IMWRITE_PNG_COMPRESSION, 1]);
    imgcodecs::imencode(".png", &mat::from_gray(image)?, &mut bytes, &parameters)?;
    Ok(bytes.to_vec())
}

/// Decodes an image file to gray; colour is converted.
pub fn decode_gray(bytes: &[u8]) -> Result<GrayImage, CvError> {
    let not_an_image = || CvError::NotAnImage { bytes: bytes.len() };
    if bytes.is_empty() {
        return Err(not_an_image());
    }
    let decoded = imgcodecs::imdecode(&Vector::<u8>::from_slice(bytes), imgcodecs::IMREAD_GRAYSCALE);
    let mat = decoded.map_err(|_| not_an_image())?;
    if mat.empty() {
        return Err(not_an_image());
    }
    mat::to_gray(&mat)
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
}
