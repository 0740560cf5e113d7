//! A trajectory file as it is written: the keys, their units and their ranges.

use garde::Validate;
use garde::error::{Path, Report};
use schemars::JsonSchema;
use serde::Deserialize;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, Error as _, MapAccess, Visitor};

use super::pose::{Degrees, Metres, Millimetres, PoseFile, Radians};
use super::trajectory::Motion;
use crate::calibration::settings::PoseKind;
use crate::geometry::Camera;

/// The poses to visit, or the patterns that make them.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "trajectory", rename = "Trajectory")]
#[garde(allow_unvalidated)]
pub(super) struct TrajectoryFile {
    /// Letters, digits, `-` and `_`; the ids of the poses begin with it.
    pub(super) name: String,
    /// The parts, in order. Each begins with its `pattern`.
    #[garde(dive)]
    #[schemars(length(min = 1))]
    pub(super) segments: Vec<SegmentFile>,
}

macro_rules! segments {
    ($($(#[$doc:meta])* $name:ident($file:ident) = $word:literal;)*) => {
        /// A part of a trajectory; its first key is `pattern`.
        #[derive(Debug, JsonSchema)]
        #[schemars(tag = "pattern", rename = "Segment")]
        pub(super) enum SegmentFile {
            $($(#[$doc])* #[schemars(rename = $word)] $name($file),)*
        }

        #[derive(Deserialize)]
        enum PatternName {
            $(#[serde(rename = $word)] $name,)*
        }

        impl SegmentFile {
            fn rest<'de, A: MapAccess<'de>>(pattern: PatternName, map: A) -> Result<Self, A::Error> {
                let rest = MapAccessDeserializer::new(map);
                Ok(match pattern {
                    $(PatternName::$name => Self::$name($file::deserialize(rest)?),)*
                })
            }
        }

        impl Validate for SegmentFile {
            type Context = ();
            fn validate_into(&self, ctx: &(), parent: &mut dyn FnMut() -> Path, report: &mut Report) {
                match self {
                    $(Self::$name(segment) => segment.validate_into(ctx, parent, report),)*
                }
            }
        }

        const PATTERNS: &[&str] = &[$($word,)*];
    };
}

segments! {
    /// Joint positions.
    Joints(JointsFile) = "joints";
    /// Poses of the TCP in the base of the robot.
    Tcp(TcpFile) = "tcp";
    /// Views of the board.
    Views(ViewsFile) = "views";
    /// The board over a grid in the image plane, row by row, every second row backwards.
    Grid(GridFile) = "grid";
    /// The board along the optical axis.
    Depth(DepthFile) = "depth";
    /// The board turned about the optical axis.
    Roll(RollFile) = "roll";
    /// From one view to another, both included.
    Sweep(SweepFile) = "sweep";
    /// The board tilted to all sides while its centre stays in place.
    Orbit(OrbitFile) = "orbit";
    /// Pairs of poses, apart by a known displacement.
    Translate(TranslateFile) = "translate";
}

/// Reads `pattern` first and then the keys of that pattern straight from the text.
///
/// serde's own internally tagged enums copy the mapping first and lose every line and column.
impl<'de> Deserialize<'de> for SegmentFile {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        d.deserialize_map(SegmentVisitor)
    }
}

struct SegmentVisitor;

impl<'de> Visitor<'de> for SegmentVisitor {
    type Value = SegmentFile;

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("a mapping of keys")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<SegmentFile, A::Error> {
        if map.next_key::<String>()?.as_deref() != Some("pattern") {
            let known = PATTERNS.join(", ");
            let why = format!("does not begin with its pattern: write `- pattern: NAME` first, one of: {known}");
            return Err(A::Error::custom(why));
        }
        let pattern = map.next_value()?;
        SegmentFile::rest(pattern, map)
    }
}

/// Joint positions.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub(super) struct JointsFile {
    /// How the stops are approached.
    #[serde(default, rename = "move")]
    pub(super) motion: Motion,
    /// What its stops are for; absent: what the cell says of the file.
    pub(super) purpose: Option<PoseKind>,
    /// The stops.
    #[garde(dive)]
    pub(super) poses: Vec<JointsStop>,
}

/// Joint positions of one stop.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub(super) struct JointsStop {
    /// Id; absent: the name of the trajectory and a number.
    pub(super) id: Option<String>,
    /// Joint positions from base to wrist, degrees.
    #[garde(inner(range(min = -360.0, max = 360.0)))]
    pub(super) joints_deg: [f64; 6],
}

/// Poses of the TCP.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub(super) struct TcpFile {
    /// How the stops are approached.
    #[serde(default, rename = "move")]
    pub(super) motion: Motion,
    /// What its stops are for; absent: what the cell says of the file.
    pub(super) purpose: Option<PoseKind>,
    /// The stops.
    #[garde(dive)]
    pub(super) poses: Vec<TcpStop>,
}

/// `base_from_tcp` of one stop.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub(super) struct TcpStop {
    /// Id; absent: the name of the trajectory and a number.
    pub(super) id: Option<String>,
    /// Pose of the TCP in the base of the robot.
    #[garde(dive)]
    pub(super) pose: PoseFile,
}

/// Views of the board.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub(super) struct ViewsFile {
    /// How the stops are approached.
    #[serde(default, rename = "move")]
    pub(super) motion: Motion,
    /// What its stops are for; absent: what the cell says of the file.
    pub(super) purpose: Option<PoseKind>,
    /// The camera that the views are for; absent, or not in the cell: the reference camera.
    pub(super) camera: Option<Camera>,
    /// The stops.
    #[garde(dive)]
    pub(super) poses: Vec<ViewStop>,
}

/// One stop that is a view.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub(super) struct ViewStop {
    /// Id; absent: the name of the trajectory and a number.
    pub(super) id: Option<String>,
    /// How the board lies before the camera.
    #[garde(dive)]
    pub(super) view: ViewFile,
}

/// How the board lies before the camera.
#[derive(Debug, Clone, Copy, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "View")]
pub(super) struct ViewFile {
    /// Centre of the board in the camera (x right, y down, z forward), metres.
    #[garde(dive)]
    pub(super) centre_m: Option<Metres>,
    /// Centre of the board in the camera (x right, y down, z forward), millimetres.
    #[garde(dive)]
    pub(super) centre_mm: Option<Millimetres>,
    /// Rotation vector of `camera_from_target`, degrees; absent: square to the camera and upright.
    #[garde(dive)]
    pub(super) rotvec_deg: Option<Degrees>,
    /// Rotation vector of `camera_from_target`, radians.
    #[garde(dive)]
    pub(super) rotvec_rad: Option<Radians>,
}

/// A grid in the image plane.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub(super) struct GridFile {
    /// How the stops are approached.
    #[serde(default, rename = "move")]
    pub(super) motion: Motion,
    /// What its stops are for; absent: what the cell says of the file.
    pub(super) purpose: Option<PoseKind>,
    /// The camera that the views are for; absent, or not in the cell: the reference camera.
    pub(super) camera: Option<Camera>,
    /// The middle of the grid.
    #[garde(dive)]
    pub(super) view: ViewFile,
    /// Stops along x.
    #[garde(range(min = 1, max = 100))]
    pub(super) columns: u32,
    /// Stops along y.
    #[garde(range(min = 1, max = 100))]
    pub(super) rows: u32,
    /// Distance along x and y, millimetres.
    #[garde(inner(range(min = -1000.0, max = 1000.0)))]
    pub(super) step_mm: [f64; 2],
}

/// Along the optical axis.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub(super) struct DepthFile {
    /// How the stops are approached.
    #[serde(default, rename = "move")]
    pub(super) motion: Motion,
    /// What its stops are for; absent: what the cell says of the file.
    pub(super) purpose: Option<PoseKind>,
    /// The camera that the views are for; absent, or not in the cell: the reference camera.
    pub(super) camera: Option<Camera>,
    /// The middle.
    #[garde(dive)]
    pub(super) view: ViewFile,
    /// Number of stops.
    #[garde(range(min = 1, max = 1000))]
    pub(super) count: u32,
    /// Distance between stops, millimetres; positive: away from the camera.
    #[garde(range(min = -1000.0, max = 1000.0))]
    pub(super) step_mm: f64,
}

/// About the optical axis.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub(super) struct RollFile {
    /// How the stops are approached.
    #[serde(default, rename = "move")]
    pub(super) motion: Motion,
    /// What its stops are for; absent: what the cell says of the file.
    pub(super) purpose: Option<PoseKind>,
    /// The camera that the views are for; absent, or not in the cell: the reference camera.
    pub(super) camera: Option<Camera>,
    /// The middle.
    #[garde(dive)]
    pub(super) view: ViewFile,
    /// Number of stops.
    #[garde(range(min = 1, max = 1000))]
    pub(super) count: u32,
    /// Angle between stops, degrees.
    #[garde(range(min = -180.0, max = 180.0))]
    pub(super) step_deg: f64,
}

/// Between two views.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub(super) struct SweepFile {
    /// How the stops are approached.
    #[serde(default, rename = "move")]
    pub(super) motion: Motion,
    /// What its stops are for; absent: what the cell says of the file.
    pub(super) purpose: Option<PoseKind>,
    /// The camera that the views are for; absent, or not in the cell: the reference camera.
    pub(super) camera: Option<Camera>,
    /// First view.
    #[garde(dive)]
    pub(super) from: ViewFile,
    /// Last view.
    #[garde(dive)]
    pub(super) to: ViewFile,
    /// Number of stops.
    #[garde(range(min = 2, max = 1000))]
    pub(super) count: u32,
}

/// Tilts to all sides.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub(super) struct OrbitFile {
    /// How the stops are approached.
    #[serde(default, rename = "move")]
    pub(super) motion: Motion,
    /// What its stops are for; absent: what the cell says of the file.
    pub(super) purpose: Option<PoseKind>,
    /// The camera that the views are for; absent, or not in the cell: the reference camera.
    pub(super) camera: Option<Camera>,
    /// Rings of equal tilt, in order.
    #[garde(dive)]
    pub(super) rings: Vec<RingFile>,
}

/// Stops of equal tilt, one for each azimuth.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Ring")]
#[garde(allow_unvalidated)]
pub(super) struct RingFile {
    /// Distance of the board's centre along the optical axis, millimetres.
    #[garde(range(min = 10.0, max = 10000.0))]
    pub(super) distance_mm: f64,
    /// The centre's distance from the axis, right and down, millimetres.
    #[serde(default)]
    #[garde(inner(range(min = -5000.0, max = 5000.0)))]
    pub(super) offset_mm: [f64; 2],
    /// Angle between optical axis and the normal of the board, degrees.
    #[garde(range(min = 0.0, max = 75.0))]
    pub(super) tilt_deg: f64,
    /// Number of azimuths, spread evenly.
    #[garde(range(min = 1, max = 360))]
    pub(super) count: u32,
    /// First azimuth: the axis of the tilt, from x towards y, degrees.
    #[serde(default)]
    #[garde(range(min = -360.0, max = 360.0))]
    pub(super) first_azimuth_deg: f64,
    /// Turns of the board in its own plane, one after the other and again from the first, degrees.
    #[serde(default)]
    #[garde(inner(range(min = -180.0, max = 180.0)))]
    pub(super) rolls_deg: Vec<f64>,
}

/// Pairs for the distance check.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub(super) struct TranslateFile {
    /// How both stops of a pair are approached.
    #[serde(default = "linear", rename = "move")]
    pub(super) motion: Motion,
    /// What its stops are for; absent: what the cell says of the file.
    pub(super) purpose: Option<PoseKind>,
    /// The camera that the views are for; absent, or not in the cell: the reference camera.
    pub(super) camera: Option<Camera>,
    /// The pairs.
    #[garde(dive)]
    pub(super) pairs: Vec<PairFile>,
}

fn linear() -> Motion {
    Motion::Linear
}

/// Two poses, apart by a known displacement.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Pair")]
#[garde(allow_unvalidated)]
pub(super) struct PairFile {
    /// Name of the pair; the ids of its poses are `<trajectory>-<name>-a` and `-b`.
    pub(super) name: String,
    /// Where it begins: `view:` or `tcp:`.
    #[garde(dive)]
    pub(super) start: StartFile,
    /// From the first TCP position to the second, in the base of the robot, millimetres.
    #[garde(inner(range(min = -2000.0, max = 2000.0)))]
    pub(super) displacement_mm: [f64; 3],
    /// The distance as something better than the robot measured it, millimetres.
    #[garde(range(min = 0.1, max = 5000.0))]
    pub(super) known_mm: Option<f64>,
}

/// Where a pair begins; one of the two.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Start")]
pub(super) struct StartFile {
    /// At a view.
    #[garde(dive)]
    pub(super) view: Option<ViewFile>,
    /// At a pose of the TCP in the base of the robot.
    #[garde(dive)]
    pub(super) tcp: Option<PoseFile>,
}
