//! The checks before the first motion, and the conditions under which the arm may move at all.
//!
//! Each check has an id; a refusal names it, what was found and what was expected. Nothing is fixed silently.

use serde::{Deserialize, Serialize};

use super::modes::{robot_mode_name, runtime_state_name, safety_mode_name};
use super::types::{RobotFacts, RobotSample};
use crate::config::Interlock;
use crate::geometry::{Flange, Tcp, Transform, kinematics::Joints};

/// A controller that started more recently may start once more, s.
const BOOTING_S: f64 = 40.0;
/// Runtime states.
const STOPPED: u32 = 1;
const PLAYING: u32 = 2;

/// What the cell says that the robot must be like.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Expected {
    /// The active TCP in the flange: x, y, z (m) and axis-angle vector (rad).
    pub tcp_offset: [f64; 6],
    /// Payload, kg.
    pub payload_kg: f64,
    /// Centre of gravity of the payload, m.
    pub payload_cog_m: [f64; 3],
    /// Whether the arm may move in reduced mode.
    pub allow_reduced: bool,
    /// Where the session starts, rad.
    pub start_joints_rad: Joints,
    /// Farthest that a joint may be from there, rad.
    pub start_within_rad: f64,
    /// Model that the controller must report, such as `UR5`; absent: not checked.
    pub model: Option<String>,
    /// Serial number that the controller must report; absent: not checked.
    pub serial: Option<String>,
    /// What the software version of the controller must begin with; absent: not checked.
    pub controller_version: Option<String>,
    /// Checksum of the kinematics; absent: not checked.
    pub kinematics_checksum: Option<String>,
    /// Smallest and largest position of the speed slider, 0 to 1.
    pub speed_slider: [f64; 2],
    /// Inputs that must keep their values.
    pub interlocks: Vec<Interlock>,
    /// An input that must have its value before the first move.
    pub gripper_empty: Option<Interlock>,
    /// Whether a program of the plant moves the arm; it must then be running.
    pub external: bool,
}

/// One check that failed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finding {
    /// Id of the check.
    pub id: String,
    /// What was found, what was expected, what to do.
    pub message: String,
}

impl Finding {
    pub(super) fn new(id: &str, message: impl Into<String>) -> Self {
        Self { id: id.into(), message: message.into() }
    }
}

/// The finding as one line.
impl std::fmt::Display for Finding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.id, self.message)
    }
}

/// Every check that the controller and this sample fail, but for where the arm stands; empty means go.
pub fn findings(facts: &RobotFacts, sample: &RobotSample, expected: &Expected) -> Vec<Finding> {
    let mut found = Vec::new();
    found.extend(of_facts(facts, expected));
    found.extend(is_safe(sample, expected).err());
    found.extend(program(sample, expected).err());
    found.extend(of_settings(sample, expected));
    if sample.controller_time_s.is_nan() || sample.controller_time_s < BOOTING_S {
        let since_s = sample.controller_time_s;
        found.push(Finding::new(
            "booting",
            format!("the controller started {since_s:.0} s ago; wait until {BOOTING_S:.0} s have passed"),
        ));
    }
    if let Some(input) = expected.gripper_empty.as_ref().filter(|i| !i.is_kept(sample.digital_inputs)) {
        found.push(Finding::new("gripper_empty", lost(input)));
    }
    found
}

fn of_facts(facts: &RobotFacts, expected: &Expected) -> Vec<Finding> {
    let mut found = Vec::new();
    let [major, minor, bugfix, build] = facts.controller_version;
    let version = format!("{major}.{minor}.{bugfix}.{build}");
    let old = major < 5 || (major == 5 && minor < 6);
    if old {
        found.push(Finding::new(
            "controller_version",
            format!("the controller runs {version}; 5.6 or later is needed (an e-Series, or PolyScope X)"),
        ));
    }
    if let Some(wanted) = expected.controller_version.as_ref().filter(|w| !begins_with(&version, w)) {
        found.push(Finding::new(
            "controller_version",
            format!("the controller runs {version}, the cell says {wanted}; check the session on paper, then correct the cell"),
        ));
    }
    if facts.remote_control == Some(false) && !expected.external {
        found.push(Finding::new(
            "remote_control",
            "the robot is in local control; switch the teach pendant to remote control",
        ));
    }
    // PolyScope X has no dashboard; where there should be one its silence hides what must be known.
    if facts.remote_control.is_none() && (major < 10 || expected.external) {
        found.push(Finding::new(
            "remote_control",
            "whether the robot is in remote control is not told: the dashboard does not answer; enable it under Settings, Security, Services (a program of the plant can be stopped in no other way)",
        ));
    }
    let mut must_be = |id: &str, wanted: &Option<String>, found_now: Option<&str>| {
        let Some(wanted) = wanted.as_deref() else { return };
        if found_now != Some(wanted) {
            let now = found_now.map_or_else(|| "not told".to_owned(), |v| format!("`{v}`"));
            let what = id.replace('_', " ");
            found.push(Finding::new(
                id,
                format!("the {what} of the controller is {now}, the cell expects `{wanted}`; is this the right robot?"),
            ));
        }
    };
    must_be("model", &expected.model, facts.model.as_deref());
    must_be("serial", &expected.serial, facts.serial.as_deref());
    let checksum = facts.kinematics.as_ref().map(|k| k.checksum.as_str());
    must_be("kinematics_checksum", &expected.kinematics_checksum, checksum);
    found
}

/// Whether a version begins with these numbers: `5.1` is no beginning of `5.12`.
fn begins_with(version: &str, wanted: &str) -> bool {
    let mut parts = version.split('.');
    wanted.split('.').all(|w| parts.next() == Some(w))
}

/// What changed on the controller between two parts of a session.
pub(super) fn changes(before: &RobotFacts, now: &RobotFacts) -> Vec<Finding> {
    let checksum = |f: &RobotFacts| f.kinematics.as_ref().map(|k| k.checksum.clone());
    let all = [
        ("serial", before.serial.clone(), now.serial.clone()),
        ("model", before.model.clone(), now.model.clone()),
        ("kinematics checksum", checksum(before), checksum(now)),
        ("version", Some(format!("{:?}", before.controller_version)), Some(format!("{:?}", now.controller_version))),
        ("motion program", Some(before.script_sha256.clone()), Some(now.script_sha256.clone())),
    ];
    let shown = |v: Option<String>| v.unwrap_or_else(|| "not told".into());
    let changed = all.into_iter().filter(|(_, before, now)| before != now);
    let finding = |(what, before, now): (&str, Option<String>, Option<String>)| {
        Finding::new(
            "changed",
            format!(
                "the {what} was {} when the session began and is {} now; begin a new session",
                shown(before),
                shown(now)
            ),
        )
    };
    changed.map(finding).collect()
}

fn of_settings(sample: &RobotSample, expected: &Expected) -> Vec<Finding> {
    let mut found = Vec::new();
    let mut check = |id: &str, ok: bool, message: String| {
        if !ok {
            found.push(Finding::new(id, message));
        }
    };
    let offset = Transform::<Flange, Tcp>::from_pose_vector(sample.tcp_offset);
    let wanted = Transform::<Flange, Tcp>::from_pose_vector(expected.tcp_offset);
    let (metres, radians) = (offset.distance_to_m(&wanted), offset.angle_to_rad(&wanted));
    check(
        "tcp_offset",
        metres <= 1e-5 && radians <= 1e-4,
        format!(
            "the active TCP of the controller is {:?}, the cell says {:?}: {:.3} mm and {:.3} deg apart; set the TCP on the pendant or correct the cell",
            sample.tcp_offset,
            expected.tcp_offset,
            metres * 1e3,
            radians.to_degrees()
        ),
    );
    check(
        "payload",
        (sample.payload_kg - expected.payload_kg).abs() <= 0.01,
        format!(
            "the payload of the controller is {} kg, the cell says {} kg; set it on the pendant or correct the cell",
            sample.payload_kg, expected.payload_kg
        ),
    );
    let cog_near = |(a, b): (&f64, &f64)| (a - b).abs() <= 1e-3;
    check(
        "payload_cog",
        sample.payload_cog_m.iter().zip(&expected.payload_cog_m).all(cog_near),
        format!(
            "the centre of gravity on the controller is {:?} m, the cell says {:?} m; set it on the pendant or correct the cell",
            sample.payload_cog_m, expected.payload_cog_m
        ),
    );
    found
}

/// Whether the arm is too far from where a session starts; then an operator must confirm the way there.
pub fn start_finding(sample: &RobotSample, expected: &Expected) -> Option<Finding> {
    let far = too_far(sample, expected)?;
    Some(Finding::new("start_pose", far_from_start(far, expected)))
}

/// The largest distance of a joint from where the session starts, rad, if it is too far.
fn too_far(sample: &RobotSample, expected: &Expected) -> Option<f64> {
    let away = |(a, b): (&f64, &f64)| (a - b).abs();
    let farthest = sample.joints_rad.iter().zip(&expected.start_joints_rad).map(away).fold(0.0, nan_max);
    let near = farthest <= expected.start_within_rad;
    (!near).then_some(farthest)
}

/// The sentence for an arm that is too far from the start.
fn far_from_start(farthest_rad: f64, expected: &Expected) -> String {
    format!(
        "a joint is {:.1} deg from the start of the session, {:.1} deg allowed; move the arm to its home first",
        farthest_rad.to_degrees(),
        expected.start_within_rad.to_degrees()
    )
}

/// Whether the arm may move now, whatever program moves it; looked at with every sample.
pub(super) fn may_move(sample: &RobotSample, expected: &Expected) -> Result<(), Finding> {
    is_safe(sample, expected)?;
    // Somebody may change them at the pendant: the poses would mean something else from then on.
    of_settings(sample, expected).into_iter().next().map_or(Ok(()), Err)
}

fn is_safe(sample: &RobotSample, expected: &Expected) -> Result<(), Finding> {
    let bit = |bits: u32, n: u32| bits >> n & 1 == 1;
    let safe = sample.safety_mode == 1 || (sample.safety_mode == 2 && expected.allow_reduced);
    if !safe {
        let hint = if sample.safety_mode == 2 { "; `allow_reduced: true` would permit it" } else { "" };
        let name = safety_mode_name(sample.safety_mode);
        return Err(Finding::new("safety_mode", format!("the safety mode is {name}, not 1 (NORMAL){hint}")));
    }
    if sample.robot_mode != 7 {
        let name = robot_mode_name(sample.robot_mode);
        return Err(Finding::new("robot_mode", format!("the robot mode is {name}, not 7 (RUNNING)")));
    }
    if bit(sample.safety_status_bits, 10) {
        return Err(Finding::new("safety_stop", "the robot is stopped due to safety"));
    }
    if bit(sample.robot_status_bits, 2) {
        return Err(Finding::new("teach_button", "the teach button is pressed"));
    }
    let [slowest, fastest] = expected.speed_slider;
    if !(slowest..=fastest).contains(&sample.target_speed_fraction) {
        let (now, low, high) = (100.0 * sample.target_speed_fraction, 100.0 * slowest, 100.0 * fastest);
        return Err(Finding::new(
            "speed_slider",
            format!("the speed slider is at {now:.0} %, outside {low:.0} to {high:.0} %; set it on the pendant"),
        ));
    }
    let broken = expected.interlocks.iter().find(|i| !i.is_kept(sample.digital_inputs));
    broken.map_or(Ok(()), |interlock| Err(Finding::new("interlock", lost(interlock))))
}

fn lost(interlock: &Interlock) -> String {
    let Interlock { digital_input, must_be, meaning } = interlock;
    let word = |on: bool| if on { "on" } else { "off" };
    format!("{meaning}: digital input {digital_input} is {}, it must be {}", word(!must_be), word(*must_be))
}

/// Before the start no program may run, unless it is the one of the plant that moves the arm.
pub(super) fn program(sample: &RobotSample, expected: &Expected) -> Result<(), Finding> {
    let name = runtime_state_name(sample.runtime_state);
    match (expected.external, sample.runtime_state) {
        (true, PLAYING) | (false, STOPPED) => Ok(()),
        (true, _) => {
            Err(Finding::new("program", format!("the program state is {name}; start the program that moves the arm")))
        }
        (false, _) => Err(Finding::new(
            "program",
            format!("the program state is {name}: another program is running or paused; stop it first"),
        )),
    }
}

/// While the session runs, the program that moves the arm must be playing.
pub(super) fn is_playing(sample: &RobotSample) -> Result<(), Finding> {
    if sample.runtime_state == PLAYING {
        return Ok(());
    }
    let name = runtime_state_name(sample.runtime_state);
    Err(Finding::new("program", format!("the program that moves the arm is not running any more: its state is {name}")))
}

fn nan_max(a: f64, b: f64) -> f64 {
    if b.is_nan() || a.is_nan() { f64::NAN } else { a.max(b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_compared_number_by_number() {
        assert!(begins_with("5.12.4.1101", "5.12") && begins_with("5.12.4.1101", "5"));
        assert!(!begins_with("5.12.4.1101", "5.1") && !begins_with("5.12", "5.12.4"));
    }
}
