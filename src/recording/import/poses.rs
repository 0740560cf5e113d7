//! `poses.csv` and `pairs.csv` of layout A.

use std::collections::BTreeMap;

use super::error::{ImportError, Place};
use super::session_json::{DISTANCE_MAX_M, Mode};
use super::source::Source;
use super::table::{Row, Table};
use crate::calibration::problem::DistancePair;
use crate::calibration::settings::PoseKind;
use crate::geometry::{Base, Tcp, Transform, kinematics::Joints};

/// The file of the poses.
pub(super) const POSES: &str = "poses.csv";
/// The file of the pairs.
pub(super) const PAIRS: &str = "pairs.csv";
/// Largest host time, s: the year 2286. Milliseconds since 1970 are beyond it.
pub(super) const HOST_TIME_MAX_S: f64 = 1e10;
/// Says what a larger host time may come from.
pub(super) const HOST_TIME_HINT: &str = "is it in seconds?";
/// Largest joint angle and component of a rotation vector, rad; one turn is 6.28.
const ANGLE_MAX_RAD: f64 = 7.0;

const COLUMNS: [&str; 5] = ["pose_id", "kind", "pair", "t_still_from_host_s", "t_still_to_host_s"];
const POSITION: [&str; 3] = ["x", "y", "z"];
const ROTATION: [&str; 3] = ["rx", "ry", "rz"];
const POSE: [&str; 6] = ["x", "y", "z", "rx", "ry", "rz"];
const JOINTS: [&str; 6] = ["q0", "q1", "q2", "q3", "q4", "q5"];

/// One row of `poses.csv`.
#[derive(Debug, Clone)]
pub(super) struct Pose {
    /// Its id.
    pub(super) id: String,
    /// What it is for.
    pub(super) kind: PoseKind,
    /// Name of its pair; empty for none.
    pub(super) pair: String,
    /// The still interval, host clock, s.
    pub(super) still_host_s: [f64; 2],
    /// `base_from_tcp`; absent where no robot pose is known.
    pub(super) base_from_tcp: Option<Transform<Base, Tcp>>,
    /// Joint positions, rad; absent if unknown.
    pub(super) joints_rad: Option<Joints>,
    /// Where it was read.
    pub(super) place: Place,
}

/// Reads `poses.csv`; at least one pose, ids unique.
pub(super) fn read(source: &mut Source, mode: Mode) -> Result<Vec<Pose>, ImportError> {
    let mut required = COLUMNS.to_vec();
    let mut optional = JOINTS.to_vec();
    // Handheld cameras have no robot poses at all.
    if mode == Mode::Handeye { &mut required } else { &mut optional }.extend(POSE);
    let table = Table::read(source, POSES, &required, &optional)?;
    check_group(&table, &POSE)?;
    check_group(&table, &JOINTS)?;
    let mut lines = BTreeMap::new();
    let mut poses = Vec::new();
    for row in table.rows() {
        let pose = read_pose(&row, mode)?;
        if let Some(earlier) = lines.insert(pose.id.clone(), row.place()) {
            return Err(row.place().wrong(format!("pose_id `{}` is there already, in {earlier}", pose.id)));
        }
        poses.push(pose);
    }
    if poses.is_empty() {
        return Err(Place::file(POSES).wrong("has no rows; there is no pose to import"));
    }
    if mode == Mode::Handeye && poses.iter().all(|pose| pose.kind != PoseKind::HandEye) {
        let what =
            "has no pose of kind `handeye`, but session.json says mode handeye; name the kind or say mode stereo";
        return Err(Place::file(POSES).wrong(what));
    }
    Ok(poses)
}

/// A table has all of these columns or none.
fn check_group(table: &Table, columns: &[&str]) -> Result<(), ImportError> {
    let (found, missing): (Vec<_>, Vec<_>) = columns.iter().copied().partition(|column| table.has(column));
    if found.is_empty() || missing.is_empty() {
        return Ok(());
    }
    let what = format!("column {} is missing, but {} is there", missing.join(", "), found.join(", "));
    Err(table.header_place().wrong(what))
}

fn read_pose(row: &Row<'_>, mode: Mode) -> Result<Pose, ImportError> {
    let kind = kind(row, mode)?;
    Ok(Pose {
        id: row.text("pose_id")?.into(),
        kind,
        pair: row.text_or_empty("pair").into(),
        still_host_s: still_host_s(row)?,
        base_from_tcp: base_from_tcp(row, mode, kind)?,
        joints_rad: joints_rad(row)?,
        place: row.place(),
    })
}

/// In mode stereo the kind is free text, and every pose serves cameras and stereo.
fn kind(row: &Row<'_>, mode: Mode) -> Result<PoseKind, ImportError> {
    if mode == Mode::Stereo {
        return Ok(PoseKind::Intrinsics);
    }
    Ok(match row.text("kind")? {
        "handeye" => PoseKind::HandEye,
        "dist" | "distance" => PoseKind::Distance,
        _ => PoseKind::Intrinsics,
    })
}

fn still_host_s(row: &Row<'_>) -> Result<[f64; 2], ImportError> {
    let from_s = row.number("t_still_from_host_s", HOST_TIME_MAX_S, HOST_TIME_HINT)?;
    let to_s = row.number("t_still_to_host_s", HOST_TIME_MAX_S, HOST_TIME_HINT)?;
    if to_s > from_s {
        return Ok([from_s, to_s]);
    }
    Err(row.place().wrong(format!("t_still_to_host_s is {to_s}, not after t_still_from_host_s, which is {from_s}")))
}

/// The robot pose; without one (all absent, empty or zero) a pose can only serve cameras and stereo.
fn base_from_tcp(row: &Row<'_>, mode: Mode, kind: PoseKind) -> Result<Option<Transform<Base, Tcp>>, ImportError> {
    let mut pose = [0.0; 6];
    if !row.all_empty(&POSE) {
        for (value, column) in pose.iter_mut().zip(POSITION) {
            *value = row.number(column, DISTANCE_MAX_M, "is it in millimetres? it must be in metres")?;
        }
        for (value, column) in pose.iter_mut().skip(3).zip(ROTATION) {
            *value = row.number(column, ANGLE_MAX_RAD, "is it in degrees? it must be in radians")?;
        }
    }
    if pose != [0.0; 6] {
        return Ok(Some(Transform::from_pose_vector(pose)));
    }
    if mode == Mode::Handeye && kind != PoseKind::Intrinsics {
        return Err(row.place().wrong("x, y, z, rx, ry, rz are empty or all zero, but its kind needs a robot pose"));
    }
    Ok(None)
}

/// All zero, empty or absent means unknown.
fn joints_rad(row: &Row<'_>) -> Result<Option<Joints>, ImportError> {
    if row.all_empty(&JOINTS) {
        return Ok(None);
    }
    let mut joints_rad = [0.0; 6];
    for (value, column) in joints_rad.iter_mut().zip(JOINTS) {
        *value = row.number(column, ANGLE_MAX_RAD, "is it in degrees? it must be in radians")?;
    }
    Ok((joints_rad != [0.0; 6]).then_some(joints_rad))
}

/// Reads `pairs.csv` and holds it against the `pair` column of the poses; none where there is no such file.
pub(super) fn read_pairs(source: &mut Source, poses: &[Pose]) -> Result<Vec<DistancePair>, ImportError> {
    if !source.has(PAIRS) {
        let named = poses.iter().filter(|pose| !pose.pair.is_empty()).count();
        if named > 0 {
            source.note(format!("{named} poses name a pair, but {PAIRS} is missing: their distances are not checked"));
        }
        return Ok(Vec::new());
    }
    let table = Table::read(source, PAIRS, &["pair", "pose_a", "pose_b", "d_gt_m"], &[])?;
    let mut pairs: Vec<DistancePair> = Vec::new();
    for row in table.rows() {
        let pair = read_pair(&row, poses)?;
        if pairs.iter().any(|earlier| earlier.name == pair.name) {
            return Err(row.place().wrong(format!("pair `{}` is there already", pair.name)));
        }
        pairs.push(pair);
    }
    check_membership(poses, &pairs)?;
    Ok(pairs)
}

fn read_pair(row: &Row<'_>, poses: &[Pose]) -> Result<DistancePair, ImportError> {
    let pose = |column: &str| {
        let id = row.text(column)?;
        let known = poses.iter().any(|pose| pose.id == id);
        let unknown = || row.place().wrong(format!("{column} is `{id}`, which is no pose_id in {POSES}"));
        if known { Ok(id.to_owned()) } else { Err(unknown()) }
    };
    let (name, pose_a, pose_b) = (row.text("pair")?.to_owned(), pose("pose_a")?, pose("pose_b")?);
    if pose_a == pose_b {
        return Err(row.place().wrong(format!("pose_a and pose_b are both `{pose_a}`")));
    }
    let truth_m = row.number("d_gt_m", DISTANCE_MAX_M, "is it in millimetres? it must be in metres")?;
    if truth_m > 0.0 {
        return Ok(DistancePair { name, pose_a, pose_b, truth_m });
    }
    Err(row.place().wrong(format!("d_gt_m is {truth_m}, a distance is above 0")))
}

/// A pose that names a pair must be one of the two in it.
fn check_membership(poses: &[Pose], pairs: &[DistancePair]) -> Result<(), ImportError> {
    for pose in poses.iter().filter(|pose| !pose.pair.is_empty()) {
        let named = &pose.pair;
        let Some(pair) = pairs.iter().find(|pair| pair.name == *named) else {
            return Err(pose.place.wrong(format!("pair is `{named}`, which {PAIRS} does not have")));
        };
        if pose.id != pair.pose_a && pose.id != pair.pose_b {
            let DistancePair { pose_a, pose_b, .. } = pair;
            return Err(pose
                .place
                .wrong(format!("pair is `{named}`, which {PAIRS} says is `{pose_a}` and `{pose_b}`")));
        }
    }
    Ok(())
}
