//! The two cameras of a cell: what answers, how it is set, and how captures are triggered.

use garde::Validate;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The frame camera.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameCameraCell {
    /// What answers on the other side.
    pub driver: FrameDriver,
    /// Serial number; a driver that finds another camera refuses.
    pub serial: Option<String>,
    /// For `v4l2` the device, for `folder` and `video` the path, relative to the cell file.
    pub source: Option<String>,
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Column and row of the sensor at which the image begins; absent: in the middle of the sensor.
    pub offset_px: Option<[u32; 2]>,
    /// The lens and its setting, in words; a change makes old intrinsics useless.
    pub lens: String,
    /// Focal length, metres.
    pub focal_length_m: f64,
    /// Distance between pixels, metres.
    pub pixel_pitch_m: f64,
    /// Exposure time, seconds.
    pub exposure_s: f64,
    /// Images per second.
    pub images_per_s: f64,
    /// Gain in the camera's own unit; absent: as the camera is set.
    pub gain: Option<f64>,
    /// What begins an exposure.
    pub trigger: FrameTrigger,
    /// Input of the camera that begins an exposure, by the camera's own name; absent: its first.
    pub trigger_line: Option<String>,
    /// Output of the camera that shows its exposures, by the camera's own name; absent: its first output that can.
    pub exposure_line: Option<String>,
    /// Whether its exposure-active line drives the trigger input of the event camera.
    pub wired: bool,
}

/// Drivers of frame cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum FrameDriver {
    /// The simulated camera.
    Sim,
    /// A GenICam camera (GigE Vision or USB3 Vision).
    Genicam,
    /// A camera of the operating system (UVC, Video4Linux).
    V4l2,
    /// Image files of a folder, in the order of their names; for bring-up.
    Folder,
    /// The images of a video file; for bring-up.
    Video,
}

/// What begins an exposure of the frame camera.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FrameTrigger {
    /// The camera exposes at its own steady rate; the next images are taken.
    #[default]
    FreeRun,
    /// A command over the camera's own connection.
    Software,
    /// A pulse on this digital output of the robot, 0 to 17, wired to the trigger input of the camera.
    RobotOutput(u8),
}

/// The event camera.
#[derive(Debug, Clone, PartialEq)]
pub struct EventCameraCell {
    /// What answers on the other side.
    pub driver: EventDriver,
    /// Serial number; a driver that finds another camera refuses.
    pub serial: Option<String>,
    /// For `file` the recording, relative to the cell file.
    pub source: Option<String>,
    /// Sensor width, pixels.
    pub width: u32,
    /// Sensor height, pixels.
    pub height: u32,
    /// The lens and its setting, in words.
    pub lens: String,
    /// Focal length, metres.
    pub focal_length_m: f64,
    /// Distance between pixels, metres.
    pub pixel_pitch_m: f64,
    /// Channel of the trigger input that marks exposures.
    pub trigger_channel: u8,
    /// Settings of the pixels.
    pub biases: Biases,
    /// Filters of the sensor.
    pub filters: Filters,
    /// When its events are recorded.
    pub record: EventRecord,
}

/// When events are recorded.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EventRecord {
    /// Around each capture, and while the display is watched.
    #[default]
    Captures,
    /// From the first sample of the robot to the end of the session, also while the arm moves.
    Always,
}

/// Drivers of event cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum EventDriver {
    /// The simulated camera.
    Sim,
    /// A Prophesee EVK4.
    Evk4,
    /// A RAW file, played at its own pace again and again; for bring-up.
    File,
}

/// Settings of the pixels: a preset, and what differs from it. Relative to the factory setting, in the sensor's own
/// steps.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[garde(allow_unvalidated)]
pub struct Biases {
    /// Where the values come from that are not given.
    pub preset: BiasPreset,
    /// Threshold for brighter; higher is less sensitive.
    #[garde(inner(range(min = -85, max = 140)))]
    pub diff_on: Option<i32>,
    /// Threshold for darker; higher is less sensitive.
    #[garde(inner(range(min = -35, max = 190)))]
    pub diff_off: Option<i32>,
    /// Low-pass of the pixel; lower is slower.
    #[garde(inner(range(min = -35, max = 55)))]
    pub fo: Option<i32>,
    /// High-pass of the pixel; higher forgets faster.
    #[garde(inner(range(min = 0, max = 120)))]
    pub hpf: Option<i32>,
    /// Rest after an event; higher is shorter.
    #[garde(inner(range(min = -20, max = 235)))]
    pub refr: Option<i32>,
}

/// Known sets of biases.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BiasPreset {
    /// The factory's.
    #[default]
    Factory,
    /// Those of the published calibration: `diff_off` -15, `diff_on` -35, `fo` -35, `hpf` 80.
    Paper,
}

impl Biases {
    /// Offsets from the factory setting by name: `diff_on`, `diff_off`, `fo`, `hpf`, `refr`.
    pub fn offsets(&self) -> [(&'static str, i32); 5] {
        let [on, off, fo, hpf] = match self.preset {
            BiasPreset::Factory => [0; 4],
            BiasPreset::Paper => [-35, -15, -35, 80],
        };
        [
            ("diff_on", self.diff_on.unwrap_or(on)),
            ("diff_off", self.diff_off.unwrap_or(off)),
            ("fo", self.fo.unwrap_or(fo)),
            ("hpf", self.hpf.unwrap_or(hpf)),
            ("refr", self.refr.unwrap_or(0)),
        ]
    }
}

/// Filters of the sensor; absent: off.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[garde(allow_unvalidated)]
pub struct Filters {
    /// Event trail filter: after the first event of a burst the trail is cut for this long, microseconds.
    #[garde(inner(range(min = 1000, max = 100_000)))]
    pub trail_us: Option<u32>,
    /// Anti-flicker filter: changes between these frequencies are dropped, Hz.
    #[garde(inner(inner(range(min = 50.0, max = 520.0))))]
    pub anti_flicker_hz: Option<[f64; 2]>,
}
