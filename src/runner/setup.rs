//! The setup of a session: from a cell and its trajectories, or from what an import declares.
//!
//! A recording carries all the text that it was made from, so that a replay needs one file.

use std::collections::BTreeMap;

use super::options::RunOptions;
use super::solve::sha256;
use crate::board::Board;
use crate::calibration::problem::{CameraSetup, CheckTruth, DistancePair, KnownCamera, KnownCameras};
use crate::calibration::result::{CalibrationResult, SCHEMA_VERSION};
use crate::calibration::settings::{Carried, Gates, PoseKind, Settings};
use crate::config::{self, Cell, ChecksCell, ConfigError, Handheld, MotionBy, RobotDriver, Stillness};
use crate::geometry::{
    Camera, Flange, Pinhole, Tcp, Transform,
    kinematics::{Arm, ModelError},
};
use crate::plan::{self, JointMoves, Plan, PlanError};
use crate::recording::{Attachment, ImportSetup, Kind, Recording, RecordingError};
use crate::session::{Expected, HandheldRules, Options, Route, Stop, Watch, Ways};

/// Everything that a session is run and solved with.
#[derive(Debug, Clone)]
pub struct Setup {
    /// Name of the cell or data set.
    pub name: String,
    /// The board.
    pub board: Board,
    /// What the robot carries.
    pub carried: Carried,
    /// Whether robot poses enter the result.
    pub robot_poses: bool,
    /// The cameras.
    pub cameras: BTreeMap<Camera, CameraSetup>,
    /// Id and purpose of each pose.
    pub poses: Vec<(String, PoseKind)>,
    /// Known distances.
    pub pairs: Vec<DistancePair>,
    /// What the checks compare with; absent where nothing is said.
    pub checks: Option<CheckTruth>,
    /// How to solve.
    pub settings: Settings,
    /// What must hold.
    pub gates: Option<Gates>,
    /// Cameras and stereo that were solved before.
    pub known: Option<KnownCameras>,
    /// Length of an exposure, s.
    pub exposure_s: f64,
    /// Time from one image to the next, s.
    pub image_period_s: f64,
    /// Trigger input that carries the exposure signal.
    pub trigger_channel: u8,
    /// Whether it does.
    pub wired: bool,
    /// Whether the stamps of event packets are those of their arrival.
    pub arrivals: bool,
    /// The state machine to run.
    pub machine: MachineSpec,
    /// The model of the arm that it was planned with, and the TCP in its flange; absent in an import.
    pub model: Option<(Arm, Transform<Flange, Tcp>)>,
    /// Where an import comes from.
    pub source: Option<String>,
    /// SHA-256 of the texts, by name.
    pub sha256: BTreeMap<String, String>,
}

/// Which state machine, and with what.
#[derive(Debug, Clone)]
pub enum MachineSpec {
    /// Walks a trajectory.
    Live {
        /// Where to.
        route: Box<Route>,
        /// What still means.
        limits: Stillness,
        /// What pre-flight expects.
        expected: Box<Expected>,
        /// How it is run, besides what the cell says.
        options: Options,
        /// Program that is loaded when all is done.
        load: Option<String>,
    },
    /// Watches what an operator holds before the cameras.
    Handheld {
        /// What counts as still and as enough.
        rules: HandheldRules,
    },
    /// Collects what a source declares.
    Imported {
        /// Number of poses.
        poses: usize,
    },
}

/// Why there is no setup.
#[derive(Debug, thiserror::Error)]
pub enum SetupError {
    /// A cell or trajectory text is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The trajectories cannot be executed.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The robot model cannot be used.
    #[error("{name}: {why}")]
    Model {
        /// The URDF.
        name: String,
        /// What is wrong.
        why: ModelError,
    },
    /// The recording lacks something.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// Another cell file cannot be read.
    #[error("{name}: {why}")]
    Cell {
        /// The file.
        name: String,
        /// The reason of the system.
        why: String,
    },
    /// The intrinsics to be taken over do not fit.
    #[error("the intrinsics of {source_name} cannot be taken over: {why}")]
    Intrinsics {
        /// The result.
        source_name: String,
        /// Why not.
        why: String,
    },
    /// A what-if override is wrong.
    #[error("--set {given}: {why}")]
    Override {
        /// As given.
        given: String,
        /// What is wrong.
        why: String,
    },
}

/// A cell with everything that belongs to it, as texts.
#[derive(Debug, Clone)]
pub struct CellTexts {
    /// Name and text of the cell file.
    pub cell: (String, String),
    /// Folder of the cell file, for messages; empty in a recording.
    pub folder: std::path::PathBuf,
    /// Name as the cell has it and text of each trajectory file, in the order of the cell.
    pub trajectories: Vec<(String, String)>,
    /// Name and text of the result that intrinsics are taken from.
    pub intrinsics: Option<(String, String)>,
    /// Name and text of the URDF that stands for the nominal arm.
    pub urdf: Option<(String, String)>,
}

/// A checked cell, its plan and its setup.
pub struct Planned {
    /// The cell.
    pub cell: Cell,
    /// The poses.
    pub plan: Plan,
    /// The setup.
    pub setup: Setup,
}

const TRAJECTORY: &str = "trajectory/";

/// Name of a trajectory in a recording and a result: its place and file name, no path of any machine.
fn trajectory_name(index: usize, file: &str) -> String {
    let name = file.rsplit('/').next().unwrap_or(file);
    let known = name.split_once('-').is_some_and(|(n, _)| n == (index + 1).to_string());
    if known { format!("{TRAJECTORY}{name}") } else { format!("{TRAJECTORY}{}-{name}", index + 1) }
}

impl CellTexts {
    /// As attachments of a recording.
    pub fn attachments(&self) -> Vec<Attachment> {
        let of = |name: String, text: &str| Attachment { name, data: text.as_bytes().to_vec() };
        let mut all = vec![of("cell.yaml".into(), &self.cell.1)];
        let named = self.trajectories.iter().enumerate();
        all.extend(named.map(|(i, (name, text))| of(trajectory_name(i, name), text)));
        all.extend(self.urdf.iter().map(|(_, text)| of("robot.urdf".into(), text)));
        all.extend(self.intrinsics.iter().map(|(_, text)| of("intrinsics.json".into(), text)));
        all
    }

    /// SHA-256 of everything that the session is planned from.
    pub fn sha256(&self) -> String {
        let trajectories = self.trajectories.iter().map(|(_, text)| text);
        let others = [&self.urdf, &self.intrinsics].into_iter().map(|t| t.as_ref().map_or("", |(_, text)| text));
        let all = [self.cell.1.as_str()].into_iter().chain(trajectories.map(String::as_str)).chain(others);
        let parts: Vec<String> = all.map(|text| sha256(text.as_bytes())).collect();
        sha256(parts.join("\n").as_bytes())
    }

    /// Reads them back from a recording; refused where they are not those that it was recorded with.
    pub fn of_recording(recording: &Recording) -> Result<Self, RecordingError> {
        let texts = Self::found_in(recording)?;
        let facts = &recording.about.facts;
        let checks = [("cell_sha256", sha256(texts.cell.1.as_bytes())), ("texts_sha256", texts.sha256())];
        for (fact, now) in checks {
            if facts.get(fact).is_some_and(|then| *then != now) {
                let what = if fact == "cell_sha256" { "its cell.yaml is" } else { "its texts are" };
                let what = format!("{what} not what it was recorded with (SHA-256 differs)");
                return Err(RecordingError::Broken { path: recording.path.clone(), what });
            }
        }
        Ok(texts)
    }

    fn found_in(recording: &Recording) -> Result<Self, RecordingError> {
        let cell = ("cell.yaml".to_owned(), recording.text("cell.yaml")?.to_owned());
        let names = recording.attachment_names().filter(|n| n.starts_with(TRAJECTORY));
        let trajectory = |name: &str| Ok((name[TRAJECTORY.len()..].to_owned(), recording.text(name)?.to_owned()));
        let trajectories = names.map(trajectory).collect::<Result<_, RecordingError>>()?;
        let optional = |name: &str| recording.text(name).ok().map(|text| (name.to_owned(), text.to_owned()));
        let (intrinsics, urdf) = (optional("intrinsics.json"), optional("robot.urdf"));
        Ok(Self { cell, folder: std::path::PathBuf::new(), trajectories, intrinsics, urdf })
    }

    /// Checks everything and plans the session.
    pub fn plan(&self) -> Result<Planned, SetupError> {
        self.plan_with(&RunOptions::default())
    }

    /// Checks everything and plans the session as it is to be run.
    pub fn plan_with(&self, run: &RunOptions) -> Result<Planned, SetupError> {
        let mut cell = config::parse_cell(&self.cell.1, &self.cell.0)?;
        run.slow_down(&mut cell);
        let mut parsed = Vec::new();
        for (used, (name, text)) in cell.trajectories.iter().zip(&self.trajectories) {
            let shown = self.folder.join(name).display().to_string();
            parsed.push((used.purpose, config::parse_trajectory(text, &shown)?));
        }
        let arm = match &self.urdf {
            None => Arm::ur5e(),
            Some((name, text)) => Arm::from_urdf(text).map_err(|why| SetupError::Model { name: name.clone(), why })?,
        };
        let by_hand = cell.robot.driver == RobotDriver::None;
        let plan = if by_hand { Plan::default() } else { plan::expand_with(&cell, &arm, &parsed)? };
        let mut setup = Setup::of_cell(&cell, &arm, &plan, run);
        setup.sha256.insert("cell".into(), sha256(self.cell.1.as_bytes()));
        for (i, (name, text)) in self.trajectories.iter().enumerate() {
            setup.sha256.insert(trajectory_name(i, name), sha256(text.as_bytes()));
        }
        if let Some((name, text)) = &self.intrinsics {
            setup.take_intrinsics(name, text)?;
        }
        Ok(Planned { cell, plan, setup })
    }
}

impl Setup {
    /// The setup that a recording was made with.
    pub fn of_recording(recording: &Recording) -> Result<Self, SetupError> {
        match recording.about.kind {
            Kind::Live => {
                let texts = CellTexts::of_recording(recording)?;
                Ok(texts.plan_with(&RunOptions::of_facts(&recording.about.facts))?.setup)
            }
            Kind::Imported => Ok(Self::of_import(recording.import_setup()?)),
        }
    }

    fn of_import(import: ImportSetup) -> Self {
        Self {
            wired: import.is_wired(),
            name: import.name,
            board: import.board,
            carried: import.carried,
            robot_poses: import.robot_poses,
            cameras: import.cameras,
            machine: MachineSpec::Imported { poses: import.poses.len() },
            poses: import.poses.into_iter().map(|p| (p.id, p.kind)).collect(),
            pairs: import.pairs,
            checks: import.checks,
            settings: Settings::default(),
            gates: None,
            known: None,
            exposure_s: import.exposure_s.unwrap_or(0.1),
            image_period_s: import.image_period_s.unwrap_or(0.1),
            trigger_channel: import.trigger_channel.unwrap_or(0),
            arrivals: import.arrivals,
            model: None,
            source: Some(import.source),
            sha256: BTreeMap::new(),
        }
    }

    fn of_cell(cell: &Cell, arm: &Arm, plan: &Plan, run: &RunOptions) -> Self {
        let (exposure_s, images_per_s) = cell.rgb.as_ref().map_or((0.0999, 10.0), |c| (c.exposure_s, c.images_per_s));
        let by_hand = cell.robot.driver == RobotDriver::None;
        let ChecksCell { corner_id, target_to_tcp_m } = cell.checks;
        Self {
            name: cell.name.clone(),
            board: cell.board.clone(),
            carried: cell.carried,
            robot_poses: !by_hand,
            cameras: cameras(cell),
            poses: if by_hand { by_hand_poses(cell) } else { planned_poses(plan) },
            pairs: pairs(plan),
            checks: (!by_hand).then_some(CheckTruth { corner_id, target_to_tcp_m }),
            settings: cell.settings.clone(),
            gates: Some(cell.gates.clone()),
            known: None,
            exposure_s,
            image_period_s: 1.0 / images_per_s,
            trigger_channel: cell.event.as_ref().map_or(0, |e| e.trigger_channel),
            wired: cell.rgb.as_ref().is_none_or(|c| c.wired),
            arrivals: true,
            machine: if by_hand { by_hand_machine(cell) } else { machine(cell, arm, plan, run) },
            model: (!by_hand).then(|| (arm.clone(), cell.robot.tcp_offset)),
            source: None,
            sha256: BTreeMap::new(),
        }
    }

    /// Takes cameras and stereo over from the text of an earlier `result.json`.
    ///
    /// Refused for a camera of another size, serial or lens setting.
    pub fn take_intrinsics(&mut self, source_name: &str, text: &str) -> Result<(), SetupError> {
        let refuse = |why: String| SetupError::Intrinsics { source_name: source_name.into(), why };
        let result: CalibrationResult =
            serde_json::from_str(text).map_err(|e| refuse(format!("it is no result.json of this program: {e}")))?;
        if result.schema_version != SCHEMA_VERSION {
            return Err(refuse(format!(
                "its schema_version is {}, this program reads {SCHEMA_VERSION}",
                result.schema_version
            )));
        }
        let mut cameras = BTreeMap::new();
        for (camera, setup) in &self.cameras {
            let Some(found) = result.cameras.get(camera) else {
                return Err(refuse(format!("it has no {camera} camera")));
            };
            if (found.width, found.height) != (setup.width, setup.height) {
                let (w, h, sw, sh) = (found.width, found.height, setup.width, setup.height);
                return Err(refuse(format!("its {camera} camera is {w}x{h}, this session's is {sw}x{sh}")));
            }
            same(*camera, "serial", found.serial.as_deref(), setup.serial.as_deref()).map_err(refuse)?;
            same(*camera, "lens", found.lens.as_deref(), setup.lens.as_deref()).map_err(refuse)?;
            let Pinhole { fx, fy, cx, cy, distortion, .. } = found.pinhole();
            let is_lens = fx > 0.0 && fy > 0.0 && [fx, fy, cx, cy].iter().chain(&distortion).all(|v| v.is_finite());
            if !is_lens {
                return Err(refuse(format!("its {camera} camera has fx {fx}, fy {fy}, cx {cx}, cy {cy}: no camera")));
            }
            let (serial, lens) = (found.serial.clone(), found.lens.clone());
            cameras.insert(*camera, KnownCamera { pinhole: found.pinhole(), serial, lens });
        }
        let event_from_rgb = result.stereo.map(|s| s.event_from_rgb).filter(|_| cameras.len() == 2);
        let (source_sha256, source_session) = (sha256(text.as_bytes()), result.session_id);
        self.known = Some(KnownCameras { cameras, event_from_rgb, source_sha256, source_session });
        Ok(())
    }

    /// Changes one setting or gate: `settings.reject_view_above_px=1.0`, `gates.event_rms_px=0.4`.
    pub fn set(&mut self, given: &str) -> Result<(), SetupError> {
        let fail = |why: String| SetupError::Override { given: given.into(), why };
        let Some((key, value)) = given.split_once('=') else {
            return Err(fail("expected KEY=VALUE, such as gates.event_rms_px=0.4".into()));
        };
        // A bare word is a name, such as a solver's.
        let value = serde_json::from_str(value).unwrap_or_else(|_| serde_json::Value::String(value.into()));
        match key.split_once('.') {
            Some(("settings", field)) => {
                let settings: Settings = patched(&self.settings, field, value).map_err(fail)?;
                // Another method brings its own solver; a later override may choose another.
                let settings = if field == "method" { settings.with_own_solver() } else { settings };
                settings.check().map_err(fail)?;
                self.settings = settings;
            }
            Some(("gates", field)) => {
                let gates = self.gates.clone().unwrap_or_default();
                self.gates = Some(patched(&gates, field, value).map_err(fail)?);
            }
            _ => return Err(fail(format!("`{key}` is neither settings.<name> nor gates.<name>"))),
        }
        Ok(())
    }
}

fn same(camera: Camera, what: &str, then: Option<&str>, now: Option<&str>) -> Result<(), String> {
    if then == now {
        return Ok(());
    }
    let shown = |v: Option<&str>| v.map_or_else(|| "not declared".to_owned(), |v| format!("`{v}`"));
    Err(format!("the {what} of its {camera} camera is {}, this session's is {}", shown(then), shown(now)))
}

fn patched<T: serde::Serialize + serde::de::DeserializeOwned>(
    now: &T,
    field: &str,
    value: serde_json::Value,
) -> Result<T, String> {
    let mut tree = serde_json::to_value(now).map_err(|e| e.to_string())?;
    let fields = tree.as_object_mut().ok_or("not a map")?;
    fields.insert(field.into(), value);
    serde_json::from_value(tree).map_err(|e| e.to_string())
}

fn cameras(cell: &Cell) -> BTreeMap<Camera, CameraSetup> {
    let mut cameras = BTreeMap::new();
    if let Some(c) = &cell.rgb {
        let focal_px = Some(c.focal_length_m / c.pixel_pitch_m);
        let (serial, lens) = (c.serial.clone(), Some(c.lens.clone()));
        cameras.insert(Camera::Rgb, CameraSetup { width: c.width, height: c.height, serial, lens, focal_px });
    }
    if let Some(c) = &cell.event {
        let focal_px = Some(c.focal_length_m / c.pixel_pitch_m);
        let (serial, lens) = (c.serial.clone(), Some(c.lens.clone()));
        cameras.insert(Camera::Event, CameraSetup { width: c.width, height: c.height, serial, lens, focal_px });
    }
    cameras
}

/// Two poses of the same pair, in order.
fn pairs(plan: &Plan) -> Vec<DistancePair> {
    let mut first: BTreeMap<&str, &str> = BTreeMap::new();
    let mut pairs = Vec::new();
    for pose in &plan.poses {
        let Some(pair) = &pose.pair else { continue };
        if let Some(pose_a) = first.remove(pair.name.as_str()) {
            let (name, pose_a, pose_b) = (pair.name.clone(), pose_a.to_owned(), pose.id.clone());
            pairs.push(DistancePair { name, pose_a, pose_b, truth_m: pair.truth_m });
        } else {
            first.insert(&pair.name, &pose.id);
        }
    }
    pairs
}

/// What a cell says that its robot must be like.
pub fn expected_of(cell: &Cell) -> Expected {
    let robot = &cell.robot;
    Expected {
        tcp_offset: robot.tcp_offset.pose_vector(),
        payload_kg: robot.payload_kg,
        payload_cog_m: robot.payload_cog_m,
        allow_reduced: robot.allow_reduced,
        start_joints_rad: robot.home_joints_rad,
        start_within_rad: robot.start_within_rad,
        // The dashboard calls a UR5e a UR5.
        model: (robot.model == "ur5e").then(|| "UR5".to_owned()),
        serial: robot.serial.clone(),
        controller_version: robot.controller_version.clone(),
        kinematics_checksum: robot.kinematics_checksum.clone(),
        speed_slider: robot.speed_slider,
        interlocks: robot.interlocks.clone(),
        gripper_empty: robot.gripper_empty.clone(),
        external: matches!(robot.motion, MotionBy::External(_)),
    }
}

/// The display is proved to blink as early as the event camera can see it.
fn watch(cell: &Cell, plan: &Plan, run: &RunOptions) -> Watch {
    match (&cell.event, plan.home_sees_board) {
        _ if run.rehearsal => Watch::Never,
        (None, _) => Watch::Never,
        (Some(_), true) => Watch::AtStart,
        (Some(_), false) => Watch::AtFirstPose,
    }
}

fn planned_poses(plan: &Plan) -> Vec<(String, PoseKind)> {
    plan.poses.iter().map(|p| (p.id.clone(), p.kind)).collect()
}

fn by_hand_poses(cell: &Cell) -> Vec<(String, PoseKind)> {
    (1..=cell.handheld.poses).map(|i| (format!("hand-{i:03}"), PoseKind::Intrinsics)).collect()
}

fn by_hand_machine(cell: &Cell) -> MachineSpec {
    let Handheld { poses, motion_px, hold_s } = cell.handheld;
    let sizes = cameras(cell).into_iter().map(|(camera, setup)| (camera, [setup.width, setup.height])).collect();
    let min_corners = cell.settings.min_corners;
    MachineSpec::Handheld { rules: HandheldRules { poses: poses as usize, motion_px, hold_s, min_corners, sizes } }
}

fn machine(cell: &Cell, arm: &Arm, plan: &Plan, run: &RunOptions) -> MachineSpec {
    let robot = &cell.robot;
    let external = match &robot.motion {
        MotionBy::Script => None,
        MotionBy::External(external) => Some(external),
    };
    let stop =
        |pose: &plan::PlannedPose| Stop { target: pose.target, joints_rad: pose.joints_rad, move_s: pose.move_s };
    let home = plan.home.as_ref().filter(|_| external.is_none());
    let moves = JointMoves::of(cell, arm);
    let route = Route {
        stops: plan.poses.iter().map(stop).collect(),
        start_joints_rad: robot.home_joints_rad,
        home: home.map(|h| Stop { target: h.target, joints_rad: robot.home_joints_rad, move_s: h.move_s }),
        ways: Ways::new(move |from, to, speed| moves.between(from, to, speed).map_err(|why| why.to_string())),
    };
    let failed_poses = cell.stop_after_failed_poses;
    let patience_s = external.map_or(Options::default().patience_s, |e| e.patience_s);
    MachineSpec::Live {
        route: Box::new(route),
        limits: robot.stillness.clone(),
        expected: Box::new(expected_of(cell)),
        options: Options { confirm_each: run.confirm_each, patience_s, watch: watch(cell, plan, run), failed_poses },
        load: robot.load_program.clone(),
    }
}
