//! Where a controller is and how patient the driver is.

use std::time::Duration;

use crate::config::{Cell, FrameTrigger, Line, MotionBy};
use crate::devices::RobotError;
use crate::session::MoveTarget;

/// Largest speeds and accelerations that the driver passes on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionCaps {
    /// Speed of the leading joint, rad/s.
    pub joint_speed_rad_s: f64,
    /// Acceleration of the leading joint, rad/s2.
    pub joint_acceleration_rad_s2: f64,
    /// Speed of the TCP, m/s.
    pub tcp_speed_m_s: f64,
    /// Acceleration of the TCP, m/s2.
    pub tcp_acceleration_m_s2: f64,
}

impl Default for MotionCaps {
    fn default() -> Self {
        Self {
            joint_speed_rad_s: 1.05,
            joint_acceleration_rad_s2: 1.4,
            tcp_speed_m_s: 0.25,
            tcp_acceleration_m_s2: 0.5,
        }
    }
}

impl MotionCaps {
    /// Refuses a target that is not finite, not moving forward, or faster than allowed.
    pub(super) fn check(&self, target: &MoveTarget) -> Result<(), RobotError> {
        let (numbers, limits) = match target {
            MoveTarget::Joint { joints_rad, speed_rad_s, acceleration_rad_s2 } => (
                joints_rad,
                [(*speed_rad_s, self.joint_speed_rad_s), (*acceleration_rad_s2, self.joint_acceleration_rad_s2)],
            ),
            MoveTarget::Linear { tcp_pose, speed_m_s, acceleration_m_s2 } => {
                (tcp_pose, [(*speed_m_s, self.tcp_speed_m_s), (*acceleration_m_s2, self.tcp_acceleration_m_s2)])
            }
        };
        let refuse = |why: String| Err(RobotError::Refused { what: format!("{target:?}"), why });
        if !numbers.iter().all(|v| v.is_finite()) {
            return refuse("a number of the target is not finite".into());
        }
        let within = |(value, cap): &(f64, f64)| *value > 0.0 && *value <= *cap;
        match limits.iter().find(|limit| !within(limit)) {
            Some((value, cap)) => refuse(format!("{value} is outside 0 to {cap}; raise the cap or go slower")),
            None => Ok(()),
        }
    }
}

/// Where a controller is and how patient the driver is.
#[derive(Debug, Clone, PartialEq)]
pub struct UrConfig {
    /// Address or name of the controller.
    pub host: String,
    /// RTDE.
    pub rtde_port: u16,
    /// Secondary interface, for scripts.
    pub script_port: u16,
    /// Primary interface, for the calibrated kinematics.
    pub primary_port: u16,
    /// Dashboard; `None` where there is none (PolyScope X).
    pub dashboard_port: Option<u16>,
    /// Rate of samples, 500 / n Hz.
    pub frequency_hz: f64,
    /// Session time without a fresh sample after which the robot counts as lost.
    pub stale_after: Duration,
    /// Real time without a sample after which the robot counts as lost although the session's clock
    /// stands (a simulation that hangs).
    pub real_time_guard: Duration,
    /// Real time that one answer of the controller may take.
    pub answer_within: Duration,
    /// Session time in which the script must start or end.
    pub program_within: Duration,
    /// Largest speeds that are passed on.
    pub caps: MotionCaps,
    /// Digital output that is on from the first move to the end.
    pub calibrating: Option<Line>,
    /// Triggers the frame camera by a pulse.
    pub trigger: Option<Line>,
    /// Who moves the arm.
    pub motion: MotionBy,
}

impl UrConfig {
    /// The defaults for a real controller at this address.
    pub fn at(host: impl Into<String>) -> Self {
        Self {
            host: host.into(),
            rtde_port: 30004,
            script_port: 30002,
            primary_port: 30001,
            dashboard_port: Some(29999),
            frequency_hz: 125.0,
            stale_after: Duration::from_millis(100),
            real_time_guard: Duration::from_secs(30),
            answer_within: Duration::from_secs(3),
            program_within: Duration::from_secs(5),
            caps: MotionCaps::default(),
            calibrating: None,
            trigger: None,
            motion: MotionBy::Script,
        }
    }

    /// What a cell says about its controller, for this host.
    pub fn of_cell(cell: &Cell, host: impl Into<String>) -> Self {
        let robot = &cell.robot;
        let limits = &robot.limits;
        let patience = match &robot.motion {
            MotionBy::Script => Duration::from_secs(5),
            MotionBy::External(external) => Duration::from_secs_f64(external.patience_s.clamp(1.0, 3600.0)),
        };
        Self {
            frequency_hz: robot.sample_hz,
            caps: MotionCaps {
                joint_speed_rad_s: limits.joint_speed_rad_s,
                joint_acceleration_rad_s2: limits.joint_acceleration_rad_s2,
                tcp_speed_m_s: limits.tcp_speed_m_s,
                tcp_acceleration_m_s2: limits.tcp_acceleration_m_s2,
            },
            calibrating: robot.signals.calibrating.map(|output| Line::DigitalOutput(output.digital_output)),
            trigger: trigger_line(cell),
            motion: robot.motion.clone(),
            program_within: patience,
            ..Self::at(host)
        }
    }

    pub(super) fn address(&self, port: u16) -> String {
        // The colons of an IPv6 address are not that of the port.
        if self.host.contains(':') { format!("[{}]:{port}", self.host) } else { format!("{}:{port}", self.host) }
    }
}

/// The output that triggers the frame camera, where the cell wants that.
fn trigger_line(cell: &Cell) -> Option<Line> {
    match cell.rgb.as_ref()?.trigger {
        FrameTrigger::RobotOutput(output) => Some(Line::DigitalOutput(output)),
        FrameTrigger::FreeRun | FrameTrigger::Software => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn joint(speed_rad_s: f64, first_rad: f64) -> MoveTarget {
        MoveTarget::Joint { joints_rad: [first_rad, 0.0, 0.0, 0.0, 0.0, 0.0], speed_rad_s, acceleration_rad_s2: 1.0 }
    }

    #[test]
    fn only_finite_targets_below_the_caps_pass() {
        let caps = MotionCaps::default();
        assert!(caps.check(&joint(1.05, 0.0)).is_ok());
        for bad in [joint(1.06, 0.0), joint(0.0, 0.0), joint(-1.0, 0.0), joint(f64::NAN, 0.0), joint(1.0, f64::NAN)] {
            assert!(caps.check(&bad).is_err(), "{bad:?}");
        }
        let line = MoveTarget::Linear { tcp_pose: [0.0; 6], speed_m_s: 0.3, acceleration_m_s2: 0.1 };
        assert!(caps.check(&line).unwrap_err().to_string().contains("0.25"));
    }
}
