//! What the simulated controller is: every number that makes it good or bad, and the individual arm
//! that a seed draws from them.

use std::net::{IpAddr, Ipv4Addr};
use std::time::Duration;

use rand::Rng as _;

use super::faults::Planned;
use super::noise::{self, Stream};
use crate::geometry::kinematics::{Dh, Joints};

/// Which TCP ports to serve; 0 lets the system choose.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Ports {
    /// RTDE; 30004 on a real controller.
    pub rtde: u16,
    /// Primary interface; 30001.
    pub primary: u16,
    /// Secondary interface; 30002.
    pub secondary: u16,
    /// Realtime interface; 30003.
    pub realtime: u16,
    /// Dashboard; 29999.
    pub dashboard: u16,
}

impl Ports {
    /// The ports of a real controller.
    pub const REAL: Self = Self { rtde: 30004, primary: 30001, secondary: 30002, realtime: 30003, dashboard: 29999 };
}

/// How the arm differs from its ideal; ranges are smallest and largest value.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Flaws {
    /// Lengths by which the calibrated model differs from the nominal one, up to, m.
    pub individual_m: f64,
    /// Angles by which the calibrated model differs from the nominal one, up to, rad.
    pub individual_rad: f64,
    /// Size of the true joint offsets that the controller does not know, rad.
    pub joint_offset_rad: [f64; 2],
    /// Size of the true errors of link lengths and offsets that the controller does not know, m.
    pub dh_error_m: [f64; 2],
    /// Distance of the true flange from its mean place after a move, unseen by the encoders, m.
    pub repeatability_m: [f64; 2],
    /// First amplitude of the ringing of the flange after a stop, m.
    pub ring_amplitude_m: [f64; 2],
    /// Frequency of the ringing, Hz.
    pub ring_frequency_hz: [f64; 2],
    /// Decay time of the ringing, s.
    pub ring_decay_s: [f64; 2],
    /// Standard deviation of measured joint positions, rad.
    pub encoder_noise_rad: f64,
    /// Standard deviation of measured joint speeds, rad/s.
    pub speed_noise_rad_s: f64,
    /// Standard deviation of each component of the reported TCP speed, m/s (the controller filters it).
    pub tcp_speed_noise_m_s: f64,
    /// Standard deviation of each component of the reported TCP turning speed, rad/s.
    pub tcp_speed_noise_rad_s: f64,
}

impl Default for Flaws {
    fn default() -> Self {
        Self {
            individual_m: 0.5e-3,
            individual_rad: 0.5e-3,
            joint_offset_rad: [0.1e-3, 0.5e-3],
            dh_error_m: [0.1e-3, 0.3e-3],
            repeatability_m: [0.02e-3, 0.05e-3],
            ring_amplitude_m: [0.1e-3, 0.5e-3],
            ring_frequency_hz: [8.0, 15.0],
            ring_decay_s: [0.06, 0.15],
            encoder_noise_rad: 8e-6,
            speed_noise_rad_s: 4e-4,
            tcp_speed_noise_m_s: 1e-4,
            tcp_speed_noise_rad_s: 2e-4,
        }
    }
}

impl Flaws {
    /// An arm without any flaw: measured, believed and true poses are the same.
    pub fn none() -> Self {
        Self {
            individual_m: 0.0,
            individual_rad: 0.0,
            joint_offset_rad: [0.0; 2],
            dh_error_m: [0.0; 2],
            repeatability_m: [0.0; 2],
            ring_amplitude_m: [0.0; 2],
            ring_frequency_hz: [10.0; 2],
            ring_decay_s: [0.1; 2],
            encoder_noise_rad: 0.0,
            speed_noise_rad_s: 0.0,
            tcp_speed_noise_m_s: 0.0,
            tcp_speed_noise_rad_s: 0.0,
        }
    }
}

/// The simulated controller.
#[derive(Debug, Clone, PartialEq)]
pub struct SimUrConfig {
    /// Address to listen on.
    pub address: IpAddr,
    /// Ports to listen on.
    pub ports: Ports,
    /// Simulated seconds per real second while a client drives in lock-step; infinity: as fast as it goes.
    pub time_scale: f64,
    /// How long, in real time, a driving client may leave a data package without an answer before
    /// lock-step ends for it and time runs on at real pace. Zero: no lock-step at all.
    pub lock_step_patience: Duration,
    /// Simulated time at the start, ns; a resumed session goes on where it was.
    pub start_ns: u64,
    /// Controller time when simulated time is 0, s.
    pub boot_time_s: f64,
    /// Joint positions at the start, rad.
    pub start_joints_rad: Joints,
    /// Model that the controller uses; `None`: drawn from the seed.
    pub believed: Option<Dh>,
    /// Flaws of the arm.
    pub flaws: Flaws,
    /// TCP in the flange: x, y, z (m) and axis-angle vector (rad).
    pub tcp_offset: [f64; 6],
    /// Payload, kg.
    pub payload_kg: f64,
    /// Centre of gravity of the payload, m.
    pub payload_cog_m: [f64; 3],
    /// Speed slider, 0 to 1.
    pub speed_fraction: f64,
    /// Box that the TCP may not leave, smallest and largest x, y, z in `base`, m.
    pub safety_box_m: Option<[[f64; 2]; 3]>,
    /// Whether scripts over sockets are accepted.
    pub remote_control: bool,
    /// Serial number, digits.
    pub serial: String,
    /// Model, as the dashboard says it.
    pub model: String,
    /// Programs that the dashboard can load.
    pub programs: Vec<String>,
    /// Software version: major, minor, bug fix, build.
    pub version: [u32; 4],
    /// Deceleration of the leading joint when a program is stopped, rad/s2.
    pub program_stop_rad_s2: f64,
    /// Deceleration of the leading joint on a protective or emergency stop, rad/s2.
    pub safety_stop_rad_s2: f64,
    /// Joint speed below which `is_steady()` is true, rad/s.
    pub steady_rad_s: f64,
    /// Digital inputs at the start, bit by bit.
    pub digital_inputs: u64,
    /// What goes wrong, and when.
    pub faults: Vec<Planned>,
    /// Simulated time for which [`super::Truth`] remembers where the arm was, s.
    pub truth_kept_s: f64,
}

impl Default for SimUrConfig {
    fn default() -> Self {
        Self {
            address: IpAddr::V4(Ipv4Addr::LOCALHOST),
            ports: Ports::default(),
            time_scale: f64::INFINITY,
            lock_step_patience: Duration::from_secs(2),
            start_ns: 0,
            boot_time_s: 100.0,
            start_joints_rad: [0.0, -1.6, -1.9, -1.2, 1.57, 0.0],
            believed: None,
            flaws: Flaws::default(),
            tcp_offset: [0.0; 6],
            payload_kg: 1.0,
            payload_cog_m: [0.0; 3],
            speed_fraction: 1.0,
            safety_box_m: None,
            remote_control: true,
            serial: "20235500001".into(),
            model: "UR5".into(),
            programs: vec!["production.urp".into()],
            version: [5, 12, 4, 1101],
            program_stop_rad_s2: 8.0,
            safety_stop_rad_s2: 20.0,
            steady_rad_s: 0.002,
            digital_inputs: 0,
            faults: Vec::new(),
            truth_kept_s: 10.0,
        }
    }
}

/// The arm that a seed draws: what the controller believes, and the truth.
#[derive(Debug, Clone, PartialEq)]
pub struct Individual {
    /// Calibrated model of the controller.
    pub believed: Dh,
    /// True model.
    pub truth: Dh,
    /// True minus measured joint positions, rad.
    pub joint_offsets_rad: Joints,
}

impl Individual {
    /// Draws the arm; the same seed gives the same arm.
    pub fn draw(config: &SimUrConfig, seed: u64) -> Self {
        let flaws = &config.flaws;
        let mut rng = noise::generator(seed, Stream::Individual, 0);
        let mut within = |limit: f64| limit * rng.random_range(-1.0..=1.0);
        let drawn = Dh {
            theta_rad: std::array::from_fn(|_| within(flaws.individual_rad)),
            a_m: Dh::UR5E.a_m.map(|a| a + within(flaws.individual_m)),
            d_m: Dh::UR5E.d_m.map(|d| d + within(flaws.individual_m)),
            alpha_rad: Dh::UR5E.alpha_rad.map(|alpha| alpha + within(flaws.individual_rad)),
        };
        let believed = config.believed.unwrap_or(drawn);
        let mut signed = |range: [f64; 2]| {
            let size = noise::between(&mut rng, range);
            if rng.random::<bool>() { size } else { -size }
        };
        let truth = Dh {
            a_m: believed.a_m.map(|a| a + signed(flaws.dh_error_m)),
            d_m: believed.d_m.map(|d| d + signed(flaws.dh_error_m)),
            ..believed
        };
        let joint_offsets_rad = std::array::from_fn(|_| signed(flaws.joint_offset_rad));
        Self { believed, truth, joint_offsets_rad }
    }
}
