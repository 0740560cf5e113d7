//! From a recording to a finished calibration: replay the session, look at the pixels, solve.

use std::path::Path;

use sha2::{Digest as _, Sha256};

use super::pixels::{self, Seen};
use super::replay::{Diverged, Replay};
use super::setup::{MachineSpec, Setup, SetupError};
use super::{World, run};
use crate::board::View;
use crate::calibration::gates::Status;
use crate::calibration::kinematics::{KinematicsResult, PoseKinematics, compare};
use crate::calibration::problem::{PoseData, Problem};
use crate::calibration::result::{CalibrationResult, NotWritable};
use crate::calibration::settings::Method;
use crate::calibration::solve::{self, Origin};
use crate::geometry::Camera;
use crate::recording::{Recording, RecordingError};
use crate::session::{End, Outcome, PoseRecord, Salvage};

/// Why a recording gives no result.
#[derive(Debug, thiserror::Error)]
pub enum SolveError {
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// What it says about the cell cannot be used.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// This program decides differently.
    #[error(transparent)]
    Diverged(#[from] Diverged),
    /// The views that were given are of something else.
    #[error("the stored views cannot be used: {0}; replay from pixels")]
    Views(String),
    /// A number is not finite.
    #[error(transparent)]
    NotWritable(#[from] NotWritable),
}

/// What a solve gives.
#[derive(Debug)]
pub struct Solved {
    /// The result.
    pub result: CalibrationResult,
    /// What the cameras saw; a later solve can start from it.
    pub views: StoredViews,
    /// How the session ended.
    pub end: End,
    /// What the recording lost, in words.
    pub damage: Vec<String>,
}

/// The views of a session, stored beside it.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct StoredViews {
    /// SHA-256 of the recording.
    pub recording_sha256: String,
    /// Version of OpenCV that found them.
    pub opencv: String,
    /// Version of this program.
    pub program_version: String,
    /// How they were found.
    pub method: Method,
    seen: Seen,
}

impl StoredViews {
    /// What a camera saw at a pose, by its index; `None` where it has no image.
    pub fn view(&self, pose: usize, camera: Camera) -> Option<&View> {
        self.seen.views.get(pose)?.get(&camera)
    }
}

/// Replays and solves the recording at `path`.
///
/// `adjust` may change the setup (what-if) and says what it changed; `stored` skips the pixels;
/// `progress` hears of images done and total.
pub fn solve_recording(
    path: &Path,
    adjust: &mut dyn FnMut(&mut Setup) -> Result<Vec<String>, SetupError>,
    stored: Option<StoredViews>,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Solved, SolveError> {
    let bytes = std::fs::read(path).map_err(|why| RecordingError::Io { path: path.into(), why })?;
    let recording_sha256 = sha256(&bytes);
    let recording = Recording::from_bytes(path, &bytes)?;
    drop(bytes);
    let mut setup = Setup::of_recording(&recording)?;
    let overrides = adjust(&mut setup)?;
    let outcome = replay(&recording, &setup)?;
    let views = match stored {
        Some(views) => checked(views, &recording_sha256, setup.settings.method)?,
        None => StoredViews {
            recording_sha256: recording_sha256.clone(),
            opencv: crate::cv::version(),
            program_version: env!("CARGO_PKG_VERSION").into(),
            method: setup.settings.method,
            seen: pixels::look(&recording, &setup, &outcome, progress),
        },
    };
    let origin = origin(&recording, &setup, recording_sha256, overrides);
    let problem = problem(setup, &outcome, &views.seen);
    let mut result = solve::solve(&problem, origin);
    result.display = outcome.display.clone();
    result.timing = views.seen.timing.clone().map(Into::into);
    result.warnings.extend(views.seen.problems.iter().cloned());
    result.warnings.extend(recording.damage.iter().map(|d| format!("the recording is damaged: {d}")));
    if recording.about.facts.contains_key("rehearsal") {
        result.warnings.insert(0, "this is a rehearsal: the poses were walked without cameras".into());
    }
    let skipped =
        outcome.poses.iter().zip(&result.poses).filter_map(|(record, pose)| Some((pose, record.skipped.as_ref()?)));
    let skipped: Vec<_> = skipped.map(|(pose, why)| format!("pose {} was not captured: {why}", pose.pose_id)).collect();
    if outcome.end == End::Complete {
        result.warnings.extend(skipped);
    }
    if let Some(why) = unfinished(&outcome.end) {
        if result.verdict.status == Status::Pass {
            // What was judged was kept, but it is not what the cell asks for.
            result.verdict.status = Status::Inconclusive;
            result.verdict.reasons.push(why.clone());
        }
        result.warnings.push(why);
    }
    Ok(Solved { result, views, end: outcome.end, damage: recording.damage })
}

/// Runs the session's machine against the recording.
///
/// Where a damaged recording makes the machine decide differently, what each capture still proves counts.
pub(super) fn replay(recording: &Recording, setup: &Setup) -> Result<Outcome, Diverged> {
    let mut world = Replay::new(recording);
    let outcome = setup.machine.clone().run(&mut world);
    match &setup.machine {
        MachineSpec::Live { route, limits, .. } if outcome.is_err() && !recording.damage.is_empty() => {
            run(Salvage::new(route.stops.len(), limits), &mut Replay::unchecked(recording))
        }
        MachineSpec::Live { .. } | MachineSpec::Imported { .. } | MachineSpec::Handheld { .. } => outcome,
    }
}

impl MachineSpec {
    /// The machine of a live session; `None` for an import.
    pub fn into_live(self) -> Option<crate::session::Live> {
        match self {
            Self::Live { route, limits, expected, options, load } => {
                Some(crate::session::Live::new(*route, limits, *expected, options, load))
            }
            Self::Imported { .. } | Self::Handheld { .. } => None,
        }
    }

    /// Runs the machine that this describes in `world`.
    pub fn run<W: World>(self, world: &mut W) -> Result<Outcome, W::Error> {
        match self {
            Self::Live { route, limits, expected, options, load } => {
                run(crate::session::Live::new(*route, limits, *expected, options, load), world)
            }
            Self::Imported { poses } => run(crate::session::Imported::new(poses), world),
            Self::Handheld { rules } => run(crate::session::Handheld::new(rules), world),
        }
    }
}

fn checked(views: StoredViews, recording_sha256: &str, method: Method) -> Result<StoredViews, SolveError> {
    let other = |what: &str, found: &str, now: &str| SolveError::Views(format!("{what} was {found}, is {now}"));
    if views.recording_sha256 != recording_sha256 {
        return Err(other("the recording's SHA-256", &views.recording_sha256, recording_sha256));
    }
    let opencv = crate::cv::version();
    if views.opencv != opencv {
        return Err(other("OpenCV", &views.opencv, &opencv));
    }
    let version = env!("CARGO_PKG_VERSION");
    if views.program_version != version {
        return Err(other("cellcal", &views.program_version, version));
    }
    if views.method != method {
        return Err(other("the method", &format!("{:?}", views.method), &format!("{method:?}")));
    }
    Ok(views)
}

fn origin(recording: &Recording, setup: &Setup, recording_sha256: String, overrides: Vec<String>) -> Origin {
    let mut sha256_of = setup.sha256.clone();
    sha256_of.insert("recording".into(), recording_sha256);
    let mut facts = recording.about.facts.clone();
    facts.insert("recorded_by".into(), format!("cellcal {}", recording.about.program_version));
    facts.extend(setup.source.clone().map(|s| ("source".into(), s)));
    Origin { session_id: recording.about.session_id.clone(), overrides, facts, sha256: sha256_of }
}

fn problem(setup: Setup, outcome: &Outcome, seen: &Seen) -> Problem {
    let pose = |(index, (id, kind)): (usize, &(String, crate::calibration::settings::PoseKind))| {
        let record = outcome.poses.get(index);
        PoseData {
            id: id.clone(),
            kind: *kind,
            base_from_tcp: record.and_then(|r| r.base_from_tcp),
            views: seen.views.get(index).cloned().unwrap_or_default(),
            stillness: record.and_then(|r| r.evidence.as_ref()).and_then(|e| serde_json::to_value(e).ok()),
            skipped: record.and_then(|r| r.skipped.clone()),
        }
    };
    let poses = setup.poses.iter().enumerate().map(pose).collect();
    let kinematics = kinematics(&setup, outcome);
    let Setup { name, board, carried, robot_poses, cameras, pairs, checks, settings, gates, known, .. } = setup;
    Problem {
        cell: name,
        board,
        carried,
        robot_poses,
        cameras,
        poses,
        pairs,
        checks,
        settings,
        gates,
        known,
        kinematics,
    }
}

/// The models of the arm beside what its controller said at every captured pose.
fn kinematics(setup: &Setup, outcome: &Outcome) -> Option<KinematicsResult> {
    let (urdf, flange_from_tcp) = setup.model.as_ref()?;
    let at = |(pose, record): (usize, &PoseRecord)| {
        let (joints_rad, base_from_tcp) = (record.joints_rad?, record.base_from_tcp?);
        Some(PoseKinematics { pose, joints_rad, base_from_tcp })
    };
    let poses: Vec<_> = outcome.poses.iter().enumerate().filter_map(at).collect();
    let controller = outcome.facts.as_ref().and_then(|f| f.kinematics.as_ref()).map(|k| &k.dh);
    (!poses.is_empty()).then(|| compare(&poses, *flange_from_tcp, controller, urdf))
}

fn unfinished(end: &End) -> Option<String> {
    match end {
        End::Complete => None,
        End::PreflightFailed(findings) => {
            let all: Vec<_> = findings.iter().map(ToString::to_string).collect();
            Some(format!("the session did not pass pre-flight: {}", all.join("; ")))
        }
        End::OperatorNeeded(why) => Some(format!("the session was stopped, an operator is needed: {why}")),
        End::Aborted(why) => Some(format!("the session was aborted: {why}")),
        End::Interrupted => Some("the session was interrupted".into()),
        End::Cut => Some("the session is not complete: poses are missing".into()),
    }
}

/// SHA-256 in lower-case hex.
pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect()
}
