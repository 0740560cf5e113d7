//! Moving images: video files, and cameras of the operating system.
//!
//! The one place above `devices` that opens anything: OpenCV reads these by name only.

use opencv::core::Mat;
use opencv::prelude::*;
use opencv::{imgproc, videoio};

use super::{CvError, mat};
use crate::image::GrayImage;

/// Video4Linux counts exposure times in these steps, s.
const EXPOSURE_STEP_S: f64 = 1e-4;
/// Its word for an exposure time that is set by hand.
const MANUAL: f64 = 1.0;

/// Images one after the other.
pub struct Video {
    capture: videoio::VideoCapture,
    frame: Mat,
}

/// What a camera of the operating system is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VideoSettings {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Images per second.
    pub images_per_s: f64,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Gain in the camera's own unit; absent: as it is.
    pub gain: Option<f64>,
}

/// What it made of that; what it cannot be asked is absent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VideoRead {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Images per second.
    pub images_per_s: Option<f64>,
    /// Exposure time, s.
    pub exposure_s: Option<f64>,
    /// Gain in the camera's own unit.
    pub gain: Option<f64>,
}

impl Video {
    /// Opens a video file.
    pub fn open_file(path: &str) -> Result<Self, CvError> {
        Self::open(path, videoio::CAP_FFMPEG, "not a video file that can be read")
    }

    /// Opens a camera by its device, such as `/dev/video0`.
    pub fn open_device(device: &str) -> Result<Self, CvError> {
        Self::open(
            device,
            videoio::CAP_V4L2,
            "no camera that Video4Linux can open; is it connected, and may you use it?",
        )
    }

    fn open(name: &str, backend: i32, wrong: &str) -> Result<Self, CvError> {
        let unusable = || CvError::Unusable(format!("{name}: {wrong}"));
        let capture = videoio::VideoCapture::from_file(name, backend).map_err(|_| unusable())?;
        if capture.is_opened()? { Ok(Self { capture, frame: Mat::default() }) } else { Err(unusable()) }
    }

    /// Asks for settings, one by one, and reads back what became of them.
    pub fn set(&mut self, settings: &VideoSettings) -> Result<VideoRead, CvError> {
        let [width, height] = settings.size.map(f64::from);
        let mut asked = |property, value| Ok::<_, CvError>(self.capture.set(property, value)?);
        asked(videoio::CAP_PROP_FRAME_WIDTH, width)?;
        asked(videoio::CAP_PROP_FRAME_HEIGHT, height)?;
        asked(videoio::CAP_PROP_FPS, settings.images_per_s)?;
        asked(videoio::CAP_PROP_AUTO_EXPOSURE, MANUAL)?;
        let exposed = asked(videoio::CAP_PROP_EXPOSURE, (settings.exposure_s / EXPOSURE_STEP_S).round())?;
        if let Some(gain) = settings.gain {
            asked(videoio::CAP_PROP_GAIN, gain)?;
        }
        let known =
            |property| Ok::<_, CvError>(Some(self.capture.get(property)?).filter(|v| v.is_finite() && *v > 0.0));
        let size = [videoio::CAP_PROP_FRAME_WIDTH, videoio::CAP_PROP_FRAME_HEIGHT].map(known);
        let [width, height] = size;
        Ok(VideoRead {
            size: [width?, height?].map(|n| n.unwrap_or(0.0) as u32),
            images_per_s: known(videoio::CAP_PROP_FPS)?,
            exposure_s: known(videoio::CAP_PROP_EXPOSURE)?.filter(|_| exposed).map(|steps| steps * EXPOSURE_STEP_S),
            gain: known(videoio::CAP_PROP_GAIN)?,
        })
    }

    /// The next image as gray; `None` at the end of a file, or where a camera sends nothing.
    pub fn read(&mut self) -> Result<Option<GrayImage>, CvError> {
        let read = self.capture.read(&mut self.frame)?;
        if !read || self.frame.empty() {
            return Ok(None);
        }
        if self.frame.channels() == 1 {
            return mat::to_gray(&self.frame).map(Some);
        }
        let mut gray = Mat::default();
        imgproc::cvt_color_def(&self.frame, &mut gray, imgproc::COLOR_BGR2GRAY)?;
        mat::to_gray(&gray).map(Some)
    }
}
