//! What a recording says about itself, and the setup of an imported session.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::board::Board;
use crate::calibration::problem::{CameraSetup, CheckTruth, DistancePair};
use crate::calibration::settings::{Carried, PoseKind};
use crate::geometry::Camera;

/// Version of the session format that this program writes and the newest that it reads.
pub const FORMAT_VERSION: u32 = 2;

/// Where a session comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Run by this program.
    Live,
    /// Imported from a foreign data set.
    Imported,
}

/// What a recording says about itself.
#[derive(Debug, Clone, PartialEq)]
pub struct About {
    /// Version of the format.
    pub format_version: u32,
    /// Where the session comes from.
    pub kind: Kind,
    /// Names the session.
    pub session_id: String,
    /// Version of the program that wrote it.
    pub program_version: String,
    /// Further facts: serials, versions, hashes.
    pub facts: BTreeMap<String, String>,
}

/// A text or file that belongs to the session.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Attachment {
    /// Name: `cell.yaml`, `trajectory/<file>`, `import.json`, ...
    pub name: String,
    /// Its bytes.
    pub data: Vec<u8>,
}

/// Setup of an imported session; stands in for cell and trajectories.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImportSetup {
    /// Name of the data set.
    pub name: String,
    /// The layout that it was imported from, and what had to be assumed.
    pub source: String,
    /// Whether robot poses enter the result.
    pub robot_poses: bool,
    /// What the robot carries.
    #[serde(default, skip_serializing_if = "is_default")]
    pub carried: Carried,
    /// The board.
    pub board: Board,
    /// The cameras.
    pub cameras: BTreeMap<Camera, CameraSetup>,
    /// Length of an exposure, s; needed to tell closing pulses.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure_s: Option<f64>,
    /// Time from one image to the next, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image_period_s: Option<f64>,
    /// Trigger input that carries the exposure signal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trigger_channel: Option<u8>,
    /// Whether the stamps of event packets are those of their arrival, on the clock of the images.
    #[serde(default, skip_serializing_if = "is_default")]
    pub arrivals: bool,
    /// Id and purpose of each pose, in order.
    pub poses: Vec<ImportedPose>,
    /// Known distances.
    pub pairs: Vec<DistancePair>,
    /// What the checks compare with; absent if not said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub checks: Option<CheckTruth>,
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

impl ImportSetup {
    /// Whether events are cut by trigger edges; packets with a time of arrival do without.
    pub fn is_wired(&self) -> bool {
        !self.arrivals || self.trigger_channel.is_some()
    }
}

/// A pose of an imported session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ImportedPose {
    /// Its id.
    pub id: String,
    /// What it is for.
    pub kind: PoseKind,
}

const METADATA: &str = "cellcal";

impl About {
    /// The name of the metadata record and its entries.
    pub(super) fn to_metadata(&self) -> (String, BTreeMap<String, String>) {
        let mut entries = self.facts.clone();
        entries.insert("format_version".into(), self.format_version.to_string());
        entries.insert("kind".into(), if self.kind == Kind::Live { "live" } else { "imported" }.into());
        entries.insert("session_id".into(), self.session_id.clone());
        entries.insert("program_version".into(), self.program_version.clone());
        (METADATA.into(), entries)
    }

    /// Reads the metadata record; `None` where there is none of ours.
    pub(super) fn from_metadata(all: &BTreeMap<String, BTreeMap<String, String>>) -> Option<Self> {
        let mut facts = all.get(METADATA)?.clone();
        let format_version = facts.remove("format_version")?.parse().ok()?;
        let kind = if facts.remove("kind")? == "imported" { Kind::Imported } else { Kind::Live };
        let (session_id, program_version) = (facts.remove("session_id")?, facts.remove("program_version")?);
        Some(Self { format_version, kind, session_id, program_version, facts })
    }
}
