//! The keys of the two cameras as they stand in a cell file, and how they become checked values.

use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;

use super::cameras::{
    Biases, EventCameraCell, EventDriver, EventRecord, Filters, FrameCameraCell, FrameDriver, FrameTrigger,
};
use super::error::Findings;

/// The frame camera.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "FrameCamera")]
#[garde(allow_unvalidated)]
pub(super) struct FrameCameraFile {
    /// `sim`, `genicam`, `v4l2`, `folder` or `video`.
    pub(super) driver: FrameDriver,
    /// Serial number; a driver that finds another camera refuses.
    pub(super) serial: Option<String>,
    /// For `v4l2` the device (`/dev/video0`), for `folder` and `video` the path, relative to the cell file.
    pub(super) source: Option<String>,
    /// Image width, pixels.
    #[garde(range(min = 64, max = 20000))]
    pub(super) width: u32,
    /// Image height, pixels.
    #[garde(range(min = 64, max = 20000))]
    pub(super) height: u32,
    /// Column and row of the sensor at which the image begins; absent: in the middle of the sensor.
    pub(super) offset_px: Option<[u32; 2]>,
    /// The lens and its setting, in words; a change makes old intrinsics useless.
    pub(super) lens: String,
    /// Focal length, millimetres.
    #[garde(range(min = 0.5, max = 500.0))]
    pub(super) focal_length_mm: f64,
    /// Distance between pixels, micrometres.
    #[garde(range(min = 0.5, max = 50.0))]
    pub(super) pixel_pitch_um: f64,
    /// Exposure time, seconds.
    #[serde(default = "default_exposure_s")]
    #[garde(range(min = 0.00001, max = 10.0))]
    pub(super) exposure_s: f64,
    /// Images per second.
    #[serde(default = "default_images_per_s")]
    #[garde(range(min = 0.1, max = 1000.0))]
    pub(super) images_per_s: f64,
    /// Gain in the camera's own unit; absent: as the camera is set.
    #[garde(inner(range(min = 0.0, max = 1000.0)))]
    pub(super) gain: Option<f64>,
    /// `free_run`, `software` or `robot_output: N`.
    #[serde(default)]
    pub(super) trigger: FrameTrigger,
    /// For `genicam` triggered by the robot: the input of the camera, such as `Line1`; absent: its first.
    pub(super) trigger_line: Option<String>,
    /// For `genicam`: the output of the camera that shows its exposures, such as `Line2`; absent: its first that can.
    pub(super) exposure_line: Option<String>,
    /// Whether its exposure-active line drives the trigger input of the event camera.
    #[serde(default = "yes")]
    pub(super) wired: bool,
}

fn default_exposure_s() -> f64 {
    0.0999
}

fn default_images_per_s() -> f64 {
    10.0
}

fn yes() -> bool {
    true
}

/// The event camera.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "EventCamera")]
#[garde(allow_unvalidated)]
pub(super) struct EventCameraFile {
    /// `sim`, `evk4` or `file`.
    pub(super) driver: EventDriver,
    /// Serial number; a driver that finds another camera refuses.
    pub(super) serial: Option<String>,
    /// For `file` the RAW recording, relative to the cell file.
    pub(super) source: Option<String>,
    /// Sensor width, pixels.
    #[garde(range(min = 64, max = 4096))]
    pub(super) width: u32,
    /// Sensor height, pixels.
    #[garde(range(min = 64, max = 4096))]
    pub(super) height: u32,
    /// The lens and its setting, in words; a change makes old intrinsics useless.
    pub(super) lens: String,
    /// Focal length, millimetres.
    #[garde(range(min = 0.5, max = 500.0))]
    pub(super) focal_length_mm: f64,
    /// Distance between pixels, micrometres.
    #[garde(range(min = 0.5, max = 50.0))]
    pub(super) pixel_pitch_um: f64,
    /// Channel of the trigger input that marks exposures.
    #[serde(default)]
    #[garde(range(min = 0, max = 31))]
    pub(super) trigger_channel: u8,
    /// Settings of the pixels: `preset: factory` or `paper`, and what differs from it.
    #[serde(default)]
    #[garde(dive)]
    pub(super) biases: Biases,
    /// Filters of the sensor.
    #[serde(default)]
    #[garde(dive)]
    pub(super) filters: Filters,
    /// `captures`: from 0.2 s before each capture to its closing edge; `always`: through the whole session.
    #[serde(default)]
    pub(super) record: EventRecord,
}

pub(super) fn frame_camera(file: FrameCameraFile, findings: &mut Findings<'_>) -> FrameCameraCell {
    let busy = file.exposure_s * file.images_per_s;
    if busy > 1.0 {
        findings.add(
            "rgb.exposure_s",
            format!("is {}, longer than the {} s between two images", file.exposure_s, 1.0 / file.images_per_s),
        );
    }
    let wanted = match file.driver {
        FrameDriver::Sim | FrameDriver::Genicam => None,
        FrameDriver::V4l2 => Some("the device, such as /dev/video0"),
        FrameDriver::Folder => Some("the folder with the images"),
        FrameDriver::Video => Some("the video file"),
    };
    source("rgb", wanted, file.source.as_deref(), findings);
    let steered = matches!(file.driver, FrameDriver::Sim | FrameDriver::Genicam);
    if !steered && file.trigger != FrameTrigger::FreeRun {
        findings
            .add("rgb.trigger", "needs `driver: genicam` or `sim`; this driver takes images as they come: free_run");
    }
    if matches!(file.trigger, FrameTrigger::RobotOutput(output) if output > 17) {
        findings
            .add("rgb.trigger", "names a robot output above 17; 0 to 7 standard, 8 to 15 configurable, 16 and 17 tool");
    }
    check_lines(&file, findings);
    FrameCameraCell {
        driver: file.driver,
        serial: file.serial,
        source: file.source,
        width: file.width,
        height: file.height,
        offset_px: file.offset_px,
        lens: file.lens,
        focal_length_m: file.focal_length_mm / 1e3,
        pixel_pitch_m: file.pixel_pitch_um / 1e6,
        exposure_s: file.exposure_s,
        images_per_s: file.images_per_s,
        gain: file.gain,
        trigger: file.trigger,
        trigger_line: file.trigger_line,
        exposure_line: file.exposure_line,
        wired: file.wired,
    }
}

/// Lines that are named must be there to be used.
fn check_lines(file: &FrameCameraFile, findings: &mut Findings<'_>) {
    let by_robot = matches!(file.trigger, FrameTrigger::RobotOutput(_));
    for (key, line, used) in
        [("trigger_line", &file.trigger_line, by_robot), ("exposure_line", &file.exposure_line, file.wired)]
    {
        let Some(line) = line else { continue };
        let path = format!("rgb.{key}");
        if file.driver != FrameDriver::Genicam {
            findings.add(&path, "is for `driver: genicam`; remove it");
        } else if !used {
            let needs = if by_robot || key == "exposure_line" { "wired: true" } else { "trigger: {robot_output: N}" };
            findings.add(&path, format!("is for `{needs}`; remove it"));
        } else if line.is_empty() || !line.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_') {
            findings.add(&path, format!("is {line:?}: give the camera's own name of the line, such as Line1"));
        }
    }
}

pub(super) fn event_camera(file: EventCameraFile, findings: &mut Findings<'_>) -> EventCameraCell {
    let wanted = (file.driver == EventDriver::File).then_some("the RAW recording");
    source("event", wanted, file.source.as_deref(), findings);
    if file.filters.anti_flicker_hz.is_some_and(|[low, high]| low >= high) {
        findings.add("event.filters.anti_flicker_hz", "must be [low, high] with low below high");
    }
    EventCameraCell {
        driver: file.driver,
        serial: file.serial,
        source: file.source,
        width: file.width,
        height: file.height,
        lens: file.lens,
        focal_length_m: file.focal_length_mm / 1e3,
        pixel_pitch_m: file.pixel_pitch_um / 1e6,
        trigger_channel: file.trigger_channel,
        biases: file.biases,
        filters: file.filters,
        record: file.record,
    }
}

fn source(camera: &str, wanted: Option<&str>, found: Option<&str>, findings: &mut Findings<'_>) {
    match (wanted, found) {
        (Some(what), None) => findings.missing(camera, "source", &format!("this driver needs {what}")),
        (None, Some(_)) => findings.add(&format!("{camera}.source"), "is for other drivers; remove it"),
        (Some(_), Some(_)) | (None, None) => {}
    }
}
