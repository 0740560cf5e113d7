//! A cell without a robot: an operator moves the display or the cameras by hand.

use std::borrow::Cow;
use std::fmt;

use garde::Validate;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use super::cell_file::RobotFile;

/// How a session without a robot is run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Handheld {
    /// Captures of a whole session.
    #[garde(range(min = 5, max = 500))]
    pub poses: u32,
    /// The corners count as still while they move less than this from look to look, px.
    #[garde(range(min = 0.02, max = 20.0))]
    pub motion_px: f64,
    /// They must be still for this long, s.
    #[garde(range(min = 0.1, max = 30.0))]
    pub hold_s: f64,
}

impl Default for Handheld {
    fn default() -> Self {
        Self { poses: 30, motion_px: 1.0, hold_s: 0.4 }
    }
}

/// The key `robot`: `none`, or a map.
#[derive(Debug)]
pub(super) enum RobotChoice {
    /// Nobody moves but the operator.
    None,
    /// An arm.
    Arm(Box<RobotFile>),
}

impl RobotChoice {
    pub(super) fn arm(&self) -> Option<&RobotFile> {
        match self {
            Self::None => None,
            Self::Arm(file) => Some(file),
        }
    }
}

impl<'de> Deserialize<'de> for RobotChoice {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(OfRobot)
    }
}

struct OfRobot;

impl<'de> Visitor<'de> for OfRobot {
    type Value = RobotChoice;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a map with the keys of an arm, or `none`")
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<RobotChoice, E> {
        if text == "none" {
            Ok(RobotChoice::None)
        } else {
            Err(E::invalid_value(serde::de::Unexpected::Str(text), &self))
        }
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<RobotChoice, A::Error> {
        let file = RobotFile::deserialize(MapAccessDeserializer::new(map))?;
        Ok(RobotChoice::Arm(Box::new(file)))
    }
}

impl Validate for RobotChoice {
    type Context = ();

    fn validate_into(&self, context: &(), parent: &mut dyn FnMut() -> garde::Path, report: &mut garde::Report) {
        if let Some(file) = self.arm() {
            file.validate_into(context, parent, report);
        }
    }
}

impl JsonSchema for RobotChoice {
    fn schema_name() -> Cow<'static, str> {
        "RobotOrNone".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let arm = generator.subschema_for::<RobotFile>();
        json_schema!({"anyOf": [arm, {"description": "The display or the cameras are moved by hand.", "const": "none"}]})
    }
}
