//! Layout A: a session folder with `session.json`, tables, images and the RAW file of the event camera.

use std::collections::BTreeMap;

use super::data_set::{Capture, DataSet, ImageFile, Shot};
use super::error::{ImportError, Place};
use super::events_raw::{self, RawFile};
use super::frames::{self, FRAMES, Frame};
use super::poses::{self, POSES, Pose};
use super::session_json::{self, Mode, SessionJson};
use super::source::Source;
use super::{ImportOptions, some_of};
use crate::calibration::problem::{CameraSetup, CheckTruth};
use crate::calibration::settings::Carried;
use crate::geometry::Camera;
use crate::recording::setup::{ImportSetup, ImportedPose};
use crate::session::{Declared, Exposure};

const LAYOUT: &str = "layout A (session folder)";

/// Reads a session folder; images are not opened yet.
pub(super) fn read(mut source: Source, options: &ImportOptions) -> Result<DataSet, ImportError> {
    let (json, board) = session_json::read(&mut source, options.board.as_ref())?;
    let poses = poses::read(&mut source, json.mode)?;
    let pairs = poses::read_pairs(&mut source, &poses)?;
    let frames = frames::read(&mut source, &poses, json.rgb.is_some())?;
    check_still(&mut source, &poses, &frames)?;
    note_timing(&mut source, &json, &poses, &frames);
    let events = events(&mut source, &json, &frames)?;
    let origin_s = origin_host_s(&poses, &frames);
    source.facts.insert("host_origin_s".into(), format!("{origin_s}"));
    let setup = ImportSetup {
        name: options.name.clone().unwrap_or_else(|| source.name()),
        source: describe(&json, options.board.is_some()),
        robot_poses: json.mode == Mode::Handeye,
        carried: Carried::default(),
        board,
        cameras: cameras(&json),
        exposure_s: json.exposure_s,
        image_period_s: json.fps.map(|fps| 1.0 / fps),
        trigger_channel: json.trigger.as_ref().map(|trigger| trigger.channel),
        arrivals: false,
        poses: poses.iter().map(|pose| ImportedPose { id: pose.id.clone(), kind: pose.kind }).collect(),
        pairs,
        checks: json.checks.map(|c| CheckTruth { corner_id: c.corner_id, target_to_tcp_m: c.d_target_tcp_m }),
    };
    let captures = captures(&source, &poses, &frames, origin_s);
    Ok(DataSet { layout: LAYOUT, source, setup, size_declared_in: "session.json says", captures, events })
}

fn describe(json: &SessionJson, board_given: bool) -> String {
    let mode = match json.mode {
        Mode::Stereo => "stereo: robot poses do not enter the result",
        Mode::Handeye => "handeye: the target on the arm, static cameras",
    };
    let board = if board_given { "; board given by --board" } else { "" };
    format!("{LAYOUT}, mode {mode}{board}")
}

fn cameras(json: &SessionJson) -> BTreeMap<Camera, CameraSetup> {
    let setup = |width, height| CameraSetup { width, height, serial: None, lens: None, focal_px: None };
    let rgb = json.rgb.map(|camera| (Camera::Rgb, setup(camera.width, camera.height)));
    let event = json.event.as_ref().map(|camera| (Camera::Event, setup(camera.width, camera.height)));
    rgb.into_iter().chain(event).collect()
}

/// The whole second before the first host time: as small numbers, times keep their nanoseconds.
fn origin_host_s(poses: &[Pose], frames: &[Frame]) -> f64 {
    let still = poses.iter().map(|pose| pose.still_host_s[0]);
    still.chain(frames.iter().map(|frame| frame.start_host_s)).fold(f64::INFINITY, f64::min).floor()
}

/// Says which poses have no frame, or none while the arm stood still; all of them is an error.
fn check_still(source: &mut Source, poses: &[Pose], frames: &[Frame]) -> Result<(), ImportError> {
    let (mut without, mut moving) = (Vec::new(), Vec::new());
    for (index, pose) in poses.iter().enumerate() {
        let mut own = frames.iter().filter(|frame| frame.pose == index).peekable();
        if own.peek().is_none() {
            without.push(&pose.id);
        } else if !own.any(|frame| frame.is_within(pose.still_host_s)) {
            moving.push(&pose.id);
        }
    }
    if without.len() + moving.len() == poses.len() {
        let what =
            format!("has no exposure inside the still interval of its pose in {POSES}; are both on the host clock?");
        return Err(Place::file(FRAMES).wrong(what));
    }
    if let [id] = without.as_slice() {
        source.note(format!("pose {id} has no frames"));
    } else if !without.is_empty() {
        source.note(format!("{} poses have no frames: {}", without.len(), some_of(&without)));
    }
    if !moving.is_empty() {
        source.note(format!("no exposure lies inside the still interval of these poses: {}", some_of(&moving)));
    }
    Ok(())
}

/// Says where the tables do not keep to what `session.json` says about timing, and which poses have no image.
fn note_timing(source: &mut Source, json: &SessionJson, poses: &[Pose], frames: &[Frame]) {
    if let Some(exposure_s) = json.exposure_s {
        let is_odd = |frame: &&Frame| !(0.5..=1.5).contains(&((frame.end_host_s - frame.start_host_s) / exposure_s));
        let odd: Vec<String> = frames.iter().filter(is_odd).map(|frame| frame.place.to_string()).collect();
        if !odd.is_empty() {
            source.note(format!("exposures far from exposure_s, which is {exposure_s}: {}", some_of(&odd)));
        }
    }
    let counted = |index: usize, with_image: bool| {
        frames.iter().filter(|frame| frame.pose == index && !(with_image && frame.path.is_empty())).count()
    };
    let ids = |is_odd: &dyn Fn(usize) -> bool| -> Vec<&str> {
        poses.iter().enumerate().filter(|(index, _)| is_odd(*index)).map(|(_, pose)| pose.id.as_str()).collect()
    };
    if let Some(windows) = json.windows_per_pose {
        let odd = ids(&|index| counted(index, false) != 0 && counted(index, false) != windows);
        if !odd.is_empty() {
            source.note(format!(
                "poses with more or fewer exposures than windows_per_pose ({windows}): {}",
                some_of(&odd)
            ));
        }
    }
    let blind = ids(&|index| counted(index, false) != 0 && counted(index, true) == 0);
    if json.rgb.is_some() && !blind.is_empty() {
        source.note(format!("poses without an image: {}", some_of(&blind)));
    }
}

/// Surveys the RAW file and holds its triggers against the frames.
fn events(source: &mut Source, json: &SessionJson, frames: &[Frame]) -> Result<Option<RawFile>, ImportError> {
    let (Some(camera), Some(trigger)) = (&json.event, &json.trigger) else { return Ok(None) };
    let raw = events_raw::survey(source, camera)?;
    let (channel, place) = (trigger.channel, Place::file(&camera.raw));
    let rising = raw.rising_edges.get(&channel).copied().unwrap_or(0);
    if rising == 0 {
        let others: Vec<String> = raw.rising_edges.iter().map(|(other, n)| format!("{n} on channel {other}")).collect();
        let others = if others.is_empty() { "none at all".into() } else { others.join(", ") };
        let what = format!(
            "has no rising edge on trigger channel {channel} (found {others}); without triggers its windows are unknown"
        );
        return Err(place.wrong(what));
    }
    let visited = frames.iter().map(|frame| frame.pose).collect::<std::collections::BTreeSet<_>>().len();
    let (exposures, expected) = (frames.len(), frames.len() + visited);
    if rising != expected {
        source.note(format!(
            "{} has {rising} rising edges on channel {channel}, {exposures} exposures and {visited} closing pulses \
             would give {expected}: triggers are missing, doubled or extra",
            camera.raw
        ));
    }
    Ok(Some(raw))
}

/// The poses that have frames, in order of their last exposure.
fn captures(source: &Source, poses: &[Pose], frames: &[Frame], origin_s: f64) -> Vec<Capture> {
    let shot = |frame: &Frame| Shot {
        exposure: Exposure {
            start_s: frame.start_host_s - origin_s,
            end_s: frame.end_host_s - origin_s,
            image: !frame.path.is_empty(),
            closing: false,
            lost_packets: 0,
        },
        image: (!frame.path.is_empty()).then(|| ImageFile {
            path: source.path(&frame.path),
            name: frame.path.clone(),
            named_at: frame.place.clone(),
        }),
    };
    let capture = |(index, pose): (usize, &Pose)| Capture {
        pose: index,
        exposures: frames.iter().filter(|frame| frame.pose == index).map(shot).collect(),
        declared: Declared {
            still_s: Some(pose.still_host_s.map(|t| t - origin_s)),
            base_from_tcp: pose.base_from_tcp,
            joints_rad: pose.joints_rad,
            ..Declared::default()
        },
    };
    let mut captures: Vec<Capture> = poses.iter().enumerate().map(capture).collect();
    captures.retain(|capture| !capture.exposures.is_empty());
    captures.sort_by(|a, b| a.end_s().total_cmp(&b.end_s()));
    captures
}
