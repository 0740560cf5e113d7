//! A file about the topics of a recording as it is written, and what one range cannot say about it.

use std::collections::BTreeSet;

use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;

use super::cell::ChecksCell;
use super::cell_convert::{board, metres};
use super::cell_file::{BoardFile, ChecksFile};
use super::error::Findings;
use super::pose::PoseFile;
use super::topics::{
    EventTopic, ImageTopic, Interval, PairBy, RobotTopic, StampOf, StillRule, Stops, Topics, TopicsMode,
};
use crate::calibration::settings::{Carried, PoseKind};
use crate::geometry::Transform;

/// What the topics of a recording by others mean.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "topics", rename = "Topics")]
#[garde(allow_unvalidated)]
pub(super) struct TopicsFile {
    /// `stereo` (cameras and stereo only) or `handeye`.
    mode: TopicsMode,
    /// What the robot carries: the display (`target`) or the `cameras`.
    #[serde(default)]
    carried: Carried,
    /// The ChArUco board.
    #[garde(dive)]
    board: BoardFile,
    /// Images of the frame camera.
    #[garde(dive)]
    rgb: Option<ImageTopicFile>,
    /// Packets of the event camera.
    #[garde(dive)]
    event: Option<EventTopicFile>,
    /// Where the arm was: `joints` or `tf`.
    #[garde(dive)]
    robot: Option<RobotTopicFile>,
    /// How the poses are found: `still`, `intervals` or `each_image`.
    #[garde(dive)]
    stops: StopsFile,
    /// Truth for the checks.
    #[garde(dive)]
    checks: Option<ChecksFile>,
}

/// Images of the frame camera.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "ImageTopic")]
#[garde(allow_unvalidated)]
struct ImageTopicFile {
    /// The topic; messages of `sensor_msgs/msg/Image`, `CompressedImage` or the same of Foxglove.
    topic: String,
    /// Columns.
    #[garde(range(min = 1, max = 65535))]
    width: u32,
    /// Rows.
    #[garde(range(min = 1, max = 65535))]
    height: u32,
    /// Length of an exposure, seconds.
    #[garde(range(min = 1e-6, max = 100.0))]
    exposure_s: f64,
    /// Images a second; without trigger edges the event window of an image lasts as long as from one to the next.
    #[garde(range(min = 0.001, max = 1e5))]
    images_per_s: f64,
    /// Which moment the stamp of an image is.
    stamp: StampOf,
}

/// Packets of the event camera.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "EventTopic")]
#[garde(allow_unvalidated)]
struct EventTopicFile {
    /// The topic; messages of `event_camera_msgs/msg/EventPacket` with encoding `evt3`, `evt2` or `evt21`.
    topic: String,
    /// Columns.
    #[garde(range(min = 1, max = 2048))]
    width: u32,
    /// Rows.
    #[garde(range(min = 1, max = 2048))]
    height: u32,
    /// Trigger input that carries the exposure signal.
    #[serde(default)]
    #[garde(range(min = 0, max = 31))]
    trigger_channel: u8,
    /// By what images and events are paired: `auto`, `trigger` or `arrival`.
    #[serde(default)]
    paired_by: PairBy,
}

/// Where the arm was; one of the two.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "RobotTopic")]
struct RobotTopicFile {
    /// Joint positions, `sensor_msgs/msg/JointState`.
    #[garde(dive)]
    joints: Option<JointsFile>,
    /// Transforms, `tf2_msgs/msg/TFMessage`.
    #[garde(dive)]
    tf: Option<TfFile>,
}

/// Joint positions; the pose follows from a model of the arm.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Joints")]
#[garde(allow_unvalidated)]
struct JointsFile {
    /// The topic.
    topic: String,
    /// What stands before the names of the joints.
    #[serde(default)]
    prefix: String,
    /// A URDF instead of the nominal UR5e, relative to this file; links `base` and `flange`.
    urdf: Option<String>,
    /// The TCP in the flange; absent: the flange is taken as the TCP.
    #[garde(dive)]
    tcp_offset: Option<PoseFile>,
}

/// Transforms between named frames.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Tf")]
#[garde(allow_unvalidated)]
struct TfFile {
    /// The topic.
    #[serde(default = "default_tf")]
    topic: String,
    /// The topic of those that never change.
    #[serde(default = "default_tf_static")]
    static_topic: String,
    /// Name of the base of the robot; the result is in this frame.
    base: String,
    /// Name of the tool.
    tcp: String,
}

fn default_tf() -> String {
    "/tf".into()
}

fn default_tf_static() -> String {
    "/tf_static".into()
}

/// How the poses are found; one of the three.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Stops")]
#[garde(allow_unvalidated)]
struct StopsFile {
    /// Wherever the arm stands still.
    #[garde(dive)]
    still: Option<StillFile>,
    /// As listed.
    #[garde(dive)]
    intervals: Option<Vec<IntervalFile>>,
    /// `true`: each image is a pose of its own; for recordings without a robot.
    each_image: Option<bool>,
}

/// What counts as standing still.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "Still")]
struct StillFile {
    /// For at least this long, seconds.
    #[garde(range(min = 0.05, max = 60.0))]
    hold_s: f64,
    /// Longest time between two samples of the robot, seconds.
    #[garde(range(min = 0.002, max = 2.0))]
    max_gap_s: f64,
    /// Largest joint speed, where the recording has speeds, rad/s.
    #[garde(range(min = 1e-6, max = 0.1))]
    joint_speed_rad_s: f64,
    /// Largest change of a joint during `hold_s`, rad.
    #[garde(range(min = 1e-7, max = 0.01))]
    joint_spread_rad: f64,
    /// Largest motion of the tool during `hold_s`, millimetres.
    #[garde(range(min = 0.001, max = 10.0))]
    tcp_spread_mm: f64,
    /// Largest turn of the tool during `hold_s`, degrees.
    #[garde(range(min = 0.001, max = 5.0))]
    tcp_turn_deg: f64,
}

impl Default for StillFile {
    fn default() -> Self {
        Self {
            hold_s: 0.5,
            max_gap_s: 0.2,
            joint_speed_rad_s: 0.01,
            joint_spread_rad: 0.001,
            tcp_spread_mm: 0.2,
            tcp_turn_deg: 0.05,
        }
    }
}

/// A time in which everything stood still.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Interval")]
#[garde(allow_unvalidated)]
struct IntervalFile {
    /// Id of the pose.
    id: String,
    /// Begin, seconds on the clock of the stamps in the messages.
    #[garde(range(min = 0.0, max = 1e10))]
    from_s: f64,
    /// End, seconds on the clock of the stamps in the messages.
    #[garde(range(min = 0.0, max = 1e10))]
    to_s: f64,
    /// What the pose is for; absent: `hand_eye` or, in mode stereo, `intrinsics`.
    kind: Option<PoseKind>,
}

/// Makes values of the keys; what is wrong with them is in the findings.
pub(super) fn topics(file: TopicsFile, findings: &mut Findings<'_>) -> Topics {
    if file.rgb.is_none() && file.event.is_none() {
        findings.missing("", "rgb", "give the topic of at least one camera, `rgb` or `event`");
    }
    if file.mode == TopicsMode::Handeye && file.robot.is_none() {
        findings.missing("", "robot", "mode handeye needs robot poses; add them or say `mode: stereo`");
    }
    let (rgb, event) = (file.rgb.map(|file| rgb(file, findings)), file.event.map(event));
    let robot = file.robot.and_then(|file| robot(file, findings));
    let stops = stops(file.stops, file.mode, [rgb.is_some(), robot.is_some()], findings);
    let board = board(file.board, findings);
    let checks = file.checks.map(|checks| {
        if board.check().is_ok() && board.corner(checks.corner_id).is_none() {
            let last = board.corner_count() - 1;
            findings.add("checks.corner_id", format!("is {}, outside 0 to {last}", checks.corner_id));
        }
        ChecksCell { corner_id: checks.corner_id, target_to_tcp_m: checks.target_to_tcp_mm.map(metres) }
    });
    Topics { mode: file.mode, carried: file.carried, board, rgb, event, robot, stops, checks }
}

fn rgb(file: ImageTopicFile, findings: &mut Findings<'_>) -> ImageTopic {
    let ImageTopicFile { topic, width, height, exposure_s, images_per_s, stamp } = file;
    if exposure_s * images_per_s > 1.01 {
        let what = format!("is {exposure_s}, longer than from one image to the next at {images_per_s} a second");
        findings.add("rgb.exposure_s", format!("{what}: is it in seconds?"));
    }
    ImageTopic { topic, width, height, exposure_s, images_per_s, stamp }
}

fn event(file: EventTopicFile) -> EventTopic {
    let EventTopicFile { topic, width, height, trigger_channel, paired_by } = file;
    EventTopic { topic, width, height, trigger_channel, paired_by }
}

fn robot(file: RobotTopicFile, findings: &mut Findings<'_>) -> Option<RobotTopic> {
    match (file.joints, file.tf) {
        (Some(JointsFile { topic, prefix, urdf, tcp_offset }), None) => {
            let at = "robot.joints.tcp_offset";
            let flange_from_tcp = tcp_offset.map_or_else(Transform::identity, |pose| pose.transform(at, findings));
            Some(RobotTopic::Joints { topic, prefix, urdf, flange_from_tcp })
        }
        (None, Some(TfFile { topic, static_topic, base, tcp })) => {
            if base == tcp {
                findings.add("robot.tf.tcp", format!("is {tcp:?}, as `base` is: give two frames"));
            }
            Some(RobotTopic::Tf { topic, static_topic, base, tcp })
        }
        (Some(_), Some(_)) => {
            findings.add("robot", "has both `joints` and `tf`: give one of the two");
            None
        }
        (None, None) => {
            findings.missing("robot", "joints", "give `joints` or `tf`");
            None
        }
    }
}

/// `has`: images, and a robot.
fn stops(file: StopsFile, mode: TopicsMode, has: [bool; 2], findings: &mut Findings<'_>) -> Stops {
    let [has_images, has_robot] = has;
    let StopsFile { still, intervals, each_image } = file;
    if each_image == Some(false) {
        findings.add("stops.each_image", "is false: leave it out, or say true");
    }
    match (still, intervals, each_image) {
        (Some(still), None, None) => {
            if !has_robot {
                findings.add("stops.still", "needs `robot`: without one give `intervals` or `each_image: true`");
            }
            Stops::Still(StillRule {
                hold_s: still.hold_s,
                max_gap_s: still.max_gap_s,
                joint_speed_rad_s: still.joint_speed_rad_s,
                joint_spread_rad: still.joint_spread_rad,
                tcp_spread_m: metres(still.tcp_spread_mm),
                tcp_turn_rad: still.tcp_turn_deg.to_radians(),
            })
        }
        (None, Some(list), None) => Stops::Intervals(intervals_of(list, mode, findings)),
        (None, None, each_image) => {
            if each_image.is_none() {
                findings.missing("stops", "still", "give `still`, `intervals` or `each_image: true`");
            } else if has_robot {
                findings.add("stops.each_image", "is for recordings without a robot: give `still` or `intervals`");
            } else if !has_images {
                findings.add("stops.each_image", "needs `rgb`: give `intervals`");
            }
            Stops::EachImage
        }
        _ => {
            findings.add("stops", "has more than one of `still`, `intervals` and `each_image`: give one");
            Stops::EachImage
        }
    }
}

fn intervals_of(list: Vec<IntervalFile>, mode: TopicsMode, findings: &mut Findings<'_>) -> Vec<Interval> {
    if list.is_empty() {
        findings.add("stops.intervals", "is empty: list at least one");
    }
    let kind_of_mode = if mode == TopicsMode::Handeye { PoseKind::HandEye } else { PoseKind::Intrinsics };
    let (mut ids, mut last_s) = (BTreeSet::new(), f64::NEG_INFINITY);
    let mut intervals = Vec::new();
    for (i, IntervalFile { id, from_s, to_s, kind }) in list.into_iter().enumerate() {
        let at = |key: &str| format!("stops.intervals[{i}].{key}");
        if !ids.insert(id.clone()) {
            findings.add(&at("id"), format!("is {id:?}, the id of an earlier one: give each its own"));
        }
        if to_s <= from_s {
            findings.add(&at("to_s"), format!("is {to_s}, not after from_s, which is {from_s}"));
        }
        if from_s < last_s {
            findings.add(
                &at("from_s"),
                format!("is {from_s}, before the end of the one before, {last_s}: list them in order of time"),
            );
        }
        last_s = to_s;
        intervals.push(Interval { id, from_s, to_s, kind: kind.unwrap_or(kind_of_mode) });
    }
    intervals
}

#[cfg(test)]
mod tests {
    use super::super::parse_topics;
    use super::*;

    const MAP: &str = include_str!("../../tests/maps/joints.yaml");

    fn said(from: &str, to: &str) -> String {
        assert_eq!(MAP.matches(from).count(), 1, "{from:?}");
        parse_topics(&MAP.replace(from, to), "topics.yaml").unwrap_err().to_string()
    }

    #[test]
    fn the_shipped_map_is_what_it_says() {
        let map = parse_topics(MAP, "topics.yaml").unwrap();
        let event = map.event.unwrap();
        assert_eq!((event.trigger_channel, event.paired_by), (0, PairBy::Auto));
        assert_eq!(map.rgb.unwrap().stamp, StampOf::ExposureStart);
        assert!(matches!(map.stops, Stops::Still(StillRule { hold_s: 0.5, max_gap_s: 0.2, .. })));
        let Some(RobotTopic::Joints { flange_from_tcp, .. }) = map.robot else { panic!("no joints") };
        assert_eq!(flange_from_tcp.translation_m(), [0.0, 0.0, 0.04]);
    }

    #[test]
    fn what_is_wrong_is_said_with_line_key_and_fix() {
        for (from, to, message) in [
            (
                "images_per_s: 10",
                "images_per_s: 20",
                "rgb.exposure_s is 0.0999, longer than from one image to the next at 20 a second",
            ),
            (
                "stamp: exposure_start ",
                "stamp: middle ",
                "rgb.stamp is \"middle\", not one of: exposure_start, exposure_end",
            ),
            ("mode: handeye ", "mode: eye ", "mode is \"eye\", not one of: stereo, handeye"),
            ("corner_id: 9", "corner_id: 24", "checks.corner_id is 24, outside 0 to 23"),
            ("hold_s: 0.5", "hold_s: 500", "stops.still.hold_s is 500, outside 0.05 to 60"),
            (
                "  still: {hold_s",
                "  each_image: true\\n  still: {hold_s",
                "stops has more than one of `still`, `intervals` and `each_image`: give one",
            ),
            (
                "  still: {hold_s: 0.5, joint_spread_rad: 0.001, joint_speed_rad_s: 0.01}",
                "  each_image: true",
                "stops.each_image is for recordings without a robot: give `still` or `intervals`",
            ),
            (
                "  still: {hold_s: 0.5, joint_spread_rad: 0.001, joint_speed_rad_s: 0.01}",
                "  intervals: [{id: a, from_s: 2, to_s: 1}]",
                "stops.intervals[0].to_s is 1, not after from_s, which is 2",
            ),
            (
                "  still: {hold_s: 0.5, joint_spread_rad: 0.001, joint_speed_rad_s: 0.01}",
                "  intervals: [{id: a, from_s: 1, to_s: 3}, {id: a, from_s: 2, to_s: 4}]",
                "stops.intervals[1].id is \"a\", the id of an earlier one: give each its own",
            ),
            ("prefix: \"\" ", "tf: 1 ", "unknown key `tf` in `robot.joints`"),
        ] {
            let said = said(from, &to.replace("\\n", "\n"));
            let place = said.strip_prefix("topics.yaml:").unwrap_or_else(|| panic!("{said}"));
            assert!(
                place.starts_with(|c: char| c.is_ascii_digit()) && said.contains(message),
                "{said}\nnot: {message}"
            );
        }
        let empty = parse_topics(
            "mode: handeye\nboard: {dictionary: DICT_4X4_50, squares_x: 7, squares_y: 5, square_mm: 9, marker_mm: 7}\nstops: {}\n",
            "t.yaml",
        );
        let said = empty.unwrap_err().to_string();
        for part in ["key `rgb` is missing", "key `robot` is missing", "stops has no key `still`"] {
            assert!(said.contains(part), "{part} not in {said}");
        }
    }
}
