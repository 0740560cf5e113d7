//! The checks before the first motion, and the conditions under which the arm may move at all.
//!
//! Each check has an id; a refusal names it, what was found and what was expected. Nothing is fixed silently.

use serde::{Deserialize, Serialize};

use super::types::RobotSample;
use crate::geometry::{Flange, Tcp, Transform, kinematics::Joints};

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
}

/// One check that failed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finding {
    /// Id of the check.
    pub id: String,
    /// What was found, what was expected, what to do.
    pub message: String,
}

/// Every check that the sample fails; empty means go.
pub(super) fn findings(sample: &RobotSample, expected: &Expected) -> Vec<Finding> {
    let mut found = Vec::new();
    let mut check = |id: &str, ok: bool, message: String| {
        if !ok {
            found.push(Finding { id: id.into(), message });
        }
    };
    if let Err((id, message)) = may_move(sample, expected.allow_reduced) {
        check(id, false, message);
    }
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
        format!("the payload of the controller is {} kg, the cell says {} kg", sample.payload_kg, expected.payload_kg),
    );
    let cog_near = |(a, b): (&f64, &f64)| (a - b).abs() <= 1e-3;
    check(
        "payload_cog",
        sample.payload_cog_m.iter().zip(&expected.payload_cog_m).all(cog_near),
        format!(
            "the centre of gravity on the controller is {:?} m, the cell says {:?} m",
            sample.payload_cog_m, expected.payload_cog_m
        ),
    );
    let away = |(a, b): (&f64, &f64)| (a - b).abs();
    let farthest = sample.joints_rad.iter().zip(&expected.start_joints_rad).map(away).fold(0.0, nan_max);
    check(
        "start_pose",
        farthest <= expected.start_within_rad,
        format!(
            "a joint is {:.1} deg from the start of the session, {:.1} deg allowed; move the arm to its home first",
            farthest.to_degrees(),
            expected.start_within_rad.to_degrees()
        ),
    );
    found
}

/// Whether the arm may move now; otherwise the id of the condition and what was found.
pub(super) fn may_move(sample: &RobotSample, allow_reduced: bool) -> Result<(), (&'static str, String)> {
    let bit = |bits: u32, n: u32| bits >> n & 1 == 1;
    if sample.robot_mode != 7 {
        return Err((
            "robot_mode",
            format!("the robot mode is {}, not 7 (RUNNING)", robot_mode_name(sample.robot_mode)),
        ));
    }
    let safe = sample.safety_mode == 1 || (sample.safety_mode == 2 && allow_reduced);
    if !safe {
        let hint = if sample.safety_mode == 2 { "; `allow_reduced: true` would permit it" } else { "" };
        let name = safety_mode_name(sample.safety_mode);
        return Err(("safety_mode", format!("the safety mode is {name}, not 1 (NORMAL){hint}")));
    }
    if bit(sample.safety_status_bits, 10) {
        return Err(("safety_stop", "the robot is stopped due to safety".into()));
    }
    if bit(sample.robot_status_bits, 2) {
        return Err(("teach_button", "the teach button is pressed".into()));
    }
    if sample.runtime_state != 2 {
        return Err(("program", format!("the program state is {}, not 2 (PLAYING)", sample.runtime_state)));
    }
    Ok(())
}

fn nan_max(a: f64, b: f64) -> f64 {
    if b.is_nan() { f64::NAN } else { a.max(b) }
}

fn robot_mode_name(mode: i32) -> String {
    let names = [
        "NO_CONTROLLER",
        "DISCONNECTED",
        "CONFIRM_SAFETY",
        "BOOTING",
        "POWER_OFF",
        "POWER_ON",
        "IDLE",
        "BACKDRIVE",
        "RUNNING",
        "UPDATING_FIRMWARE",
    ];
    named(mode, usize::try_from(mode.wrapping_add(1)).ok().and_then(|i| names.get(i)))
}

fn safety_mode_name(mode: i32) -> String {
    let names = [
        "NORMAL",
        "REDUCED",
        "PROTECTIVE_STOP",
        "RECOVERY",
        "SAFEGUARD_STOP",
        "SYSTEM_EMERGENCY_STOP",
        "ROBOT_EMERGENCY_STOP",
        "VIOLATION",
        "FAULT",
        "VALIDATE_JOINT_ID",
        "UNDEFINED",
        "AUTOMATIC_MODE_SAFEGUARD_STOP",
        "SYSTEM_THREE_POSITION_ENABLING_STOP",
    ];
    named(mode, usize::try_from(mode.wrapping_sub(1)).ok().and_then(|i| names.get(i)))
}

fn named(mode: i32, name: Option<&&str>) -> String {
    name.map_or_else(|| format!("{mode} (unknown)"), |name| format!("{mode} ({name})"))
}
