//! The cell around the arm: interlocks, signals, who moves, how a session ends, and what the arm carries as shapes.

use garde::Validate;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A digital input that must keep a value while the arm may move; its loss stops the arm.
///
/// Inputs 0 to 7 are the standard ones, 8 to 15 the configurable ones, 16 and 17 those of the tool.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub struct Interlock {
    /// Number of the input, 0 to 17.
    #[garde(range(min = 0, max = 17))]
    pub digital_input: u8,
    /// The value that lets the arm move.
    pub must_be: bool,
    /// What it means, for messages: `cell released`.
    pub meaning: String,
}

impl Interlock {
    /// Whether these input bits let the arm move.
    pub fn is_kept(&self, digital_inputs: u64) -> bool {
        (digital_inputs >> self.digital_input & 1 == 1) == self.must_be
    }
}

/// Outputs that tell others what is going on; standard 0 to 7, configurable 8 to 15, tool 16 and 17.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[garde(allow_unvalidated)]
pub struct Signals {
    /// On from the first move to the end of the session.
    #[garde(dive)]
    pub calibrating: Option<DigitalOutput>,
}

/// A digital output of the controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DigitalOutput {
    /// Number of the output, 0 to 17.
    #[garde(range(min = 0, max = 17))]
    pub digital_output: u8,
}

/// Who moves the arm.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MotionBy {
    /// Our script, uploaded once per session.
    #[default]
    Script,
    /// A program of the plant; we watch, capture and answer.
    External(External),
}

/// The handshake with a program of the plant.
///
/// It moves to a pose and sets `at_pose`; we capture and set `captured`; it clears `at_pose`, we clear
/// `captured`, and it moves on. The poses of the trajectories are then where the arm is expected.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct External {
    /// What their program sets when the arm is at a pose.
    pub at_pose: Line,
    /// What we set when everything is captured.
    pub captured: Line,
    /// Longest time from one pose to the next, s.
    #[serde(default = "default_patience_s")]
    pub patience_s: f64,
}

fn default_patience_s() -> f64 {
    60.0
}

/// One bit between two programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Line {
    /// A digital output of the controller, 0 to 17.
    DigitalOutput(u8),
    /// A general-purpose bit register, 64 to 127: an output register for `at_pose`, an input one for `captured`.
    BitRegister(u8),
}

impl Line {
    pub(super) fn problem(self) -> Option<String> {
        match self {
            Self::DigitalOutput(0..=17) | Self::BitRegister(64..=127) => None,
            Self::DigitalOutput(n) => Some(format!("has digital_output {n}, outside 0 to 17")),
            Self::BitRegister(n) => Some(format!("has bit_register {n}, outside 64 to 127")),
        }
    }
}

/// A capsule fixed to the flange: tool, gripper, display or camera bracket.
#[derive(Debug, Clone, PartialEq)]
pub struct ToolShape {
    /// What it is, for messages.
    pub name: String,
    /// One end of its axis in the flange, m.
    pub from_m: [f64; 3],
    /// The other end, m.
    pub to_m: [f64; 3],
    /// Its radius, m.
    pub radius_m: f64,
}

/// A capsule fixed to the flange, as it is written.
#[derive(Debug, Deserialize, Validate, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "ToolShape")]
#[garde(allow_unvalidated)]
pub(super) struct ToolShapeFile {
    /// What it is, for messages.
    name: String,
    /// One end of its axis in the flange, millimetres.
    #[garde(inner(range(min = -2000.0, max = 2000.0)))]
    from_mm: [f64; 3],
    /// The other end, millimetres.
    #[garde(inner(range(min = -2000.0, max = 2000.0)))]
    to_mm: [f64; 3],
    /// Its radius, millimetres.
    #[garde(range(min = 1.0, max = 1000.0))]
    radius_mm: f64,
}

impl From<ToolShapeFile> for ToolShape {
    fn from(file: ToolShapeFile) -> Self {
        let metres = |v: f64| v / 1e3;
        let ToolShapeFile { name, from_mm, to_mm, radius_mm } = file;
        Self { name, from_m: from_mm.map(metres), to_m: to_mm.map(metres), radius_m: metres(radius_mm) }
    }
}
