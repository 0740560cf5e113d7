//! Layout C: corners of a plain chessboard, seen by one or two cameras; no images, no times, no robot.
//!
//! The corners become what the poses declare, so that the session holds them and a replay needs nothing else.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use super::ImportOptions;
use super::data_set::{Capture, DataSet};
use super::error::{ImportError, Place};
use super::source::Source;
use crate::board::{Board, Corner, View};
use crate::calibration::problem::CameraSetup;
use crate::calibration::settings::{Carried, PoseKind};
use crate::geometry::Camera;
use crate::recording::setup::{ImportSetup, ImportedPose};
use crate::session::Declared;

const LAYOUT: &str = "layout C (corners only)";

/// Keys of each object; others are ignored with a notice.
const KNOWN_KEYS: [(&str, &[&str]); 2] = [("", &["board", "views"]), ("board", &["cols", "rows", "square_size"])];

/// The file as it is.
#[derive(Debug, Deserialize)]
struct CornersFile {
    board: Chessboard,
    views: Vec<BothViews>,
}

/// Inner corners along x and y, and the side of a square in millimetres.
#[derive(Debug, Deserialize)]
struct Chessboard {
    cols: u32,
    rows: u32,
    square_size: f64,
}

#[derive(Debug, Deserialize)]
struct BothViews {
    left: Option<OneView>,
    right: Option<OneView>,
}

#[derive(Debug, Deserialize)]
struct OneView {
    /// Column and row on the board, x and y in pixels.
    corners: Vec<(u32, u32, f64, f64)>,
}

/// Whether a file looks like corners without images.
pub(super) fn is_of_corners(path: &Path) -> bool {
    /// A file of corners is small; anything larger is not looked at.
    const BYTES_MAX: u64 = 64 << 20;
    let small = path.extension().is_some_and(|e| e == "json") && path.metadata().is_ok_and(|m| m.len() <= BYTES_MAX);
    let text = if small { std::fs::read_to_string(path).ok() } else { None };
    let value = text.and_then(|text| serde_json::from_str::<serde_json::Value>(&text).ok());
    value.is_some_and(|v| v.get("board").is_some() && v.get("views").is_some())
}

/// Reads the corners in `file`.
pub(super) fn read(mut source: Source, file: &str, options: &ImportOptions) -> Result<DataSet, ImportError> {
    let place = Place::file(file);
    if options.board.is_some() {
        return Err(place.wrong("describes its board itself, a plain chessboard; leave --board out"));
    }
    let size = options.image_size.ok_or_else(|| {
        place.wrong(
            "has corners, but not the size of the images that they were found in; give it, such as --image-size \
             1024x576 (columns x rows): without it the cameras cannot be solved",
        )
    })?;
    let text = source.text(file)?;
    let found: CornersFile = serde_json::from_str(&text).map_err(|error| json_error(file, &error))?;
    if let Ok(value) = serde_json::from_str(&text) {
        source.note_keys(file, &value, &KNOWN_KEYS);
    }
    let board = board(&found.board, &place)?;
    let captures = captures(&found, &board, size, &place)?;
    let seen_by = |camera: &Camera| captures.iter().any(|c| c.declared.views.contains_key(camera));
    let camera = CameraSetup { width: size.0, height: size.1, serial: None, lens: None, focal_px: None };
    let cameras: BTreeMap<_, _> =
        [Camera::Rgb, Camera::Event].into_iter().filter(seen_by).map(|c| (c, camera.clone())).collect();
    let pose = |index: usize| ImportedPose { id: format!("view-{:03}", index + 1), kind: PoseKind::Intrinsics };
    let stem = Path::new(file).file_stem().map_or(file.into(), |stem| stem.to_string_lossy().into_owned());
    let setup = ImportSetup {
        name: options.name.clone().unwrap_or(stem),
        source: format!(
            "{LAYOUT}: `left` is taken as camera rgb, `right` as camera event; images of {}x{} by --image-size; \
             square_size in millimetres",
            size.0, size.1
        ),
        robot_poses: false,
        carried: Carried::default(),
        board,
        cameras,
        exposure_s: None,
        image_period_s: None,
        trigger_channel: None,
        arrivals: false,
        poses: (0..found.views.len()).map(pose).collect(),
        pairs: Vec::new(),
        checks: None,
    };
    Ok(DataSet { layout: LAYOUT, source, setup, size_declared_in: "--image-size is", captures, events: None })
}

fn json_error(file: &str, error: &serde_json::Error) -> ImportError {
    let (line, column) = (error.line() as u64, error.column() as u64);
    let what = error.to_string();
    let what = what.strip_suffix(&format!(" at line {line} column {column}")).unwrap_or(&what);
    Place { column: Some(column), ..Place::line(file, line) }.wrong(what)
}

fn board(found: &Chessboard, place: &Place) -> Result<Board, ImportError> {
    let &Chessboard { cols, rows, square_size } = found;
    if !(1.0..=1000.0).contains(&square_size) {
        let what = format!("has a board.square_size of {square_size}, outside 1 to 1000: it is in millimetres");
        return Err(place.wrong(what));
    }
    if !((2..=99).contains(&cols) && (2..=99).contains(&rows)) {
        let what = format!("has a board of {cols} x {rows} inner corners, outside 2 x 2 to 99 x 99");
        return Err(place.wrong(what));
    }
    Ok(Board::chessboard(cols, rows, square_size * 1e-3))
}

fn captures(found: &CornersFile, board: &Board, size: (u32, u32), place: &Place) -> Result<Vec<Capture>, ImportError> {
    let mut captures = Vec::new();
    for (pose, both) in found.views.iter().enumerate() {
        let mut views = BTreeMap::new();
        for (camera, side, found) in [(Camera::Rgb, "left", &both.left), (Camera::Event, "right", &both.right)] {
            let Some(found) = found else { continue };
            let view = view(found, board, size)
                .map_err(|(i, what)| place.wrong(format!("has views[{pose}].{side}.corners[{i}] {what}")))?;
            views.insert(camera, view);
        }
        let declared = Declared { views, ..Declared::default() };
        captures.push(Capture { pose, exposures: Vec::new(), declared });
    }
    if captures.iter().all(|capture| capture.declared.views.is_empty()) {
        return Err(place.wrong("has no corners: `views` is empty, or none has `left` or `right`"));
    }
    Ok(captures)
}

/// The corners of one camera at one pose; an error has the index of the corner.
fn view(found: &OneView, board: &Board, (width, height): (u32, u32)) -> Result<View, (usize, String)> {
    let (columns, rows) = (board.squares_x - 1, board.squares_y - 1);
    let mut corners = Vec::new();
    for (i, &(column, row, x, y)) in found.corners.iter().enumerate() {
        if column >= columns || row >= rows {
            return Err((i, format!("at column {column}, row {row}; the board has {columns} x {rows} inner corners")));
        }
        // Outer edges of the outer pixels.
        let inside = |at: f64, pixels: u32| (-0.5..=f64::from(pixels) - 0.5).contains(&at);
        if !(inside(x, width) && inside(y, height)) {
            return Err((
                i,
                format!("at ({x}, {y}) px, outside the image; --image-size is {width}x{height}: correct it"),
            ));
        }
        corners.push(Corner::at(row * columns + column, [x, y]));
    }
    let count = corners.len();
    let view = View::new(corners);
    if view.corners.len() == count { Ok(view) } else { Err((0, "and others, of which two are the same corner".into())) }
}
