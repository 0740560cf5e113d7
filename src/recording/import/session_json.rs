//! `session.json` of layout A: board, cameras and how they were triggered.

use serde::Deserialize;

use super::error::{ImportError, Place};
use super::source::{Source, place_of};
use super::{MARKER_A, data_set};
use crate::board::Board;

/// Keys of each object; others are ignored with a notice.
const KNOWN_KEYS: [(&str, &[&str]); 6] = [
    (
        "",
        &[
            "mode",
            "alpha",
            "toggle_hz",
            "board",
            "rgb",
            "event",
            "exposure_s",
            "fps",
            "windows_per_pose",
            "trigger",
            "checks",
        ],
    ),
    ("board", &["squares_x", "squares_y", "dictionary", "square_m", "marker_m"]),
    ("rgb", &["width", "height"]),
    ("event", &["width", "height", "raw"]),
    ("trigger", &["channel", "rising", "falling"]),
    ("checks", &["corner_id", "d_target_tcp_m"]),
];

/// Largest side of an image, pixels.
const SIDE_MAX_PX: u32 = 65_535;
/// Largest side of an event sensor, pixels; the formats hold no more.
const EVENT_SIDE_MAX_PX: u32 = 2048;
/// Largest distance in a cell, metres.
pub(super) const DISTANCE_MAX_M: f64 = 10.0;

/// What the robot poses are for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Mode {
    /// Cameras and stereo; robot poses do not enter the result.
    Stereo,
    /// Static cameras, the target on the arm.
    Handeye,
}

/// Size of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub(super) struct Size {
    /// Columns.
    pub(super) width: u32,
    /// Rows.
    pub(super) height: u32,
}

/// The event camera and its recording.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub(super) struct EventCamera {
    /// Columns.
    pub(super) width: u32,
    /// Rows.
    pub(super) height: u32,
    /// The RAW file, relative to the folder.
    pub(super) raw: String,
}

/// How exposures appear at the trigger input.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub(super) struct TriggerInput {
    /// The input.
    pub(super) channel: u8,
    rising: RisingMeans,
    falling: FallingMeans,
}

/// The one meaning of a rising edge that the layout has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
enum RisingMeans {
    #[serde(rename = "exposure start")]
    ExposureStart,
}

/// The one meaning of a falling edge that the layout has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
enum FallingMeans {
    #[serde(rename = "exposure end")]
    ExposureEnd,
}

/// What the checks compare with.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub(super) struct Checks {
    /// The corner.
    pub(super) corner_id: u32,
    /// Its distance to the TCP, metres.
    pub(super) d_target_tcp_m: Option<f64>,
}

/// The file as it is; [`read`] checks it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(super) struct SessionJson {
    /// What the robot poses are for.
    pub(super) mode: Mode,
    alpha: Option<f64>,
    toggle_hz: Option<f64>,
    /// The board; [`read`] sees to it that there is one.
    board: Option<Board>,
    /// The frame camera.
    pub(super) rgb: Option<Size>,
    /// The event camera.
    pub(super) event: Option<EventCamera>,
    /// Length of an exposure, s.
    pub(super) exposure_s: Option<f64>,
    /// Images a second.
    pub(super) fps: Option<f64>,
    /// Exposures that a pose is said to have.
    pub(super) windows_per_pose: Option<usize>,
    /// The trigger input.
    pub(super) trigger: Option<TriggerInput>,
    /// What the checks compare with.
    pub(super) checks: Option<Checks>,
}

/// Reads and checks `session.json`; the board is the one of `--board` where that is given.
pub(super) fn read(source: &mut Source, board: Option<&Board>) -> Result<(SessionJson, Board), ImportError> {
    let text = source.text(MARKER_A)?;
    let json: SessionJson = serde_json::from_str(&text).map_err(|error| json_error(&error))?;
    if let Ok(value) = serde_json::from_str(&text) {
        source.note_keys(MARKER_A, &value, &KNOWN_KEYS);
    }
    let check = Check { text: &text };
    let board = check.board(&json, board)?;
    check.cameras(&json)?;
    if let Some(camera) = &json.event {
        source.check_file(&check.place(&["event", "raw"]), "event.raw", &camera.raw)?;
    }
    check.timing(&json)?;
    check.checks(&json, &board)?;
    Ok((json, board))
}

fn json_error(error: &serde_json::Error) -> ImportError {
    let (line, column) = (error.line() as u64, error.column() as u64);
    let what = error.to_string();
    let what = what.strip_suffix(&format!(" at line {line} column {column}")).unwrap_or(&what);
    Place { column: Some(column), ..Place::line(MARKER_A, line) }.wrong(what)
}

/// Finds the place of a key that is wrong.
struct Check<'a> {
    text: &'a str,
}

impl Check<'_> {
    /// Where a key is, given from the outermost object inwards.
    fn place(&self, keys: &[&str]) -> Place {
        let quoted: Vec<String> = keys.iter().map(|key| format!("\"{key}\"")).collect();
        place_of(MARKER_A, self.text, &quoted)
    }

    /// The error at a key.
    fn wrong(&self, keys: &[&str], what: &str) -> ImportError {
        self.place(keys).wrong(format!("{} {what}", keys.join(".")))
    }

    fn missing(&self, key: &str, why: &str) -> ImportError {
        Place::file(MARKER_A).wrong(format!("has no {key}{why}"))
    }

    fn range(&self, keys: &[&str], value: Option<f64>, low: f64, high: f64) -> Result<(), ImportError> {
        match value {
            Some(value) if !(low..=high).contains(&value) => {
                Err(self.wrong(keys, &format!("is {value}, outside {low} to {high}")))
            }
            _ => Ok(()),
        }
    }

    fn board(&self, json: &SessionJson, given: Option<&Board>) -> Result<Board, ImportError> {
        if let Some(board) = given {
            return data_set::given_board(board);
        }
        let Some(board) = &json.board else { return Err(self.missing("board", "; add it or give --board")) };
        data_set::check_board(board).map_err(|why| self.wrong(&["board"], &format!("cannot be: {why}")))?;
        Ok(board.clone())
    }

    fn cameras(&self, json: &SessionJson) -> Result<(), ImportError> {
        if json.rgb.is_none() && json.event.is_none() {
            return Err(self.missing("rgb and no event", ": at least one camera is needed"));
        }
        let sides = [
            (["rgb", "width"], json.rgb.map(|c| c.width), SIDE_MAX_PX),
            (["rgb", "height"], json.rgb.map(|c| c.height), SIDE_MAX_PX),
            (["event", "width"], json.event.as_ref().map(|c| c.width), EVENT_SIDE_MAX_PX),
            (["event", "height"], json.event.as_ref().map(|c| c.height), EVENT_SIDE_MAX_PX),
        ];
        for (keys, side, max) in sides {
            self.range(&keys, side.map(f64::from), 1.0, f64::from(max))?;
        }
        Ok(())
    }

    /// With an event camera everything about blinking, exposure and trigger must be said.
    fn timing(&self, json: &SessionJson) -> Result<(), ImportError> {
        let said = [
            ("alpha", json.alpha.is_some()),
            ("toggle_hz", json.toggle_hz.is_some()),
            ("exposure_s", json.exposure_s.is_some()),
            ("fps", json.fps.is_some()),
            ("windows_per_pose", json.windows_per_pose.is_some()),
            ("trigger", json.trigger.is_some()),
        ];
        if let Some((key, _)) = said.iter().find(|(_, said)| json.event.is_some() && !said) {
            return Err(self.missing(key, "; an event camera needs it"));
        }
        self.range(&["alpha"], json.alpha, 0.0, 1.0)?;
        self.range(&["toggle_hz"], json.toggle_hz, 0.01, 1e4)?;
        self.range(&["exposure_s"], json.exposure_s, 1e-6, 100.0)?;
        self.range(&["fps"], json.fps, 1e-3, 1e5)?;
        self.range(&["windows_per_pose"], json.windows_per_pose.map(|n| n as f64), 1.0, 1e6)?;
        match (json.exposure_s, json.fps) {
            (Some(exposure_s), Some(fps)) if exposure_s * fps > 1.01 => {
                let what =
                    format!("is {exposure_s}, longer than from one image to the next at {fps} fps; is it in seconds?");
                Err(self.wrong(&["exposure_s"], &what))
            }
            _ => Ok(()),
        }
    }

    fn checks(&self, json: &SessionJson, board: &Board) -> Result<(), ImportError> {
        let Some(Checks { corner_id, d_target_tcp_m }) = json.checks else { return Ok(()) };
        if board.corner(corner_id).is_none() {
            let what = format!("is {corner_id}, the board has corners 0 to {}", board.corner_count() - 1);
            return Err(self.wrong(&["checks", "corner_id"], &what));
        }
        self.range(&["checks", "d_target_tcp_m"], d_target_tcp_m, 0.0, DISTANCE_MAX_M)
    }
}
