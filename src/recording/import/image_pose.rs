//! Layout B: image and pose files, paired by `cal_data.yaml`; the board in `rct_target.yaml`. One frame camera.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use nalgebra::{Quaternion, UnitQuaternion};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_saphyr::Spanned;

use super::data_set::{self, Capture, DataSet, ImageFile, Shot};
use super::error::{ImportError, Place};
use super::session_json::DISTANCE_MAX_M;
use super::source::{Source, place_of};
use super::{ImportOptions, MARKER_B, Probe, image_file};
use crate::board::{Board, DICTIONARIES};
use crate::calibration::problem::CameraSetup;
use crate::calibration::settings::{Carried, PoseKind};
use crate::geometry::{Base, Camera, Tcp, Transform};
use crate::recording::setup::{ImportSetup, ImportedPose};
use crate::session::{Declared, Exposure};

const LAYOUT: &str = "layout B (image and pose files)";
/// The file of the board.
const TARGET: &str = "rct_target.yaml";
/// Made-up length of an exposure, s; images are made to come once a second.
const EXPOSURE_S: f64 = 0.1;
/// A quaternion may be this much longer or shorter than 1: files have few digits.
const NORM_TOLERANCE: f64 = 1e-3;

/// `cal_data.yaml`.
#[derive(Debug, Deserialize)]
struct CalData {
    data: Vec<Entry>,
    static_camera: Option<Spanned<bool>>,
}

#[derive(Debug, Deserialize)]
struct Entry {
    image: Spanned<String>,
    pose: Spanned<String>,
}

/// `rct_target.yaml`, with the board in `target_finder` or at the top.
#[derive(Debug, Deserialize)]
struct InTargetFinder {
    target_finder: TargetFinder,
}

#[derive(Debug, Deserialize)]
struct TargetFinder {
    rows: u32,
    cols: u32,
    chessboard_dim: f64,
    aruco_marker_dim: f64,
    dictionary: Spanned<u32>,
}

const TARGET_KEYS: [&str; 6] = ["type", "rows", "cols", "chessboard_dim", "aruco_marker_dim", "dictionary"];

/// A pose file: metres, and a quaternion.
#[derive(Debug, Deserialize)]
struct PoseFile {
    x: Spanned<f64>,
    y: Spanned<f64>,
    z: Spanned<f64>,
    qx: Spanned<f64>,
    qy: Spanned<f64>,
    qz: Spanned<f64>,
    qw: Spanned<f64>,
}

/// Reads the files of layout B and the size of the first image.
pub(super) fn read(mut source: Source, options: &ImportOptions, probe: Probe<'_>) -> Result<DataSet, ImportError> {
    let text = source.text(MARKER_B)?;
    let list: CalData = parse(MARKER_B, &text)?;
    source.note_keys(MARKER_B, &parse(MARKER_B, &text)?, &[("", &["data", "static_camera"])]);
    check_static(&list)?;
    let board = board(&mut source, options)?;
    let entries = entries(&source, &list)?;
    note_repeated_poses(&mut source, &list);
    let first = entries.first().ok_or_else(|| Place::file(MARKER_B).wrong("has no images: `data` is empty"))?;
    let (width, height) = image_file::read(&first.0, probe)?.size;
    let mut captures = Vec::new();
    for (index, (image, pose_file)) in entries.iter().enumerate() {
        captures.push(capture(index, image.clone(), base_from_tcp(&mut source, pose_file)?));
    }
    let images: Vec<&ImageFile> = entries.iter().map(|(image, _)| image).collect();
    let poses = ids(&images).into_iter().map(|id| ImportedPose { id, kind: PoseKind::HandEye }).collect();
    let camera = CameraSetup { width, height, serial: None, lens: None, focal_px: None };
    let setup = ImportSetup {
        name: options.name.clone().unwrap_or_else(|| source.name()),
        source: describe(options.board.is_some()),
        robot_poses: true,
        carried: Carried::default(),
        board,
        cameras: BTreeMap::from([(Camera::Rgb, camera)]),
        exposure_s: None,
        image_period_s: None,
        trigger_channel: None,
        arrivals: false,
        poses,
        pairs: Vec::new(),
        checks: None,
    };
    Ok(DataSet { layout: LAYOUT, source, setup, size_declared_in: "the first image is", captures, events: None })
}

fn describe(board_given: bool) -> String {
    let board = if board_given { "given by --board" } else { "from rct_target.yaml" };
    format!(
        "{LAYOUT}: the poses are base_from_flange, taken as base_from_tcp; times are made up, one image a second; \
         board {board}"
    )
}

/// Reads YAML; keys that the type does not have are ignored.
fn parse<T: DeserializeOwned>(file: &str, text: &str) -> Result<T, ImportError> {
    serde_saphyr::from_str(text).map_err(|error| yaml_error(file, text, error.without_snippet()))
}

/// The library's message without its location, which is in front already, and with the line that it is about.
fn yaml_error(file: &str, text: &str, error: &serde_saphyr::Error) -> ImportError {
    let what = error.to_string();
    let what = what.lines().next().unwrap_or_default();
    let what = what.split(" at line ").next().unwrap_or_default();
    // The library speaks to programmers here.
    let what = what.split(", set DuplicateKeyPolicy").next().unwrap_or_default();
    let Some(at) = error.location() else { return Place::file(file).wrong(format!("cannot be read: {what}")) };
    let line = text.lines().nth((at.line() as usize).saturating_sub(1)).unwrap_or_default().trim();
    place(file, at.line(), at.column()).wrong(format!("{what}, in `{line}`"))
}

fn place(file: &str, line: u64, column: u64) -> Place {
    Place { column: Some(column), ..Place::line(file, line) }
}

fn place_of_value<T>(file: &str, value: &Spanned<T>) -> Place {
    place(file, value.referenced.line(), value.referenced.column())
}

fn check_static(list: &CalData) -> Result<(), ImportError> {
    match &list.static_camera {
        Some(value) if !value.value => {
            let what = "static_camera is false; layout B is for a static camera and a target on the arm";
            Err(place_of_value(MARKER_B, value).wrong(what))
        }
        _ => Ok(()),
    }
}

fn board(source: &mut Source, options: &ImportOptions) -> Result<Board, ImportError> {
    if let Some(board) = &options.board {
        return data_set::given_board(board);
    }
    if !source.has(TARGET) {
        return Err(Place::file(TARGET).wrong("is missing; it describes the board: add it or give --board"));
    }
    let text = source.text(TARGET)?;
    let value: serde_json::Value = parse(TARGET, &text)?;
    let nested = value.get("target_finder").is_some();
    let finder: TargetFinder =
        if nested { parse::<InTargetFinder>(TARGET, &text)?.target_finder } else { parse(TARGET, &text)? };
    let known: &[(&str, &[&str])] =
        if nested { &[("", &["target_finder"]), ("target_finder", &TARGET_KEYS)] } else { &[("", &TARGET_KEYS)] };
    source.note_keys(TARGET, &value, known);
    let number = finder.dictionary.value;
    let Some(dictionary) = DICTIONARIES.get(number as usize) else {
        let what = format!("dictionary is {number}; OpenCV numbers its dictionaries 0 to {}", DICTIONARIES.len() - 1);
        return Err(place_of_value(TARGET, &finder.dictionary).wrong(what));
    };
    let board = Board {
        squares_x: finder.cols,
        squares_y: finder.rows,
        square_m: finder.chessboard_dim,
        marker_m: finder.aruco_marker_dim,
        dictionary: (*dictionary).into(),
    };
    let at = if nested { "target_finder" } else { "rows" };
    data_set::check_board(&board).map_err(|why| place_of(TARGET, &text, &[at]).wrong(why))?;
    Ok(board)
}

/// The images with the names of their pose files; each image once, every file there.
fn entries(source: &Source, list: &CalData) -> Result<Vec<(ImageFile, String)>, ImportError> {
    let mut seen = BTreeSet::new();
    let mut entries = Vec::new();
    for entry in &list.data {
        let (named_at, pose_at) = (place_of_value(MARKER_B, &entry.image), place_of_value(MARKER_B, &entry.pose));
        let name = entry.image.value.clone();
        source.check_file(&named_at, "image", &name)?;
        source.check_file(&pose_at, "pose", &entry.pose.value)?;
        if !seen.insert(source.path(&name).components().collect::<std::path::PathBuf>()) {
            return Err(named_at.wrong(format!("image is `{name}`, which is in the list already; remove one")));
        }
        entries.push((ImageFile { path: source.path(&name), name, named_at }, entry.pose.value.clone()));
    }
    Ok(entries)
}

fn note_repeated_poses(source: &mut Source, list: &CalData) {
    let mut seen = BTreeSet::new();
    let names = list.data.iter().map(|entry| entry.pose.value.as_str());
    let repeated: Vec<&str> = names.filter(|name| !seen.insert(*name)).collect();
    if !repeated.is_empty() {
        source.note(format!("pose files that serve more than one image: {}", super::some_of(&repeated)));
    }
}

/// Reads a pose file: base_from_flange, taken as base_from_tcp.
fn base_from_tcp(source: &mut Source, file: &str) -> Result<Transform<Base, Tcp>, ImportError> {
    let text = source.text(file)?;
    let PoseFile { x, y, z, qx, qy, qz, qw } = parse(file, &text)?;
    for (key, number) in [("x", &x), ("y", &y), ("z", &z), ("qx", &qx), ("qy", &qy), ("qz", &qz), ("qw", &qw)] {
        let (value, place) = (number.value, place_of_value(file, number));
        if !value.is_finite() {
            return Err(place.wrong(format!("{key} is {value}, not a finite number")));
        }
        if value.abs() > DISTANCE_MAX_M {
            let what = format!("{key} is {value}, outside -{DISTANCE_MAX_M} to {DISTANCE_MAX_M}");
            return Err(place.wrong(what + "; is it in millimetres? it must be in metres"));
        }
    }
    let quaternion = Quaternion::new(qw.value, qx.value, qy.value, qz.value);
    let norm = quaternion.norm();
    let unit = (norm - 1.0).abs() <= NORM_TOLERANCE;
    if !unit {
        let what = format!("quaternion of length {norm}, not 1; are qx, qy, qz, qw complete and in place?");
        return Err(place_of_value(file, &qx).wrong(what));
    }
    Ok(Transform::from_parts([x.value, y.value, z.value], UnitQuaternion::from_quaternion(quaternion)))
}

fn capture(index: usize, image: ImageFile, base_from_tcp: Transform<Base, Tcp>) -> Capture {
    let start_s = index as f64;
    Capture {
        pose: index,
        exposures: vec![Shot { exposure: Exposure::whole(start_s, start_s + EXPOSURE_S), image: Some(image) }],
        declared: Declared { base_from_tcp: Some(base_from_tcp), ..Declared::default() },
    }
}

/// Pose ids: the names of the images without folder and ending, or with them where that is not unique.
fn ids(images: &[&ImageFile]) -> Vec<String> {
    let stem = |image: &&ImageFile| {
        Path::new(&image.name).file_stem().map_or_else(|| image.name.clone(), |s| s.to_string_lossy().into_owned())
    };
    let stems: Vec<String> = images.iter().map(stem).collect();
    let unique = stems.iter().collect::<BTreeSet<_>>().len() == stems.len();
    if unique { stems } else { images.iter().map(|image| image.name.clone()).collect() }
}
