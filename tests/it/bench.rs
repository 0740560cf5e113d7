//! A small session on the simulated controller, with a camera that costs nothing: for what is about the arm.

use std::io::{BufRead as _, BufReader, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use cellcal::devices::rtde::Value;
use cellcal::devices::sim::cell::controller_config;
use cellcal::devices::sim::ur::{Flaws, Planned, Ports, SimClock, SimController, SimHandle, SimUrConfig};
use cellcal::devices::ur::{UrConfig, UrRobot};
use cellcal::devices::{CameraError, CameraFacts, Clock, FrameCamera, FrameImage, RobotError};
use cellcal::geometry::{Base, Flange, Transform};
use cellcal::image::GrayImage;
use cellcal::recording::{About, FORMAT_VERSION, Kind, Writer};
use cellcal::runner::setup::{CellTexts, MachineSpec, Planned as PlannedSession};
use cellcal::runner::{Devices, Live, Nobody, Told};
use cellcal::session::{Command, Exposure, Outcome, Watch};

#[path = "rtde_client.rs"]
pub(crate) mod rtde_client;

use rtde_client::Watcher;

/// Three poses before the cameras, about 0.1 m apart.
pub(crate) const THREE_POSES: &str = "name: three\nsegments:\n  - pattern: views\n    poses:\n\
    \x20     - {id: a, view: {centre_mm: [-30, 0, 290]}}\n\
    \x20     - {id: b, view: {centre_mm: [50, 10, 300]}}\n\
    \x20     - {id: c, view: {centre_mm: [-30, -10, 285]}}\n";

/// What the shipped simulated cell is, with an interlock and these poses.
pub(crate) fn texts(trajectory: &str) -> CellTexts {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("cells/sim.yaml");
    let text = std::fs::read_to_string(path).unwrap();
    let begin = text.find("trajectories:\n").unwrap();
    let end = text.find("images_per_pose").unwrap();
    let used = "trajectories:\n  - {file: three.yaml, purpose: intrinsics}\n";
    let text = format!("{}{used}{}", &text[..begin], &text[end..]);
    let interlock = "  interlocks: [{digital_input: 3, must_be: false, meaning: cell released}]\n  limits:\n";
    let text = text.replace("  limits:\n", interlock);
    CellTexts {
        cell: ("cell.yaml".into(), text),
        folder: PathBuf::new(),
        trajectories: vec![("three.yaml".into(), trajectory.into())],
        intrinsics: None,
        urdf: None,
    }
}

/// A shipped trajectory.
pub(crate) fn shipped(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("trajectories").join(name);
    std::fs::read_to_string(path).unwrap()
}

/// Small images at 20 Hz.
pub(crate) struct SmallCamera {
    pub(crate) clock: SimClock,
    burst: Option<Exposure>,
}

impl FrameCamera for SmallCamera {
    fn facts(&self) -> CameraFacts {
        CameraFacts::default()
    }

    fn size(&self) -> [u32; 2] {
        [16, 9]
    }

    fn begin(&mut self, _images: u32) -> Result<(), CameraError> {
        let start_s = (self.clock.seconds() / 0.05).floor() * 0.05 + 0.05;
        self.burst = Some(Exposure::whole(start_s, start_s + 0.04));
        Ok(())
    }

    fn poll(&mut self) -> Result<Option<Vec<FrameImage>>, CameraError> {
        let exposure = self.burst.take_if(|e| self.clock.seconds() > e.end_s + 0.02);
        let image = GrayImage::filled(16, 9, 90);
        Ok(exposure.map(|exposure| vec![FrameImage { exposure, image: Some(image) }]))
    }
}

/// A simulated controller with the cell's arm.
pub(crate) struct Bench {
    pub(crate) sim: SimController,
    pub(crate) planned: PlannedSession,
    pub(crate) texts: CellTexts,
    folder: tempfile::TempDir,
}

/// How a session on the bench ended.
pub(crate) struct Ran {
    pub(crate) outcome: Outcome,
    pub(crate) recording: PathBuf,
    pub(crate) notes: Vec<String>,
}

impl Bench {
    pub(crate) fn new(faults: Vec<Planned>) -> Self {
        Self::with(THREE_POSES, |config| config.faults = faults)
    }

    pub(crate) fn with(trajectory: &str, adjust: impl FnOnce(&mut SimUrConfig)) -> Self {
        Self::of(texts(trajectory), adjust)
    }

    pub(crate) fn of(texts: CellTexts, adjust: impl FnOnce(&mut SimUrConfig)) -> Self {
        let mut planned = texts.plan().unwrap();
        // No event camera is here that could watch the display.
        if let MachineSpec::Live { options, .. } = &mut planned.setup.machine {
            options.watch = Watch::Never;
        }
        let mut config = controller_config(&planned.cell, Flaws::default(), f64::INFINITY);
        config.lock_step_patience = Duration::from_secs(20);
        adjust(&mut config);
        let sim = SimController::start(config, 3).unwrap();
        Self { sim, planned, texts, folder: tempfile::tempdir().unwrap() }
    }

    pub(crate) fn handle(&self) -> SimHandle {
        self.sim.handle()
    }

    pub(crate) fn robot_config(&self) -> UrConfig {
        let Ports { rtde, primary, secondary, dashboard, .. } = self.sim.ports();
        UrConfig {
            rtde_port: rtde,
            script_port: secondary,
            primary_port: primary,
            dashboard_port: Some(dashboard),
            answer_within: Duration::from_secs(2),
            ..UrConfig::of_cell(&self.planned.cell, "127.0.0.1")
        }
    }

    pub(crate) fn connect(&self) -> Result<UrRobot, RobotError> {
        let clock: Arc<dyn Clock> = Arc::new(self.sim.clock());
        UrRobot::connect(&self.robot_config(), clock)
    }

    /// Connects, walks the poses and closes the recording; `hear` hears every command, after it was logged and
    /// before it is carried out.
    pub(crate) fn run(&self, hear: impl FnMut(&Command)) -> Result<Ran, RobotError> {
        self.run_connected(|| (), hear)
    }

    /// As [`Bench::run`]; `connected` is called between the connection and the first decision.
    pub(crate) fn run_connected(
        &self,
        connected: impl FnOnce(),
        mut hear: impl FnMut(&Command),
    ) -> Result<Ran, RobotError> {
        let robot = Box::new(self.connect()?);
        connected();
        let clock = self.sim.clock();
        let frame = SmallCamera { clock: clock.clone(), burst: None };
        let devices = Devices { robot, frame: Some(Box::new(frame)), event: None, clock: Arc::new(clock) };
        let path = self.folder.path().join("session.mcap");
        let about = About {
            format_version: FORMAT_VERSION,
            kind: Kind::Live,
            session_id: "bench".into(),
            program_version: "test".into(),
            facts: std::collections::BTreeMap::new(),
        };
        let writer = Writer::create(&path, &about, &self.texts.attachments()).unwrap();
        let (interrupted, mut notes, mut nobody) = (AtomicBool::new(false), Vec::new(), Nobody);
        let mut tell = |told: Told<'_>| match told {
            Told::Command(command) => hear(command),
            Told::Note(note) => notes.push(note),
        };
        let mut live = Live::new(devices, writer, (1, 0.05), &interrupted, &mut nobody, &mut tell).unwrap();
        let outcome = self.planned.setup.machine.clone().run(&mut live).unwrap();
        let recording = live.into_recording().unwrap();
        Ok(Ran { outcome, recording, notes })
    }

    /// Where the flange truly is.
    pub(crate) fn flange(&self) -> Transform<Base, Flange> {
        let truth = self.sim.truth();
        truth.base_from_flange_at(truth.newest_s().unwrap()).unwrap()
    }

    /// The digital outputs as another client sees them.
    pub(crate) fn outputs(&self) -> u64 {
        let address = SocketAddr::new(self.sim.address(), self.sim.ports().rtde);
        let values = Watcher::connect(address, &["actual_digital_output_bits"]).next();
        match values.as_slice() {
            [Value::Uint64(bits)] => *bits,
            other => panic!("{other:?}"),
        }
    }

    /// What the dashboard answers.
    pub(crate) fn ask(&self, question: &str) -> String {
        let address = SocketAddr::new(self.sim.address(), self.sim.ports().dashboard);
        let stream = TcpStream::connect(address).unwrap();
        let mut lines = BufReader::new(stream.try_clone().unwrap()).lines();
        lines.next().unwrap().unwrap();
        (&stream).write_all(format!("{question}\n").as_bytes()).unwrap();
        lines.next().unwrap().unwrap()
    }

    /// Whether the arm is at rest after 0.35 s of simulated time, but for its ringing.
    pub(crate) fn arm_stays_at_rest(&self) -> Result<(), String> {
        let clock = self.sim.clock();
        let from_s = clock.seconds();
        // Nobody drives any more: simulated time goes on at real pace.
        #[expect(clippy::disallowed_methods, reason = "waits for the simulator's own pace")]
        while clock.seconds() < from_s + 0.42 {
            std::thread::sleep(Duration::from_millis(5));
        }
        let truth = self.sim.truth();
        let pose = |after_s: f64| truth.base_from_flange_at(from_s + after_s).ok_or("no truth");
        let moved_m = pose(0.35)?.distance_to_m(&pose(0.4)?);
        // The slowest move that counts as one would be 5 mm here.
        if moved_m < 5e-4 { Ok(()) } else { Err(format!("the arm still moves: {moved_m} m in 0.05 s")) }
    }
}
