//! Positions and rotations as files write them, in the unit of the key.

use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;

use super::error::Findings;
use super::source::join;
use crate::geometry::{Transform, rotation};

macro_rules! triples {
    ($($(#[$doc:meta])* $name:ident within $min:literal to $max:literal;)*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Deserialize, Validate, JsonSchema)]
        #[serde(transparent)]
        #[schemars(inline)]
        #[garde(transparent)]
        pub(super) struct $name(#[garde(inner(range(min = $min, max = $max)))] pub(super) [f64; 3]);
    )*};
}

triples! {
    /// x, y, z in metres.
    Metres within -10.0 to 10.0;
    /// x, y, z in millimetres.
    Millimetres within -10000.0 to 10000.0;
    /// Axis times angle in degrees.
    Degrees within -360.0 to 360.0;
    /// Axis times angle in radians.
    Radians within -6.3 to 6.3;
}

/// A position and a rotation vector (axis times angle), each in one of two units.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Pose")]
pub(super) struct PoseFile {
    /// Position in metres.
    #[garde(dive)]
    xyz_m: Option<Metres>,
    /// Position in millimetres.
    #[garde(dive)]
    xyz_mm: Option<Millimetres>,
    /// Rotation vector in degrees.
    #[garde(dive)]
    rotvec_deg: Option<Degrees>,
    /// Rotation vector in radians.
    #[garde(dive)]
    rotvec_rad: Option<Radians>,
}

impl PoseFile {
    /// The transform; `path` is where it stands in the file.
    pub(super) fn transform<To, From>(&self, path: &str, findings: &mut Findings<'_>) -> Transform<To, From> {
        let &Self { xyz_m, xyz_mm, rotvec_deg, rotvec_rad } = self;
        let translation_m = position_m("xyz", xyz_m, xyz_mm, path, findings);
        let rotvec_rad = rotvec_in_rad(rotvec_deg, rotvec_rad, path, findings).unwrap_or_else(|| {
            findings.missing(path, "rotvec_deg", "give the rotation as rotvec_deg or rotvec_rad, [0, 0, 0] for none");
            [0.0; 3]
        });
        // The key of the file names the two frames.
        Transform::from_parts(translation_m, rotation::from_vector(rotvec_rad))
    }
}

/// The one position of the two, in metres.
pub(super) fn position_m(
    name: &str,
    metres: Option<Metres>,
    millimetres: Option<Millimetres>,
    path: &str,
    findings: &mut Findings<'_>,
) -> [f64; 3] {
    match (metres, millimetres) {
        (Some(Metres(m)), None) => m,
        (None, Some(Millimetres(mm))) => mm.map(|v| v / 1e3),
        (Some(_), Some(_)) => {
            findings.add(&join(path, &format!("{name}_mm")), format!("stands beside {name}_m: give one of the two"));
            [0.0; 3]
        }
        (None, None) => {
            findings.missing(path, &format!("{name}_m"), &format!("give the position as {name}_m or {name}_mm"));
            [0.0; 3]
        }
    }
}

/// The one rotation vector of the two, in radians; `None` where there is none.
pub(super) fn rotvec_in_rad(
    degrees: Option<Degrees>,
    radians: Option<Radians>,
    path: &str,
    findings: &mut Findings<'_>,
) -> Option<[f64; 3]> {
    if degrees.is_some() && radians.is_some() {
        findings.add(&join(path, "rotvec_rad"), "stands beside rotvec_deg: give one of the two");
    }
    radians.map(|Radians(v)| v).or_else(|| degrees.map(|Degrees(v)| v.map(f64::to_radians)))
}
