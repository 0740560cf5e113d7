//! Cameras of the operating system (UVC, Video4Linux), for bring-up and rough work.
//!
//! Such a camera has no trigger input, no trigger command and no exposure signal: it runs by itself (`free_run`), and
//! its images are timed by their arrival less the exposure time, some milliseconds late. A thread keeps reading, so
//! that no old image waits in a queue. Exposure time, rate and gain are asked for; what the camera made of them
//! stands in its facts.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::streaming::{Intake, Streaming, Timing};
use super::{CameraFacts, Clock, FrameCamera};
use crate::config::{FrameCameraCell, FrameTrigger};
use crate::cv::CvError;
use crate::cv::video::{Video, VideoRead, VideoSettings};

/// So many reads in a row without an image mean that the camera is gone; each one waits for seconds.
const EMPTY_READS: u32 = 3;

/// Why the camera cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum V4l2Error {
    /// It cannot be opened or set.
    #[error(transparent)]
    Video(#[from] CvError),
    /// It sends another size.
    #[error(
        "{device} sends images of {found:?} pixels; the cell says rgb.width {} and rgb.height {}: give a size that `v4l2-ctl --list-formats-ext` shows",
        wanted[0], wanted[1]
    )]
    Size {
        /// Which.
        device: String,
        /// Width and height that it sends.
        found: [u32; 2],
        /// Those of the cell.
        wanted: [u32; 2],
    },
    /// The system gave no thread.
    #[error("no thread for the camera: {0}")]
    Thread(String),
}

/// Opens a camera by its device, such as `/dev/video0`.
pub fn open(cell: &FrameCameraCell, device: &str, clock: Arc<dyn Clock>) -> Result<Box<dyn FrameCamera>, V4l2Error> {
    let mut video = Video::open_device(device)?;
    let &FrameCameraCell { width, height, images_per_s, exposure_s, gain, .. } = cell;
    let size = [width, height];
    let read = video.set(&VideoSettings { size, images_per_s, exposure_s, gain })?;
    if read.size != size {
        return Err(V4l2Error::Size { device: device.into(), found: read.size, wanted: size });
    }
    let timing = Timing {
        trigger: FrameTrigger::FreeRun,
        exposure_s: read.exposure_s.unwrap_or(exposure_s),
        period_s: 1.0 / read.images_per_s.unwrap_or(images_per_s),
    };
    let facts = facts(device, &read);
    let intake = Intake::new(clock);
    let (fed, wanted) = (Arc::clone(&intake), size.map(|n| n as usize));
    let body = move || feed(&fed, wanted, timing.exposure_s, || video.read());
    let thread = std::thread::Builder::new().name("v4l2".into()).spawn(body);
    let thread = thread.map_err(|error| V4l2Error::Thread(error.to_string()))?;
    Ok(Box::new(Streaming::new(facts, size, timing, intake, thread)))
}

fn facts(device: &str, read: &VideoRead) -> CameraFacts {
    let told = |value: Option<f64>| value.map_or_else(|| "not told by the camera".into(), |value| format!("{value}"));
    let settings = [
        ("exposure_s", told(read.exposure_s)),
        ("images_per_s", told(read.images_per_s)),
        ("gain", told(read.gain)),
        ("trigger", "free run".into()),
    ];
    let settings: BTreeMap<_, _> = settings.into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
    CameraFacts { model: format!("Video4Linux {device}"), settings, ..CameraFacts::default() }
}

/// Takes images in until the camera is closed or gone.
fn feed(
    intake: &Intake,
    size: [usize; 2],
    exposure_s: f64,
    mut read: impl FnMut() -> Result<Option<crate::image::GrayImage>, CvError>,
) {
    let mut empty = 0;
    while !intake.has_ended() {
        match read() {
            Ok(Some(image)) if [image.width, image.height] == size => {
                empty = 0;
                intake.take(intake.now_s() - exposure_s, 0, || Ok(Some(image)));
            }
            Ok(Some(image)) => {
                let why =
                    format!("it sent an image of {}x{} pixels, not {}x{}", image.width, image.height, size[0], size[1]);
                return intake.fail(why);
            }
            Ok(None) if empty + 1 < EMPTY_READS => empty += 1,
            Ok(None) => return intake.fail("it sends no images any more; is it connected?".into()),
            Err(error) => return intake.fail(error.to_string()),
        }
    }
}
