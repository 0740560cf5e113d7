//! Images of a folder or a video file as a frame camera, for bring-up without one.
//!
//! Each exposure takes the next image, in the order of their names; after the last one the first comes again. There
//! is nothing to trigger: exposures begin with the capture, at the rate of the cell.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::streaming::{Capture, Timing};
use super::{CameraError, CameraFacts, Clock, FrameCamera, FrameImage};
use crate::config::{FrameCameraCell, FrameTrigger};
use crate::cv::codec;
use crate::cv::video::Video;
use crate::geometry::Camera;
use crate::image::GrayImage;

/// File names that are images.
const ENDINGS: [&str; 6] = ["png", "jpg", "jpeg", "bmp", "tif", "tiff"];

/// Why there are no images.
#[derive(Debug, thiserror::Error)]
pub enum PicturesError {
    /// The folder cannot be read.
    #[error("{}: {why}; give rgb.source relative to the cell file", path.display())]
    Unreadable {
        /// Which.
        path: PathBuf,
        /// The words of the system.
        why: String,
    },
    /// Nothing in it.
    #[error("{}: no images; PNG, JPEG, BMP and TIFF are read", path.display())]
    Empty {
        /// Which.
        path: PathBuf,
    },
    /// An image is not what the cell says.
    #[error("{}: {why}", path.display())]
    Image {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
}

/// Images one after the other, again and again.
enum Source {
    Folder { files: Vec<PathBuf>, next: usize },
    Video { path: PathBuf, video: Video },
}

impl Source {
    fn next(&mut self, size: [u32; 2]) -> Result<GrayImage, PicturesError> {
        let (path, image) = match self {
            Self::Folder { files, next } => {
                let path = files[*next].clone();
                *next = (*next + 1) % files.len();
                let bytes = std::fs::read(&path);
                let bytes = bytes.map_err(|e| PicturesError::Image { path: path.clone(), why: e.to_string() })?;
                (path, codec::decode_gray(&bytes).map_err(|e| e.to_string()))
            }
            Self::Video { path, video } => (path.clone(), next_of(video, path)),
        };
        let image = image.map_err(|why| PicturesError::Image { path: path.clone(), why })?;
        let found = [image.width, image.height];
        if found == size.map(|n| n as usize) {
            return Ok(image);
        }
        let why =
            format!("is {}x{}; the cell says rgb.width {} and rgb.height {}", found[0], found[1], size[0], size[1]);
        Err(PicturesError::Image { path, why })
    }
}

fn next_of(video: &mut Video, path: &Path) -> Result<GrayImage, String> {
    if let Some(image) = video.read().map_err(|e| e.to_string())? {
        return Ok(image);
    }
    *video = Video::open_file(&path.to_string_lossy()).map_err(|e| e.to_string())?;
    video.read().map_err(|e| e.to_string())?.ok_or_else(|| "it has no images".into())
}

/// A frame camera that shows images which exist already.
pub struct Pictures {
    source: Source,
    name: String,
    size: [u32; 2],
    timing: Timing,
    clock: Arc<dyn Clock>,
    capture: Option<(Capture, f64)>,
}

impl Pictures {
    /// The images of a folder.
    pub fn of_folder(cell: &FrameCameraCell, folder: &Path, clock: Arc<dyn Clock>) -> Result<Self, PicturesError> {
        let unreadable = |e: std::io::Error| PicturesError::Unreadable { path: folder.into(), why: e.to_string() };
        let entries = std::fs::read_dir(folder).map_err(unreadable)?;
        let paths = entries.map(|entry| entry.map(|e| e.path())).collect::<Result<Vec<_>, _>>().map_err(unreadable)?;
        let mut files: Vec<_> = paths.into_iter().filter(|path| is_image(path)).collect();
        if files.is_empty() {
            return Err(PicturesError::Empty { path: folder.into() });
        }
        files.sort_by_cached_key(|path| natural(&path.file_name().unwrap_or_default().to_string_lossy()));
        let name = format!("{} images of {}", files.len(), folder.display());
        Self::of(Source::Folder { files, next: 0 }, name, cell, clock)
    }

    /// The images of a video file.
    pub fn of_video(cell: &FrameCameraCell, path: &Path, clock: Arc<dyn Clock>) -> Result<Self, PicturesError> {
        let unreadable = |why: String| PicturesError::Unreadable { path: path.into(), why };
        std::fs::File::open(path).map_err(|e| unreadable(e.to_string()))?;
        let open = || Video::open_file(&path.to_string_lossy());
        let video = open().map_err(|_| unreadable("not a video file that can be read".into()))?;
        Self::of(Source::Video { path: path.into(), video }, format!("images of {}", path.display()), cell, clock)
    }

    fn of(
        mut source: Source,
        name: String,
        cell: &FrameCameraCell,
        clock: Arc<dyn Clock>,
    ) -> Result<Self, PicturesError> {
        let size = [cell.width, cell.height];
        // The first one is looked at now, so that a wrong size is not found after the first move.
        source.next(size)?;
        if let Source::Folder { next, .. } = &mut source {
            *next = 0;
        } else if let Source::Video { path, video } = &mut source {
            let open = Video::open_file(&path.to_string_lossy());
            *video = open.map_err(|e| PicturesError::Image { path: path.clone(), why: e.to_string() })?;
        }
        let &FrameCameraCell { exposure_s, images_per_s, .. } = cell;
        let timing = Timing { trigger: FrameTrigger::FreeRun, exposure_s, period_s: 1.0 / images_per_s };
        Ok(Self { source, name, size, timing, clock, capture: None })
    }
}

fn is_image(path: &Path) -> bool {
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    ending.is_some_and(|ending| ENDINGS.contains(&ending.as_str()))
}

/// Sorts numbers in names by their value: 2 before 10.
fn natural(name: &str) -> Vec<(String, u128)> {
    let mut parts = vec![(String::new(), 0_u128)];
    let mut in_number = false;
    for c in name.chars() {
        if in_number && !c.is_ascii_digit() {
            parts.push((String::new(), 0));
        }
        in_number = c.is_ascii_digit();
        if let Some((text, number)) = parts.last_mut() {
            match c.to_digit(10) {
                Some(digit) => *number = number.saturating_mul(10).saturating_add(u128::from(digit)),
                None => text.push(c),
            }
        }
    }
    // Names that differ only in zeros before a number keep an order.
    parts.push((name.into(), 0));
    parts
}

impl FrameCamera for Pictures {
    fn facts(&self) -> CameraFacts {
        CameraFacts { model: self.name.clone(), ..CameraFacts::default() }
    }

    fn size(&self) -> [u32; 2] {
        self.size
    }

    fn begin(&mut self, images: u32) -> Result<(), CameraError> {
        let now_s = self.clock.now().seconds();
        self.capture = Some((Capture::new(self.timing, images, now_s), now_s));
        Ok(())
    }

    fn poll(&mut self) -> Result<Option<Vec<FrameImage>>, CameraError> {
        let now_s = self.clock.now().seconds();
        let Some((capture, next_s)) = &mut self.capture else { return Ok(None) };
        while *next_s + self.timing.exposure_s <= now_s && capture.needs_image(*next_s) {
            let image = self.source.next(self.size);
            let image = image.map_err(|e| CameraError::Failed { camera: Camera::Rgb, why: e.to_string() })?;
            capture.take(*next_s, 0, Some(image), now_s);
            *next_s += self.timing.period_s;
        }
        let over = self.capture.take_if(|(capture, _)| capture.is_over(now_s));
        Ok(over.map(|(capture, _)| capture.into_images()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_in_the_order_of_their_numbers() {
        let mut names =
            ["b1.png", "a10.png", "a9.png", "a09.png", "a2-10.png", "a2-9.png", "a.png", "A1.png", "10", "9"];
        names.sort_by_cached_key(|name| natural(name));
        assert_eq!(
            names,
            ["9", "10", "A1.png", "a2-9.png", "a2-10.png", "a09.png", "a9.png", "a10.png", "a.png", "b1.png"]
        );
    }
}
