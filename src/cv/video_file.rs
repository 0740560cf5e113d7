//! Video files: H.264 written with what OpenCV has, and decoded image by image.

use std::path::Path;

use opencv::core::{Mat, Size, Vector};
use opencv::prelude::*;
use opencv::{imgproc, videoio};

use super::{CvError, mat};
use crate::image::GrayImage;

/// What a video says about itself.
#[derive(Debug, Clone, PartialEq)]
pub struct VideoFacts {
    /// Columns and rows.
    pub size_px: [u32; 2],
    /// Images per second.
    pub fps: f64,
    /// Four letters of the codec, such as `avc1` or `h264`.
    pub codec: String,
}

/// Encodes H.264 with OpenCV: `count` images, image `i` is `image_of(i)`.
///
/// `Ok(false)`, and no file, where this OpenCV has no encoder for it.
pub fn encode_h264<'a>(
    path: &Path,
    fps: u32,
    count: usize,
    image_of: impl Fn(usize) -> &'a GrayImage,
) -> Result<bool, CvError> {
    let first = image_of(0);
    let size = Size::new(first.width as i32, first.height as i32);
    let fourcc = videoio::VideoWriter::fourcc('a', 'v', 'c', '1')?;
    let name = path.to_string_lossy().into_owned();
    let ffmpeg = videoio::CAP_FFMPEG;
    let colour = Vector::from_slice(&[videoio::VIDEOWRITER_PROP_IS_COLOR, 1]);
    let mut writer =
        videoio::VideoWriter::new_with_backend_params(&name, ffmpeg, fourcc, f64::from(fps), size, &colour)?;
    if !writer.is_opened()? {
        return Ok(false);
    }
    for index in 0..count {
        let mut bgr = Mat::default();
        imgproc::cvt_color_def(&mat::from_gray(image_of(index))?, &mut bgr, imgproc::COLOR_GRAY2BGR)?;
        writer.write(&bgr)?;
    }
    writer.release()?;
    Ok(true)
}

/// Decodes a video image by image, as gray.
pub fn decode_each(path: &Path, mut each: impl FnMut(&GrayImage)) -> Result<VideoFacts, CvError> {
    let name = path.to_string_lossy().into_owned();
    let mut capture = videoio::VideoCapture::from_file(&name, videoio::CAP_FFMPEG)?;
    if !capture.is_opened()? {
        return Err(CvError::Unusable(format!("{name} is no readable video; MP4 with H.264 is read")));
    }
    let number = |property| capture.get(property);
    let fourcc = number(videoio::CAP_PROP_FOURCC)? as u32;
    let facts = VideoFacts {
        size_px: [number(videoio::CAP_PROP_FRAME_WIDTH)? as u32, number(videoio::CAP_PROP_FRAME_HEIGHT)? as u32],
        fps: number(videoio::CAP_PROP_FPS)?,
        codec: fourcc.to_le_bytes().iter().map(|b| char::from(*b)).collect(),
    };
    let (mut bgr, mut gray) = (Mat::default(), Mat::default());
    while capture.read(&mut bgr)? {
        imgproc::cvt_color_def(&bgr, &mut gray, imgproc::COLOR_BGR2GRAY)?;
        each(&mat::to_gray(&gray)?);
    }
    Ok(facts)
}
