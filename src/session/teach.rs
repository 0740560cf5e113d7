//! Poses shown with the arm itself: what may be taken as one, and when.
//!
//! Samples and key presses go in, taught poses come out. The arm is moved by hand (freedrive) or with the
//! pendant, so there is no target to compare with: it stands still by what is measured alone, under the
//! limits of [`super::stillness`]. Start at [`Teacher`].

use std::collections::{BTreeSet, VecDeque};
use std::f64::consts::TAU;

use nalgebra::Vector3;

use super::modes::robot_mode_name;
use super::stillness::History;
use super::types::{RobotSample, Stamp};
use crate::config::{Stillness as Limits, TaughtPose, is_name};
use crate::geometry::{Base, Flange, Tcp, Transform, kinematics::Joints};

/// Robot modes in which the joints are measured: idle, backdrive, running.
const MEASURED_MODES: std::ops::RangeInclusive<i32> = 5..=7;
/// Two poses that are nearer than this in both are one too many, m and rad.
const NEAR: (f64, f64) = (5e-3, 1.0 * std::f64::consts::PI / 180.0);
/// A TCP that differs by more than this has been changed, m and rad.
const SAME_TCP: (f64, f64) = (1e-5, 1e-4);

/// How the arm stands.
#[derive(Debug, Clone, PartialEq)]
pub enum Light {
    /// Something moves now.
    Moving {
        /// What, in words.
        why: String,
    },
    /// Nothing moves, but not for long enough.
    Settling {
        /// For so long, s.
        still_s: f64,
        /// What the limits ask for, s.
        of_s: f64,
        /// What broke the window last, in words; absent where samples are only too few as yet.
        why: Option<String>,
    },
    /// Still for the whole window.
    Still,
}

impl std::fmt::Display for Light {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Moving { why } => write!(f, "moving: {why}"),
            Self::Settling { still_s, of_s, why: None } => write!(f, "settling {still_s:.2} of {of_s:.2} s"),
            Self::Settling { still_s, of_s, why: Some(why) } => {
                write!(f, "settling {still_s:.2} of {of_s:.2} s, before that {why}")
            }
            Self::Still => f.write_str("still"),
        }
    }
}

/// Why a pose is not taken.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TeachError {
    /// The arm moves, or has only just come to rest.
    #[error("the arm does not stand still: {light}; let go of it and wait for `still`")]
    NotStill {
        /// How it stands.
        light: Light,
    },
    /// The joints are not measured.
    #[error("the robot mode is {mode}, in which joint positions are not measured; power the arm on")]
    NotMeasured {
        /// Name of the robot mode.
        mode: String,
    },
    /// The name cannot be an id.
    #[error("{name:?} cannot be the name of a pose: use 1 to 64 letters, digits, - and _")]
    Name {
        /// As given.
        name: String,
    },
    /// The name is taken.
    #[error("there is a pose `{name}` already; use another name")]
    Doubled {
        /// As given.
        name: String,
    },
    /// The active TCP is another one than at the first pose.
    #[error(
        "the active TCP differs by {apart_mm:.3} mm and {apart_deg:.3} deg from the one at the first pose; \
         set it back on the pendant, or begin a new file"
    )]
    TcpChanged {
        /// Distance, mm.
        apart_mm: f64,
        /// Angle, degrees.
        apart_deg: f64,
    },
    /// A joint is where trajectory files end.
    #[error("joint {joint} is at {at_deg:.1} deg, outside -360 to 360 deg; turn it back")]
    BeyondTurn {
        /// Which one, from 1.
        joint: usize,
        /// Its position, degrees.
        at_deg: f64,
    },
}

/// Says what poses to add, from those that there are; `None` where there is nothing to say.
type Hint<'a> = dyn Fn(&[Transform<Base, Tcp>]) -> Option<String> + 'a;

/// What others know about poses.
#[derive(Clone, Copy)]
pub struct Advice<'a> {
    /// Whether arm, tool and load are clear of what is around at these joint positions; the error says what
    /// is not.
    pub is_clear: &'a dyn Fn(&Joints) -> Result<(), String>,
    /// A sentence on what poses to add.
    pub hint: &'a Hint<'a>,
}

/// What came of a pose that was taken.
#[derive(Debug, Clone, PartialEq)]
pub struct Taken {
    /// The pose.
    pub pose: TaughtPose,
    /// What speaks against it, in words.
    pub warnings: Vec<String>,
    /// What poses to add.
    pub hint: Option<String>,
}

/// Collects poses from the samples of an arm that somebody else moves.
#[derive(Debug)]
pub struct Teacher {
    limits: Limits,
    joint_limits_rad: [[f64; 2]; 6],
    /// Ids that poses may not have.
    ids: BTreeSet<String>,
    /// The window, and the newest sample before it.
    window: VecDeque<(Stamp, RobotSample)>,
    poses: Vec<TaughtPose>,
    /// The active TCP at the first pose.
    tcp_offset: Option<Transform<Flange, Tcp>>,
}

impl Teacher {
    /// Nothing taught yet. `ids` are those of other poses in the file; outside `joint_limits_rad` a pose is
    /// worth a warning.
    pub fn new(limits: Limits, joint_limits_rad: [[f64; 2]; 6], ids: BTreeSet<String>) -> Self {
        Self { limits, joint_limits_rad, ids, window: VecDeque::new(), poses: Vec::new(), tcp_offset: None }
    }

    /// Takes note of what the controller reports.
    pub fn sample(&mut self, at: Stamp, sample: &RobotSample) {
        self.window.push_back((at, sample.clone()));
        let from_s = at.seconds() - self.limits.window_s;
        while self.window.get(1).is_some_and(|(second, _)| second.seconds() <= from_s) {
            self.window.pop_front();
        }
    }

    /// What has been taught, in order.
    pub fn poses(&self) -> &[TaughtPose] {
        &self.poses
    }

    /// How the arm stands now.
    pub fn light(&self) -> Light {
        let Some((last, newest)) = self.window.back() else {
            return Light::Moving { why: "no sample has come yet".into() };
        };
        if let Some(why) = unrest(newest, &self.limits) {
            return Light::Moving { why };
        }
        let from_s = last.seconds() - self.limits.window_s;
        let mut calm = Calm { since: *last, samples: 0, range: newest.joints_rad.map(|q| [q, q]) };
        let settling = |calm: &Calm, why| {
            let still_s = last.seconds() - calm.since.seconds();
            Light::Settling { still_s, of_s: self.limits.window_s, why }
        };
        // Half a nanosecond of slack: stamps are whole nanoseconds.
        for (at, sample) in self.window.iter().rev().take_while(|(at, _)| at.seconds() >= from_s - 5e-10) {
            if let Err(why) = calm.extend(*at, sample, newest, &self.limits) {
                return settling(&calm, Some(why));
            }
        }
        let covered = self.window.front().is_some_and(|(first, _)| first.seconds() <= from_s);
        if !covered {
            return settling(&calm, None);
        }
        let (found, wanted) = (calm.samples, self.limits.min_samples as usize);
        if found < wanted {
            return settling(&calm, Some(format!("only {found} samples came, {wanted} are needed")));
        }
        let gap_s = calm.since.seconds() - from_s;
        let seen = gap_s <= self.limits.max_gap_s;
        if seen { Light::Still } else { settling(&calm, Some(gap(gap_s))) }
    }

    /// Takes where the arm stands as the next pose; without a name it becomes `p01`, `p02` and so on.
    pub fn take(&mut self, name: Option<&str>, advice: Advice<'_>) -> Result<Taken, TeachError> {
        let light = self.light();
        let (Light::Still, Some((_, newest))) = (&light, self.window.back()) else {
            return Err(TeachError::NotStill { light });
        };
        if !MEASURED_MODES.contains(&newest.robot_mode) {
            return Err(TeachError::NotMeasured { mode: robot_mode_name(newest.robot_mode) });
        }
        let tcp_offset = Transform::from_pose_vector(newest.tcp_offset);
        self.check_tcp(&tcp_offset)?;
        let name = self.name(name)?;
        let Some((joints_rad, base_from_tcp)) = self.mean() else { return Err(TeachError::NotStill { light }) };
        let inside = |q: &f64| q.abs() <= TAU;
        if let Some(joint) = joints_rad.iter().position(|q| !inside(q)) {
            return Err(TeachError::BeyondTurn { joint: joint + 1, at_deg: joints_rad[joint].to_degrees() });
        }
        let pose = TaughtPose { name, joints_rad, base_from_tcp };
        let warnings = self.warnings(&pose, advice);
        self.tcp_offset.get_or_insert(tcp_offset);
        self.poses.push(pose.clone());
        let taught: Vec<_> = self.poses.iter().map(|p| p.base_from_tcp).collect();
        Ok(Taken { pose, warnings, hint: (advice.hint)(&taught) })
    }

    /// Forgets the last pose and returns it.
    pub fn undo(&mut self) -> Option<TaughtPose> {
        let last = self.poses.pop();
        if self.poses.is_empty() {
            self.tcp_offset = None;
        }
        last
    }

    fn check_tcp(&self, now: &Transform<Flange, Tcp>) -> Result<(), TeachError> {
        let Some(first) = &self.tcp_offset else { return Ok(()) };
        let (metres, radians) = (first.distance_to_m(now), first.angle_to_rad(now));
        let same = metres <= SAME_TCP.0 && radians <= SAME_TCP.1;
        if same {
            return Ok(());
        }
        Err(TeachError::TcpChanged { apart_mm: metres * 1e3, apart_deg: radians.to_degrees() })
    }

    fn name(&self, given: Option<&str>) -> Result<String, TeachError> {
        let free = |name: &String| !self.ids.contains(name) && self.poses.iter().all(|p| p.name != *name);
        let Some(given) = given else {
            // One more than there are names: one of them is free.
            let count = self.poses.len();
            let numbered = (count + 1..=2 * count + self.ids.len() + 1).map(|n| format!("p{n:02}"));
            return Ok(numbered.into_iter().find(free).unwrap_or_default());
        };
        let name = given.to_owned();
        if !is_name(given) {
            return Err(TeachError::Name { name });
        }
        if free(&name) { Ok(name) } else { Err(TeachError::Doubled { name }) }
    }

    /// Mean joint positions and pose over the window.
    fn mean(&self) -> Option<(Joints, Transform<Base, Tcp>)> {
        let to_s = self.window.back()?.0.seconds();
        let mut history = History::default();
        self.window.iter().for_each(|(at, sample)| history.push(*at, sample, f64::INFINITY));
        let from_s = to_s - self.limits.window_s;
        history.mean_joints(from_s, to_s).zip(history.mean_pose(from_s, to_s))
    }

    fn warnings(&self, pose: &TaughtPose, advice: Advice<'_>) -> Vec<String> {
        let mut warnings = Vec::new();
        let apart = |other: &TaughtPose| {
            let pose = &pose.base_from_tcp;
            (pose.distance_to_m(&other.base_from_tcp), pose.angle_to_rad(&other.base_from_tcp))
        };
        for (other, (metres, radians)) in self.poses.iter().map(|other| (other, apart(other))) {
            if metres < NEAR.0 && radians < NEAR.1 {
                let (other, mm, deg) = (&other.name, metres * 1e3, radians.to_degrees());
                warnings.push(format!("it is only {mm:.2} mm and {deg:.2} deg from pose `{other}` and adds little"));
            }
        }
        for (i, (q, [min, max])) in pose.joints_rad.iter().zip(self.joint_limits_rad).enumerate() {
            if !(min..=max).contains(q) {
                let [q, min, max] = [*q, min, max].map(f64::to_degrees);
                let joint = i + 1;
                warnings.push(format!(
                    "joint {joint} is at {q:.1} deg, outside the {min:.1} to {max:.1} deg of the cell; it will be refused"
                ));
            }
        }
        warnings.extend((advice.is_clear)(&pose.joints_rad).err());
        warnings
    }
}

/// Samples, newest first, between which nothing moved.
struct Calm {
    /// The oldest of them.
    since: Stamp,
    samples: usize,
    /// Smallest and largest position of each joint, rad.
    range: [[f64; 2]; 6],
}

impl Calm {
    /// Adds the sample before, if nothing moved there either; otherwise says what did.
    fn extend(&mut self, at: Stamp, sample: &RobotSample, newest: &RobotSample, limits: &Limits) -> Result<(), String> {
        let gap_s = self.since.seconds() - at.seconds();
        let close = gap_s <= limits.max_gap_s;
        if !close {
            return Err(gap(gap_s));
        }
        if let Some(why) = unrest(sample, limits) {
            return Err(why);
        }
        if sample.tcp_offset != newest.tcp_offset {
            return Err("the active TCP was another".into());
        }
        let range = std::array::from_fn(|i| {
            let ([min, max], q) = (self.range[i], sample.joints_rad[i]);
            [min.min(q), max.max(q)]
        });
        let spread = |[min, max]: &[f64; 2]| *max - *min;
        let held = |r: &[f64; 2]| spread(r) <= limits.joint_spread_rad;
        if let Some(joint) = range.iter().position(|r| !held(r)) {
            let (joint, deg, limit_deg) =
                (joint + 1, spread(&range[joint]).to_degrees(), limits.joint_spread_rad.to_degrees());
            return Err(format!("joint {joint} drifted by {deg:.4} deg ({limit_deg:.4} allowed)"));
        }
        (self.since, self.samples, self.range) = (at, self.samples + 1, range);
        Ok(())
    }
}

fn gap(gap_s: f64) -> String {
    format!("no sample came for {gap_s:.2} s")
}

/// What moves in a sample, in words.
fn unrest(sample: &RobotSample, limits: &Limits) -> Option<String> {
    let slow = |s: &f64| s.abs() < limits.joint_speed_rad_s;
    if let Some(joint) = sample.joint_speeds_rad_s.iter().position(|s| !slow(s)) {
        let speed = sample.joint_speeds_rad_s[joint].to_degrees();
        return Some(format!("joint {} turns at {speed:.2} deg/s", joint + 1));
    }
    if let Some(joint) = sample.joints_rad.iter().position(|q| !q.is_finite()) {
        return Some(format!("joint {} has no position", joint + 1));
    }
    let [x, y, z, rx, ry, rz] = sample.tcp_speed;
    let (speed, turn) = (Vector3::new(x, y, z).norm(), Vector3::new(rx, ry, rz).norm());
    let tcp_slow = speed < limits.tcp_speed_m_s;
    if !tcp_slow {
        return Some(format!("the TCP moves at {:.1} mm/s", speed * 1e3));
    }
    let not_turning = turn < limits.tcp_rotation_rad_s;
    (!not_turning).then(|| format!("the TCP turns at {:.2} deg/s", turn.to_degrees()))
}

#[cfg(test)]
mod tests;
