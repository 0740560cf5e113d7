//! How a session is run, besides what its cell says.

use std::collections::BTreeMap;

use crate::config::Cell;

/// How a session is run, besides what the cell says; a recording carries it.
#[derive(Debug, Clone, PartialEq)]
pub struct RunOptions {
    /// Share of the speed and acceleration caps, above 0, to 1.
    pub speed: f64,
    /// Whether the operator confirms every move.
    pub confirm_each: bool,
    /// Whether the poses are walked without cameras.
    pub rehearsal: bool,
}

impl Default for RunOptions {
    fn default() -> Self {
        Self { speed: 1.0, confirm_each: false, rehearsal: false }
    }
}

impl RunOptions {
    /// As facts of a recording.
    pub fn to_facts(&self) -> impl Iterator<Item = (String, String)> {
        let flag = |name: &str, set: bool| set.then(|| (name.to_owned(), "true".to_owned()));
        let slow = (self.speed < 1.0).then(|| ("speed".to_owned(), self.speed.to_string()));
        let flags = [flag("confirm_each", self.confirm_each), flag("rehearsal", self.rehearsal)];
        flags.into_iter().flatten().chain(slow)
    }

    /// Reads them back.
    pub fn of_facts(facts: &BTreeMap<String, String>) -> Self {
        let flag = |name: &str| facts.get(name).is_some_and(|v| v == "true");
        let speed = facts.get("speed").and_then(|v| v.parse().ok()).filter(|s: &f64| *s > 0.0 && *s <= 1.0);
        Self { speed: speed.unwrap_or(1.0), confirm_each: flag("confirm_each"), rehearsal: flag("rehearsal") }
    }

    pub(super) fn slow_down(&self, cell: &mut Cell) {
        let limits = &mut cell.robot.limits;
        for cap in [
            &mut limits.joint_speed_rad_s,
            &mut limits.joint_acceleration_rad_s2,
            &mut limits.tcp_speed_m_s,
            &mut limits.tcp_acceleration_m_s2,
        ] {
            *cap *= self.speed;
        }
    }
}
