//! Builds a simulated cell from a cell file: draws the truth from a seed, starts the controller, hands out drivers.

use std::sync::{Arc, Mutex};

use nalgebra::UnitQuaternion;
use rand::{Rng as _, SeedableRng as _};
use rand_pcg::Pcg64;
use serde::de::DeserializeOwned;

use super::rig::{Placement, Rig, SimEventCamera, SimFrameCamera, Whereabouts, WiredCamera};
use super::scene::{DisplaySpec, EventSpec, FrameSpec, Optics, Scene, SceneError, SceneSpec};
use super::ur::{Flaws, Planned as PlannedFault, SimClock, SimController, SimUrConfig};
use crate::config::{Cell, FrameTrigger, Interlock, Mount, RobotDriver, Section};
use crate::cv::{CvError, charuco};
use crate::devices::ur::{UrConfig, UrRobot};
use crate::devices::{CameraError, Clock, EventCamera, FrameCamera, Robot, RobotError};
use crate::events::sync::ClockMap;
use crate::geometry::{Base, Camera, Event, Pinhole, Rgb, Sensor, Tcp, Transform, kinematics::Joints, rotation};
use crate::image::GrayImage;
use crate::session::Stamp;

/// Pixels a square of the simulated display.
const PX_PER_SQUARE: u32 = 48;
/// Point spread of the lenses, standard deviation, px.
const PSF_SIGMA_PX: [f64; 2] = [1.0, 0.85];
/// The clocks differ by up to this, s, and by about this, ppm.
const EVENT_OFFSET_S: [f64; 2] = [2.0, 9.0];
const EVENT_DRIFT_PPM: f64 = 12.0;

/// Why the simulated cell cannot be built.
#[derive(Debug, thiserror::Error)]
pub enum SimError {
    /// A section under `sim:` is wrong.
    #[error("sim.{section}: {why}")]
    Section {
        /// Which.
        section: &'static str,
        /// What is wrong.
        why: String,
    },
    /// The scene cannot be.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The board cannot be drawn.
    #[error(transparent)]
    Board(#[from] CvError),
    /// The simulated controller did not start.
    #[error("the simulated controller does not start: {0}")]
    Controller(String),
    /// The driver does not reach the simulated controller.
    #[error(transparent)]
    Robot(#[from] RobotError),
}

/// What is true in the simulated cell; for tests only.
#[derive(Debug, Clone)]
pub struct SimTruth {
    /// The frame camera.
    pub rgb: Option<Pinhole>,
    /// The event camera.
    pub event: Option<Pinhole>,
    /// The event camera before the frame camera.
    pub event_from_rgb: Transform<Event, Rgb>,
    /// Where everything is.
    pub placement: Placement,
    /// `base_from_camera` or, where the cameras are carried, `tcp_from_camera`, of the reference camera.
    pub mount_of_camera: Transform<Base, Sensor>,
    /// From the clock of the event camera to that of the session, where that begins at 0.
    pub host_from_event_clock: ClockMap,
}

/// When and where a simulated cell begins, and what goes wrong in it.
#[derive(Debug, Clone, Default)]
pub struct SimStart {
    /// The session's time at its start.
    pub first: Stamp,
    /// Where the arm stands; absent: at home.
    pub joints_rad: Option<Joints>,
    /// Faults of the controller.
    pub faults: Vec<PlannedFault>,
}

/// A running simulated cell.
pub struct SimCell {
    /// The controller; stops when dropped.
    pub controller: SimController,
    /// Simulated time.
    pub clock: SimClock,
    /// What is true; for tests only.
    pub truth: SimTruth,
    rig: Arc<Rig>,
    robot_config: UrConfig,
    has: [bool; 2],
    images_per_pose: u32,
}

impl SimCell {
    /// Draws and starts the cell; `time_scale` simulated seconds a real second, infinity: as fast as it goes.
    pub fn start(cell: &Cell, seed: Option<u64>, time_scale: f64) -> Result<Self, SimError> {
        Self::start_at(cell, seed, time_scale, SimStart::default())
    }

    /// As [`SimCell::start`], at another time and place, and with faults to come.
    pub fn start_at(cell: &Cell, seed: Option<u64>, time_scale: f64, start: SimStart) -> Result<Self, SimError> {
        let sim = cell.sim.clone();
        let seed = seed.or(sim.as_ref().map(|s| s.seed)).unwrap_or(1);
        let section = |pick: fn(&crate::config::SimCell) -> Option<Section>| sim.as_ref().and_then(pick);
        let flaws: Flaws = parsed("robot", section(|s| s.robot.clone()))?;
        let SimStart { first, joints_rad, faults } = start;
        let mut config = controller_config(cell, flaws, time_scale);
        (config.start_ns, config.faults) = (first.0, faults);
        config.start_joints_rad = joints_rad.unwrap_or(config.start_joints_rad);
        let controller = SimController::start(config, seed).map_err(|why| SimError::Controller(why.to_string()))?;
        let (clock, arm) = (controller.clock(), controller.truth());
        let (mut rig, truth) = whole_rig(cell, seed, Whereabouts::Arm(Box::new(arm)), clock.clone())?;
        // A camera that was opened anew counts its time anew.
        rig.event_offset_s -= 1e-9 * first.0 as f64;
        let rig = Arc::new(rig);
        let robot_config = UrConfig::of_cell(cell, "127.0.0.1");
        let has = [cell.rgb.is_some(), cell.event.is_some()];
        Ok(Self { controller, clock, truth, rig, robot_config, has, images_per_pose: cell.images_per_pose })
    }

    /// Connects the real driver to the simulated controller.
    pub fn robot(&self) -> Result<Box<dyn Robot>, SimError> {
        let ports = self.controller.ports();
        let config = UrConfig {
            rtde_port: ports.rtde,
            script_port: ports.secondary,
            dashboard_port: Some(ports.dashboard),
            primary_port: ports.primary,
            ..self.robot_config.clone()
        };
        let clock: Arc<dyn Clock> = Arc::new(self.clock.clone());
        Ok(Box::new(UrRobot::connect(&config, clock)?))
    }

    /// The frame camera, if the cell has one.
    pub fn frame(&self) -> Option<Box<dyn FrameCamera>> {
        self.has[0].then(|| Box::new(SimFrameCamera::new(Arc::clone(&self.rig))) as _)
    }

    /// Puts a camera that is no part of the simulation in the place of the simulated one.
    ///
    /// It must stamp its exposures on [`SimCell::clock`], which keeps real time at a time scale of 1.
    pub fn wire(&self, camera: Box<dyn FrameCamera>) -> Box<dyn FrameCamera> {
        Box::new(WiredCamera::new(Arc::clone(&self.rig), camera))
    }

    /// The event camera, if the cell has one.
    pub fn event(&self) -> Option<Box<dyn EventCamera>> {
        let alone = (!self.has[0]).then_some(self.images_per_pose);
        self.has[1].then(|| Box::new(SimEventCamera::new(Arc::clone(&self.rig), alone)) as _)
    }

    /// The image that a frame camera takes from one simulated time to another, s; for tests only.
    ///
    /// For a camera that is no part of the simulation and is to see it all the same.
    pub fn eye(&self) -> impl Fn(f64, f64) -> Result<GrayImage, CameraError> + Send + 'static {
        let rig = Arc::clone(&self.rig);
        move |start_s, end_s| rig.image(start_s, end_s)
    }

    /// Display and sensors; for tests only.
    pub fn scene(&self) -> &Scene {
        &self.rig.scene
    }
}

/// The cameras and the display as the seed draws them, and what is true about them.
pub(super) fn whole_rig(
    cell: &Cell,
    seed: u64,
    whereabouts: Whereabouts,
    clock: SimClock,
) -> Result<(Rig, SimTruth), SimError> {
    let sim = cell.sim.as_ref();
    let section = |pick: fn(&crate::config::SimCell) -> Option<Section>| sim.and_then(pick);
    let mut draw = Draw(Pcg64::seed_from_u64(seed ^ 0x5e11_0ca1));
    let optics = lenses(cell, seed);
    let (placement, event_from_rgb, mount_of_camera) = place(cell, &mut draw);
    let scene = Scene::new(SceneSpec {
        board: cell.board.clone(),
        pattern: charuco::draw(&cell.board, PX_PER_SQUARE)?,
        alpha: cell.display.alpha,
        cycle_hz: cell.display.cycle_hz,
        display: display_spec(section(|s| s.display.clone()))?,
        rgb: both(optics[0].clone(), parsed::<FrameSpec>("frame", section(|s| s.frame.clone()))?),
        event: both(optics[1].clone(), parsed::<EventSpec>("events", section(|s| s.events.clone()))?),
        seed,
    })?;
    let rig = rig(cell, scene, placement, whereabouts, clock, &mut draw);
    let truth = SimTruth {
        rgb: optics[0].as_ref().map(Optics::pinhole),
        event: optics[1].as_ref().map(Optics::pinhole),
        event_from_rgb,
        placement,
        mount_of_camera,
        host_from_event_clock: rig.host_from_event_clock(),
    };
    Ok((rig, truth))
}

fn parsed<T: DeserializeOwned + Default>(section: &'static str, values: Option<Section>) -> Result<T, SimError> {
    let Some(values) = values else { return Ok(T::default()) };
    serde_json::from_value(values.into()).map_err(|e| SimError::Section { section, why: e.to_string() })
}

/// The display; its luminance is given once, as a brightness setting or as such.
fn display_spec(values: Option<Section>) -> Result<DisplaySpec, SimError> {
    let given = |key: &str| values.as_ref().is_some_and(|values| values.contains_key(key));
    let twice = ["white_cd_m2", "black_cd_m2"].into_iter().find(|key| given(key) && given("brightness_percent"));
    match twice {
        None => parsed("display", values),
        Some(key) => {
            let why = format!("{key} is given beside brightness_percent, which sets it; leave one of them out");
            Err(SimError::Section { section: "display", why })
        }
    }
}

fn both<A, B>(a: Option<A>, b: B) -> Option<(A, B)> {
    a.map(|a| (a, b))
}

/// The simulated controller of a cell: home, TCP, payload and serial as the cell says.
pub fn controller_config(cell: &Cell, flaws: Flaws, time_scale: f64) -> SimUrConfig {
    let robot = &cell.robot;
    SimUrConfig {
        time_scale,
        // Rendering on a busy machine may take long; the arm waits for the program, not for the clock on the wall.
        lock_step_patience: std::time::Duration::from_secs(120),
        start_joints_rad: robot.home_joints_rad,
        flaws,
        tcp_offset: robot.tcp_offset.pose_vector(),
        payload_kg: robot.payload_kg,
        payload_cog_m: robot.payload_cog_m,
        // The cell is released until a fault says otherwise.
        digital_inputs: kept_inputs(robot.interlocks.iter().chain(&robot.gripper_empty)),
        serial: robot.serial.clone().unwrap_or_else(|| SimUrConfig::default().serial),
        ..SimUrConfig::default()
    }
}

/// Inputs with which these interlocks let the arm move.
fn kept_inputs<'a>(interlocks: impl Iterator<Item = &'a Interlock>) -> u64 {
    interlocks.filter(|interlock| interlock.must_be).fold(0, |bits, interlock| bits | 1 << interlock.digital_input)
}

/// The true lenses: frame camera and event camera.
fn lenses(cell: &Cell, seed: u64) -> [Option<Optics>; 2] {
    let lens = |width: u32, height: u32, focal_px: f64, camera: usize| {
        let nominal = Optics::nominal(width as usize, height as usize, focal_px, PSF_SIGMA_PX[camera]);
        nominal.drawn(seed.wrapping_mul(2).wrapping_add(camera as u64))
    };
    let rgb = cell.rgb.as_ref().map(|c| lens(c.width, c.height, c.focal_length_m / c.pixel_pitch_m, 0));
    let event = cell.event.as_ref().map(|c| lens(c.width, c.height, c.focal_length_m / c.pixel_pitch_m, 1));
    [rgb, event]
}

fn rig(cell: &Cell, scene: Scene, placement: Placement, truth: Whereabouts, clock: SimClock, draw: &mut Draw) -> Rig {
    let (exposure_s, images_per_s) = cell.rgb.as_ref().map_or((0.0999, 10.0), |c| (c.exposure_s, c.images_per_s));
    Rig {
        scene,
        placement,
        truth,
        clock,
        exposure_s,
        period_s: 1.0 / images_per_s,
        trigger: cell.rgb.as_ref().map_or(FrameTrigger::FreeRun, |c| c.trigger),
        wired: cell.rgb.as_ref().is_none_or(|c| c.wired),
        phase_s: draw.between([0.0, 0.1]),
        event_offset_s: draw.between(EVENT_OFFSET_S),
        event_drift_ppm: EVENT_DRIFT_PPM * draw.between([0.8, 1.2]),
        trigger_channel: cell.event.as_ref().map_or(0, |e| e.trigger_channel),
        frame_size: cell.rgb.as_ref().map_or([0, 0], |c| [c.width, c.height]),
        event_size: cell.event.as_ref().map_or([0, 0], |e| [e.width, e.height]),
        burst: Mutex::new(Vec::new()),
    }
}

/// Draws where everything truly is, within mounting tolerances of the nominal places.
fn place(cell: &Cell, draw: &mut Draw) -> (Placement, Transform<Event, Rgb>, Transform<Base, Sensor>) {
    // Mounting plates are good to a few millimetres and a degree; the target's distance from the TCP is
    // measured, so its error is a rotation about the TCP.
    let nominal = cell.nominal.event_from_rgb.unwrap_or_else(Transform::identity);
    let event_from_rgb = nominal * draw.small::<Rgb, Rgb>(0.2e-3, 0.6);
    let reference = cell.reference_camera();
    let rgb_from_reference = |t: Transform<Event, Rgb>| match reference {
        Camera::Rgb => Transform::<Rgb, Sensor>::identity(),
        Camera::Event => Transform::assume_frames(*t.inverse().iso()),
    };
    let rgb_from_sensor = rgb_from_reference(event_from_rgb);
    if cell.robot.driver == RobotDriver::None {
        // What is held is given before the frame camera; there is no base to draw.
        let (rgb_from_base, flange_from_target) = (Transform::identity(), Transform::identity());
        let event_from_base = event_from_rgb * rgb_from_base;
        let placement = Placement::CarriedTarget { rgb_from_base, event_from_base, flange_from_target };
        return (placement, event_from_rgb, Transform::assume_frames(*rgb_from_sensor.iso()));
    }
    match cell.nominal.mount {
        Mount::Target { base_from_camera, tcp_from_target } => {
            let base_from_camera = base_from_camera * draw.small::<Sensor, Sensor>(4e-3, 1.0);
            let tcp_from_target = draw.small::<Tcp, Tcp>(0.0, 1.0) * tcp_from_target;
            let rgb_from_base = rgb_from_sensor * base_from_camera.inverse();
            let placement = Placement::CarriedTarget {
                rgb_from_base,
                event_from_base: event_from_rgb * rgb_from_base,
                flange_from_target: cell.robot.tcp_offset * tcp_from_target,
            };
            (placement, event_from_rgb, base_from_camera)
        }
        Mount::Cameras { tcp_from_camera, base_from_target } => {
            let tcp_from_camera = tcp_from_camera * draw.small::<Sensor, Sensor>(4e-3, 1.0);
            let base_from_target = draw.small::<Base, Base>(2e-3, 0.5) * base_from_target;
            let rgb_from_flange = rgb_from_sensor * (cell.robot.tcp_offset * tcp_from_camera).inverse();
            let placement = Placement::CarriedCameras {
                rgb_from_flange,
                event_from_flange: event_from_rgb * rgb_from_flange,
                base_from_target,
            };
            // The type has `base` for the usual set-up; here the camera sits in `tcp`.
            (placement, event_from_rgb, Transform::assume_frames(*tcp_from_camera.iso()))
        }
    }
}

struct Draw(Pcg64);

impl Draw {
    fn between(&mut self, [low, high]: [f64; 2]) -> f64 {
        self.0.random_range(low..=high)
    }

    /// A small displacement: uniform in a cube of `half_m`, rotation vector uniform in one of `half_deg`.
    fn small<A, B>(&mut self, half_m: f64, half_deg: f64) -> Transform<A, B> {
        let mut cube = |half: f64| [0; 3].map(|_| self.0.random_range(-1.0..=1.0) * half);
        let (translation, turn) = (cube(half_m), cube(half_deg.to_radians()));
        let rotation: UnitQuaternion<f64> = rotation::from_vector(turn);
        Transform::from_parts(translation, rotation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn display(json: &str) -> Result<DisplaySpec, SimError> {
        display_spec(Some(serde_json::from_str(json).unwrap()))
    }

    #[test]
    fn the_luminance_of_the_display_is_given_once() {
        assert_eq!(display(r#"{"brightness_percent": 40}"#).unwrap().brightness_percent, Some(40.0));
        assert_eq!(display(r#"{"white_cd_m2": 200}"#).unwrap().white_cd_m2, 200.0);
        let error = display(r#"{"brightness_percent": 40, "black_cd_m2": 0.2}"#).unwrap_err();
        assert!(error.to_string().starts_with("sim.display: black_cd_m2 is given beside brightness_percent"));
        let nested = r#"{"spotlight": {"cd_m2": 90, "centre_m": [0.03, 0.02], "radius_m": 0.01},
            "occluders": [{"corners_m": [[0, 0], [0.02, 0], [0.02, 0.05]], "height_m": 0.01}]}"#;
        let nested = display(nested).unwrap();
        assert!(nested.spotlight.is_some() && nested.occluders[0].cd_m2 == 1.0);
    }
}
