//! `frames.csv` of layout A: the exposures, on the host clock.

use std::collections::{BTreeMap, BTreeSet};

use super::error::{ImportError, Place};
use super::poses::{HOST_TIME_HINT, HOST_TIME_MAX_S, POSES, Pose};
use super::source::Source;
use super::table::{Row, Table};

/// The file of the exposures.
pub(super) const FRAMES: &str = "frames.csv";

const COLUMNS: [&str; 6] = ["frame_id", "pose_id", "index_in_pose", "t_exp_start_host_s", "t_exp_end_host_s", "path"];

/// One row of `frames.csv`.
#[derive(Debug, Clone)]
pub(super) struct Frame {
    /// Index of its pose.
    pub(super) pose: usize,
    /// Position among the exposures of the pose.
    index: usize,
    /// Start of the exposure, host clock, s.
    pub(super) start_host_s: f64,
    /// End of the exposure, host clock, s.
    pub(super) end_host_s: f64,
    /// Name of the image; empty for none.
    pub(super) path: String,
    /// Where it was read.
    pub(super) place: Place,
}

impl Frame {
    /// Whether the exposure lies inside an interval of the host clock.
    pub(super) fn is_within(&self, interval_host_s: [f64; 2]) -> bool {
        self.start_host_s >= interval_host_s[0] && self.end_host_s <= interval_host_s[1]
    }
}

/// Reads `frames.csv`: at least one row, ids and images unique, and within each pose in order of time.
pub(super) fn read(source: &mut Source, poses: &[Pose], has_rgb: bool) -> Result<Vec<Frame>, ImportError> {
    let table = Table::read(source, FRAMES, &COLUMNS, &[])?;
    let by_id: BTreeMap<&str, usize> = poses.iter().enumerate().map(|(i, pose)| (pose.id.as_str(), i)).collect();
    let (mut ids, mut paths) = (BTreeSet::new(), BTreeSet::new());
    let mut frames = Vec::new();
    for row in table.rows() {
        let (place, id) = (row.place(), row.text("frame_id")?);
        let frame = read_frame(&row, &by_id)?;
        if !ids.insert(id) {
            return Err(place.wrong(format!("frame_id `{id}` is there already")));
        }
        if !frame.path.is_empty() {
            check_image(source, &frame, has_rgb)?;
            if !paths.insert(row.text_or_empty("path")) {
                return Err(place.wrong(format!("path is `{}`, the image of an earlier row", frame.path)));
            }
        }
        frames.push(frame);
    }
    if frames.is_empty() {
        return Err(Place::file(FRAMES).wrong("has no rows; there is no exposure to import"));
    }
    if has_rgb && paths.is_empty() {
        return Err(Place::file(FRAMES).wrong("names no image, but session.json declares an rgb camera"));
    }
    check_order(&frames, poses)?;
    Ok(frames)
}

fn read_frame(row: &Row<'_>, by_id: &BTreeMap<&str, usize>) -> Result<Frame, ImportError> {
    let pose_id = row.text("pose_id")?;
    let Some(&pose) = by_id.get(pose_id) else {
        return Err(row.place().wrong(format!("pose_id is `{pose_id}`, which is no pose_id in {POSES}")));
    };
    let start_host_s = row.number("t_exp_start_host_s", HOST_TIME_MAX_S, HOST_TIME_HINT)?;
    let end_host_s = row.number("t_exp_end_host_s", HOST_TIME_MAX_S, HOST_TIME_HINT)?;
    if end_host_s <= start_host_s {
        let what = format!("t_exp_end_host_s is {end_host_s}, not after t_exp_start_host_s, which is {start_host_s}");
        return Err(row.place().wrong(what));
    }
    let (index, path) = (row.count("index_in_pose")?, row.text_or_empty("path").into());
    Ok(Frame { pose, index, start_host_s, end_host_s, path, place: row.place() })
}

fn check_image(source: &Source, frame: &Frame, has_rgb: bool) -> Result<(), ImportError> {
    if !has_rgb {
        let what = format!("path is `{}`, but session.json declares no rgb camera", frame.path);
        return Err(frame.place.wrong(what));
    }
    source.check_file(&frame.place, "path", &frame.path)
}

/// Within a pose, rows are in order of time and `index_in_pose` counts up by one, everywhere from 0 or from 1.
fn check_order(frames: &[Frame], poses: &[Pose]) -> Result<(), ImportError> {
    let first_index = frames.iter().map(|frame| frame.index).min().unwrap_or(0).min(1);
    let mut last: BTreeMap<usize, &Frame> = BTreeMap::new();
    for frame in frames {
        let earlier = last.insert(frame.pose, frame);
        let id = poses.get(frame.pose).map_or("", |pose| pose.id.as_str());
        if let Some(earlier) = earlier.filter(|earlier| frame.start_host_s <= earlier.start_host_s) {
            let (start_s, earlier_s, at) = (frame.start_host_s, earlier.start_host_s, &earlier.place);
            return Err(frame.place.wrong(format!(
                "t_exp_start_host_s is {start_s}, not after {earlier_s} in {at}, the exposure of pose `{id}` before it"
            )));
        }
        let expected = earlier.map_or(first_index, |earlier| earlier.index + 1);
        if frame.index != expected {
            return Err(frame.place.wrong(format!(
                "index_in_pose is {}, expected {expected} for pose `{id}`; a row is missing, doubled or extra (an exposure \
                 without image has an empty path)",
                frame.index
            )));
        }
    }
    Ok(())
}
