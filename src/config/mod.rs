//! From YAML text to checked values: cell and trajectory files, and what the topics of a bag mean.
//!
//! A file is checked once, here: after [`parse_cell`] and [`parse_trajectory`] values are right by type, in metres,
//! radians and seconds. Reads no files itself: text comes in, so that a replay can check what was recorded.
//! Uses `geometry`, `board` and the settings of `calibration`. Start at [`Cell`] and [`Trajectory`]; `cell_file` and
//! `trajectory_file` are the keys, units and ranges as people write them.

mod cameras;
mod cameras_file;
mod cell;
mod cell_convert;
mod cell_file;
mod dictionaries;
mod error;
mod handheld;
mod pose;
mod read;
mod robot;
mod source;
#[cfg(test)]
mod tests;
mod topics;
mod topics_file;
mod trajectory;
mod trajectory_convert;
mod trajectory_file;
mod write;
mod write_tour;

pub use cameras::{
    BiasPreset, Biases, EventCameraCell, EventDriver, EventRecord, Filters, FrameCameraCell, FrameDriver, FrameTrigger,
};
pub use cell::{
    Cell, ChecksCell, DisplayCell, IntrinsicsSource, KeepOut, MotionLimits, Mount, Nominal, RobotCell, RobotDriver,
    Section, SimCell, Stillness, TrajectoryUse,
};
pub use error::{ConfigError, Problem};
pub use handheld::Handheld;
pub use robot::{DigitalOutput, External, Interlock, Line, MotionBy, Signals, ToolShape};
pub use topics::{EventTopic, ImageTopic, Interval, PairBy, RobotTopic, StampOf, StillRule, Stops, Topics, TopicsMode};
pub use trajectory::{BoardView, Motion, Pair, Pattern, Ring, Segment, Start, Stop, Trajectory};
pub use write::{AppendError, TaughtPose, append_yaml, is_name, trajectory_yaml};
pub use write_tour::{TourPart, tour_yaml};

pub use crate::calibration::settings::{Carried, Gates, PoseKind, Settings};

/// Checks the text of a cell file; `file` is its name in messages.
pub fn parse_cell(text: &str, file: &str) -> Result<Cell, ConfigError> {
    let (keys, mut findings) = read::read::<cell_file::CellFile>(text, file)?;
    let cell = cell_convert::cell(keys, &mut findings);
    findings.finish(cell)
}

/// Checks the text of a trajectory file; `file` is its name in messages.
pub fn parse_trajectory(text: &str, file: &str) -> Result<Trajectory, ConfigError> {
    let (keys, mut findings) = read::read::<trajectory_file::TrajectoryFile>(text, file)?;
    let trajectory = trajectory_convert::trajectory(keys, file, &mut findings);
    findings.finish(trajectory)
}

/// Checks the text of a file about the topics of a recording; `file` is its name in messages.
pub fn parse_topics(text: &str, file: &str) -> Result<Topics, ConfigError> {
    let (keys, mut findings) = read::read::<topics_file::TopicsFile>(text, file)?;
    let topics = topics_file::topics(keys, &mut findings);
    findings.finish(topics)
}

/// The JSON Schema of cell files, for editors.
pub fn cell_schema() -> serde_json::Value {
    schemars::schema_for!(cell_file::CellFile).to_value()
}

/// The JSON Schema of trajectory files, for editors.
pub fn trajectory_schema() -> serde_json::Value {
    schemars::schema_for!(trajectory_file::TrajectoryFile).to_value()
}

/// The JSON Schema of files about topics, for editors.
pub fn topics_schema() -> serde_json::Value {
    schemars::schema_for!(topics_file::TopicsFile).to_value()
}
