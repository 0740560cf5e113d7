//! Opens the cameras that a cell names.

use std::path::Path;
use std::sync::Arc;

use super::exit::{CameraOpenError, UsageError};
use crate::config::{Cell, EventCameraCell, EventDriver, FrameCameraCell, FrameDriver};
use crate::devices::event_stream::RawFile;
use crate::devices::pictures::Pictures;
use crate::devices::{CameraFacts, Clock, EventCamera, FrameCamera, v4l2};
use crate::geometry::Camera;

/// What is said where the program was built without the driver.
#[cfg(not(feature = "genicam"))]
pub(super) const NO_GENICAM: &str = "this program was built without GenICam cameras; \
    `apt-get install libaravis-dev libusb-1.0-0-dev libxml2-dev`, then `cargo build --features genicam`";

/// A camera whose source is beside the cell file, as key and value.
pub(super) fn beside_the_cell(cell: &Cell) -> Option<(&'static str, &str)> {
    let rgb = cell.rgb.as_ref().filter(|c| matches!(c.driver, FrameDriver::Folder | FrameDriver::Video));
    let event = cell.event.as_ref().filter(|c| c.driver == EventDriver::File);
    let of_rgb = rgb.and_then(|c| Some(("rgb.source", c.source.as_deref()?)));
    let of_event = event.and_then(|c| Some(("event.source", c.source.as_deref()?)));
    of_rgb.into_iter().chain(of_event).find(|(_, source)| Path::new(source).is_relative())
}

/// Opens a frame camera that is not simulated.
pub(super) fn open_frame(
    file: &Path,
    rgb: &FrameCameraCell,
    clock: Arc<dyn Clock>,
) -> anyhow::Result<Box<dyn FrameCamera>> {
    let source = rgb.source.clone().unwrap_or_default();
    let beside = file.parent().unwrap_or(Path::new(".")).join(&source);
    let opened = match rgb.driver {
        FrameDriver::Sim => Err("`driver: sim` is part of the simulated cell".to_owned()),
        FrameDriver::Genicam => return genicam(file, rgb, clock),
        FrameDriver::V4l2 => v4l2::open(rgb, &source, clock).map_err(|e| e.to_string()),
        FrameDriver::Folder => boxed(Pictures::of_folder(rgb, &beside, clock)),
        FrameDriver::Video => boxed(Pictures::of_video(rgb, &beside, clock)),
    };
    Ok(opened.map_err(CameraOpenError)?)
}

/// What is said where the program was built without the driver.
#[cfg(not(feature = "evk4"))]
pub(super) const NO_EVK4: &str = "this program was built without the driver of the EVK4; `cargo build --features evk4`";

/// Opens an event camera that is not simulated.
pub(super) fn open_event(
    file: &Path,
    event: &EventCameraCell,
    clock: Arc<dyn Clock>,
) -> anyhow::Result<Box<dyn EventCamera>> {
    match event.driver {
        EventDriver::Sim => Err(CameraOpenError("`driver: sim` is part of the simulated cell".into()).into()),
        EventDriver::Evk4 => evk4(file, event, clock),
        EventDriver::File => {
            let source = event.source.clone().unwrap_or_default();
            let beside = file.parent().unwrap_or(Path::new(".")).join(source);
            let opened = RawFile::open(&beside, [event.width, event.height], clock);
            Ok(Box::new(opened.map_err(|e| CameraOpenError(e.to_string()))?))
        }
    }
}

#[cfg(feature = "evk4")]
fn evk4(_: &Path, event: &EventCameraCell, clock: Arc<dyn Clock>) -> anyhow::Result<Box<dyn EventCamera>> {
    Ok(Box::new(crate::devices::evk4::open(event, clock).map_err(|e| CameraOpenError(e.to_string()))?))
}

#[cfg(not(feature = "evk4"))]
fn evk4(file: &Path, _: &EventCameraCell, _: Arc<dyn Clock>) -> anyhow::Result<Box<dyn EventCamera>> {
    Err(UsageError(format!("{}: event.driver is evk4, but {NO_EVK4}", file.display())).into())
}

fn boxed(opened: Result<Pictures, crate::devices::pictures::PicturesError>) -> Result<Box<dyn FrameCamera>, String> {
    opened.map(|pictures| Box::new(pictures) as _).map_err(|e| e.to_string())
}

#[cfg(feature = "genicam")]
fn genicam(_: &Path, rgb: &FrameCameraCell, clock: Arc<dyn Clock>) -> anyhow::Result<Box<dyn FrameCamera>> {
    Ok(crate::devices::genicam::open(rgb, clock).map_err(|e| CameraOpenError(e.to_string()))?)
}

#[cfg(not(feature = "genicam"))]
fn genicam(file: &Path, _: &FrameCameraCell, _: Arc<dyn Clock>) -> anyhow::Result<Box<dyn FrameCamera>> {
    Err(UsageError(format!("{}: rgb.driver is genicam, but {NO_GENICAM}", file.display())).into())
}

/// What the cameras said about themselves, for the log: `rgb.model`, `rgb.exposure_s`, ...
pub(super) fn facts(
    frame: Option<&dyn FrameCamera>,
    event: Option<&dyn EventCamera>,
) -> impl Iterator<Item = (String, String)> {
    let all = [(Camera::Rgb, frame.map(FrameCamera::facts)), (Camera::Event, event.map(EventCamera::facts))];
    all.into_iter().filter_map(|(camera, facts)| Some((camera, facts?))).flat_map(|(camera, facts)| {
        let CameraFacts { model, serial, firmware, settings } = facts;
        let told = [("model", Some(model)), ("serial", serial), ("firmware", firmware)];
        let told = told.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?)));
        told.chain(settings).map(move |(name, value)| (format!("{camera}.{name}"), value))
    })
}

/// Real cameras keep real time.
pub(super) fn refuse_other_times(
    file: &Path,
    rgb: Option<&FrameCameraCell>,
    time_scale: Option<f64>,
) -> Result<(), UsageError> {
    let real = rgb.is_some_and(|rgb| matches!(rgb.driver, FrameDriver::Genicam | FrameDriver::V4l2));
    match time_scale {
        Some(scale) if real && scale != 1.0 => {
            let why = "the frame camera is real and keeps real time; leave --time-scale out";
            Err(UsageError(format!("{}: {why}", file.display())))
        }
        Some(_) | None => Ok(()),
    }
}
