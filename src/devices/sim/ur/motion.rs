//! How the simulated arm moves: trapezoidal paths, slowing down on a path, commanded speeds, ringing
//! after a stop.

#[cfg(test)]
mod tests;
mod velocity;

use super::config::{Flaws, Individual, SimUrConfig};
use super::noise::{self, Stream};
use crate::geometry::{
    Base, Flange, Tcp, Transform,
    kinematics::{Arm, Joints},
};

/// One controller cycle, s.
pub(super) const TICK_S: f64 = 0.002;

/// Turning by 1 rad takes as long as moving by this length, m.
const EQUIVALENT_RADIUS_M: f64 = 0.2;

pub(super) use velocity::{Goal, SERVO_RAD_S2};

use velocity::Speeding;

/// Largest joint speed of the drives, rad/s; a path that asks for more is a protective stop.
const MAX_JOINT_SPEED_RAD_S: f64 = std::f64::consts::PI;

/// Time in which the unseen part of the pose settles to a new place while moving, s.
const SETTLE_S: f64 = 0.1;

/// Gentlest deceleration that a stop may ask for, rad/s2.
const MIN_BRAKING_RAD_S2: f64 = 0.01;

/// A path from 0 to 1 with constant acceleration, constant speed, constant deceleration.
#[derive(Debug, Clone, Copy)]
struct Trapezoid {
    ramp_s: f64,
    cruise_s: f64,
    acceleration: f64,
}

impl Trapezoid {
    /// For a length with a largest speed and acceleration, all in the same unit.
    fn new(length: f64, speed: f64, acceleration: f64) -> Self {
        let (speed, acceleration) = (speed / length, acceleration / length);
        let ramp_s = (speed / acceleration).min((1.0 / acceleration).sqrt());
        let cruise_s = ((1.0 - acceleration * ramp_s * ramp_s) / (acceleration * ramp_s)).max(0.0);
        Self { ramp_s, cruise_s, acceleration }
    }

    fn duration_s(&self) -> f64 {
        2.0 * self.ramp_s + self.cruise_s
    }

    fn at(&self, time_s: f64) -> f64 {
        let left_s = self.duration_s() - time_s;
        if time_s < self.ramp_s {
            0.5 * self.acceleration * time_s * time_s
        } else if left_s > self.ramp_s {
            self.acceleration * self.ramp_s * (time_s - 0.5 * self.ramp_s)
        } else {
            1.0 - 0.5 * self.acceleration * left_s.max(0.0) * left_s.max(0.0)
        }
    }
}

#[derive(Debug, Clone)]
enum Way {
    Joint { from: Joints, to: Joints },
    Line { from: Transform<Base, Flange>, to: Transform<Base, Flange> },
}

#[derive(Debug, Clone)]
struct Path {
    way: Way,
    profile: Trapezoid,
    time_s: f64,
}

/// What the arm is asked to do with its path.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Pace {
    /// Follow it.
    Follow,
    /// Slow down and stay on it.
    Pause { per_s: f64 },
    /// Slow down and forget it.
    Stop { per_s: f64 },
}

#[derive(Debug, Clone, Copy)]
struct Ring {
    direction: Joints,
    angular_rad_s: f64,
    decay_s: f64,
    age_s: f64,
}

impl Ring {
    fn offset(&self) -> Joints {
        let size = (-self.age_s / self.decay_s).exp() * (self.angular_rad_s * self.age_s).sin();
        self.direction.map(|d| d * size)
    }

    fn speed(&self) -> Joints {
        let (sine, cosine) = (self.angular_rad_s * self.age_s).sin_cos();
        let size = (-self.age_s / self.decay_s).exp() * (self.angular_rad_s * cosine - sine / self.decay_s);
        self.direction.map(|d| d * size)
    }

    /// Largest joint speed that is still to come, rad/s.
    fn envelope_rad_s(&self) -> f64 {
        largest(&self.direction) * self.angular_rad_s * (-self.age_s / self.decay_s).exp()
    }
}

/// Why the drives gave up on a path.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PathFault(pub(super) String);

/// The arm: its targets, its true deviations, and the path it follows.
#[derive(Debug)]
pub(super) struct Motion {
    arm: Arm,
    flange_from_tcp: Transform<Flange, Tcp>,
    flaws: Flaws,
    seed: u64,
    steady_rad_s: f64,
    joint_offsets_rad: Joints,
    target: Joints,
    target_speed: Joints,
    path: Option<Path>,
    /// A commanded speed; never together with a path.
    speeding: Option<Speeding>,
    pace: Pace,
    rate: f64,
    /// With which a commanded speed is left, rad/s2.
    braking_rad_s2: f64,
    ring: Option<Ring>,
    unseen: Joints,
    unseen_goal: Joints,
    stops: u64,
    begun: u64,
}

impl Motion {
    pub(super) fn new(config: &SimUrConfig, individual: &Individual, seed: u64) -> Self {
        Self {
            arm: individual.believed.arm(&Arm::ur5e()),
            flange_from_tcp: Transform::from_pose_vector(config.tcp_offset),
            flaws: config.flaws.clone(),
            seed,
            steady_rad_s: config.steady_rad_s,
            joint_offsets_rad: individual.joint_offsets_rad,
            target: config.start_joints_rad,
            target_speed: [0.0; 6],
            path: None,
            speeding: None,
            pace: Pace::Follow,
            rate: 1.0,
            braking_rad_s2: MIN_BRAKING_RAD_S2,
            ring: None,
            unseen: [0.0; 6],
            unseen_goal: [0.0; 6],
            stops: 0,
            begun: 0,
        }
    }

    /// Motions begun so far.
    pub(super) fn begun(&self) -> u64 {
        self.begun
    }

    pub(super) fn set_tcp_offset(&mut self, tcp_offset: [f64; 6]) {
        self.flange_from_tcp = Transform::from_pose_vector(tcp_offset);
    }

    /// The controller's model.
    pub(super) fn arm(&self) -> &Arm {
        &self.arm
    }

    pub(super) fn target(&self) -> Joints {
        self.target
    }

    pub(super) fn target_speed(&self) -> Joints {
        self.target_speed
    }

    /// Joint positions that perfect encoders would measure.
    pub(super) fn encoded(&self) -> Joints {
        let ring = self.ring.map_or([0.0; 6], |r| r.offset());
        std::array::from_fn(|i| self.target[i] + ring[i])
    }

    /// Joint speeds that perfect encoders would measure.
    pub(super) fn encoded_speed(&self) -> Joints {
        let ring = self.ring.map_or([0.0; 6], |r| r.speed());
        std::array::from_fn(|i| self.target_speed[i] + ring[i])
    }

    /// Joint positions for the true model.
    pub(super) fn true_joints(&self) -> Joints {
        let encoded = self.encoded();
        std::array::from_fn(|i| encoded[i] + self.joint_offsets_rad[i] + self.unseen[i])
    }

    pub(super) fn base_from_flange(&self) -> Transform<Base, Flange> {
        self.arm.forward(&self.target)
    }

    pub(super) fn base_from_tcp(&self, joints_rad: &Joints) -> Transform<Base, Tcp> {
        self.arm.forward(joints_rad) * self.flange_from_tcp
    }

    /// Joint positions for a TCP pose, near `seed_rad`; `None` out of reach.
    pub(super) fn joints_for(&self, tcp_pose: [f64; 6], seed_rad: &Joints) -> Option<Joints> {
        let base_from_tcp = Transform::<Base, Tcp>::from_pose_vector(tcp_pose);
        if !base_from_tcp.is_finite() {
            return None;
        }
        self.arm.inverse(&(base_from_tcp * self.flange_from_tcp.inverse()), seed_rad).ok()
    }

    /// Speed of the TCP for these joint speeds: m/s and rad/s in `base`.
    pub(super) fn tcp_speed(&self, joints_rad: &Joints, speeds_rad_s: &Joints) -> [f64; 6] {
        let twist = self.arm.jacobian(joints_rad) * nalgebra::Vector6::from(*speeds_rad_s);
        let (linear, angular) = (twist.fixed_rows::<3>(0), twist.fixed_rows::<3>(3));
        let lever = self.arm.forward(joints_rad).rotation() * self.flange_from_tcp.iso().translation.vector;
        let at_tcp = linear + angular.cross(&lever);
        [at_tcp.x, at_tcp.y, at_tcp.z, angular.x, angular.y, angular.z]
    }

    /// Whether a path or a commanded speed is being followed or left.
    pub(super) fn is_busy(&self) -> bool {
        self.path.is_some() || self.speeding.is_some()
    }

    /// Whether it is on its way to rest.
    pub(super) fn is_stopping(&self) -> bool {
        matches!(self.pace, Pace::Stop { .. })
    }

    /// Where the path ends, or where the TCP is.
    pub(super) fn waypoint(&self) -> Transform<Base, Tcp> {
        match self.path.as_ref().map(|path| &path.way) {
            Some(Way::Joint { to, .. }) => self.base_from_tcp(to),
            Some(Way::Line { to, .. }) => *to * self.flange_from_tcp,
            None => self.base_from_tcp(&self.target),
        }
    }

    /// What `is_steady()` says: no motion and the ringing has died down.
    pub(super) fn is_steady(&self) -> bool {
        !self.is_busy() && self.ring.is_none_or(|r| r.envelope_rad_s() < self.steady_rad_s)
    }

    /// Starts a joint move; speed and acceleration are those of the leading joint.
    pub(super) fn start_joint_move(&mut self, to: Joints, speed_rad_s: f64, acceleration_rad_s2: f64) {
        let (way, length) = self.joint_way(to);
        self.start(way, length, speed_rad_s, acceleration_rad_s2);
    }

    /// Starts a straight line of the flange that ends at these joint positions.
    pub(super) fn start_line(&mut self, to: &Joints, speed_m_s: f64, acceleration_m_s2: f64) {
        let (way, length) = self.line_way(to);
        self.start(way, length, speed_m_s, acceleration_m_s2);
    }

    /// Starts a line or a joint move that takes this time; a quarter of it each for speeding up and slowing down.
    pub(super) fn start_timed(&mut self, to: Joints, line: bool, time_s: f64) {
        let (way, length) = if line { self.line_way(&to) } else { self.joint_way(to) };
        let (speed, ramp_s) = (length / (0.75 * time_s), 0.25 * time_s);
        self.start(way, length, speed, speed / ramp_s);
    }

    fn joint_way(&self, to: Joints) -> (Way, f64) {
        let from = self.target;
        let length = (0..6).map(|i| (to[i] - from[i]).abs()).fold(0.0, f64::max);
        (Way::Joint { from, to }, length)
    }

    fn line_way(&self, to: &Joints) -> (Way, f64) {
        let (from, to) = (self.base_from_tcp(&self.target), self.base_from_tcp(to));
        let length = from.distance_to_m(&to).max(EQUIVALENT_RADIUS_M * from.angle_to_rad(&to));
        let tcp_from_flange = self.flange_from_tcp.inverse();
        (Way::Line { from: from * tcp_from_flange, to: to * tcp_from_flange }, length)
    }

    fn start(&mut self, way: Way, length: f64, speed: f64, acceleration: f64) {
        let moves = length > 1e-9;
        if !moves {
            return;
        }
        self.begun += 1;
        let profile = Trapezoid::new(length, speed, acceleration);
        self.path = Some(Path { way, profile, time_s: 0.0 });
        (self.pace, self.rate) = (Pace::Follow, 1.0);
        self.unsettle();
    }

    /// Every way to rest ends a little elsewhere.
    fn unsettle(&mut self) {
        let mut rng = noise::generator(self.seed, Stream::Settling, self.stops);
        let size_m = noise::between(&mut rng, self.flaws.repeatability_m);
        self.unseen_goal = self.scaled_to_flange(noise::normal(&mut rng, 1.0), size_m);
    }

    /// Slows down and forgets the path; the leading joint decelerates with at least this, rad/s2.
    ///
    /// Does nothing while the arm stands.
    pub(super) fn stop(&mut self, deceleration_rad_s2: f64) {
        if !self.is_busy() {
            return;
        }
        self.braking_rad_s2 = deceleration_rad_s2.max(MIN_BRAKING_RAD_S2);
        self.pace = Pace::Stop { per_s: self.slowing_per_s(deceleration_rad_s2) };
    }

    /// Slows down and stays on the path.
    pub(super) fn pause(&mut self, deceleration_rad_s2: f64) {
        self.braking_rad_s2 = deceleration_rad_s2.max(MIN_BRAKING_RAD_S2);
        self.pace = Pace::Pause { per_s: self.slowing_per_s(deceleration_rad_s2) };
    }

    /// Follows the path again after a pause.
    pub(super) fn resume(&mut self) {
        self.pace = Pace::Follow;
    }

    fn slowing_per_s(&self, deceleration_rad_s2: f64) -> f64 {
        deceleration_rad_s2.max(MIN_BRAKING_RAD_S2) * self.rate / largest(&self.target_speed).max(1e-3)
    }

    /// One cycle; the path runs at `speed_fraction` of its planned speed.
    pub(super) fn tick(&mut self, speed_fraction: f64) -> Result<(), PathFault> {
        if let Some(ring) = &mut self.ring {
            ring.age_s += TICK_S;
            if ring.age_s > 20.0 * ring.decay_s {
                self.ring = None;
            }
        }
        if !self.is_busy() {
            return Ok(());
        }
        for i in 0..6 {
            self.unseen[i] += (self.unseen_goal[i] - self.unseen[i]) * (TICK_S / SETTLE_S);
        }
        if self.speeding.is_some() {
            return self.speed_on(speed_fraction);
        }
        self.update_rate();
        self.follow(speed_fraction)
    }

    fn update_rate(&mut self) {
        match self.pace {
            Pace::Follow => self.rate = (self.rate + TICK_S / 0.2).min(1.0),
            Pace::Pause { per_s } | Pace::Stop { per_s } => self.rate = (self.rate - per_s * TICK_S).max(0.0),
        }
    }

    fn follow(&mut self, speed_fraction: f64) -> Result<(), PathFault> {
        let Some(mut path) = self.path.take() else { return Ok(()) };
        path.time_s += TICK_S * self.rate * speed_fraction;
        let arrived = path.time_s >= path.profile.duration_s();
        let next = self.along(&path).inspect_err(|_| self.came_to_rest())?;
        let speed: Joints = std::array::from_fn(|i| (next[i] - self.target[i]) / TICK_S);
        let fast = !speed.iter().all(|v| v.abs() <= MAX_JOINT_SPEED_RAD_S);
        if fast {
            self.came_to_rest();
            return Err(PathFault(format!("a joint would move at {:.2} rad/s", largest(&speed))));
        }
        let stopped = self.rate <= 0.0 && matches!(self.pace, Pace::Stop { .. });
        let before = self.target_speed;
        (self.target, self.target_speed) = (next, speed);
        if arrived || stopped {
            self.came_to_rest();
            self.start_ring(&before);
        } else {
            self.path = Some(path);
        }
        Ok(())
    }

    fn along(&self, path: &Path) -> Result<Joints, PathFault> {
        let fraction = path.profile.at(path.time_s);
        match &path.way {
            Way::Joint { from, to } => Ok(std::array::from_fn(|i| from[i] + fraction * (to[i] - from[i]))),
            Way::Line { from, to } => {
                let wanted = from.interpolate(to, fraction);
                self.arm.inverse(&wanted, &self.target).map_err(|e| PathFault(e.to_string()))
            }
        }
    }

    fn came_to_rest(&mut self) {
        self.target_speed = [0.0; 6];
        (self.path, self.speeding) = (None, None);
        self.pace = Pace::Follow;
        self.rate = 1.0;
    }

    fn start_ring(&mut self, last_speed: &Joints) {
        self.stops += 1;
        let mut rng = noise::generator(self.seed, Stream::Stop, self.stops);
        let amplitude_m = noise::between(&mut rng, self.flaws.ring_amplitude_m);
        let frequency_hz = noise::between(&mut rng, self.flaws.ring_frequency_hz);
        let decay_s = noise::between(&mut rng, self.flaws.ring_decay_s);
        let shape = if largest(last_speed) > 0.0 { *last_speed } else { noise::normal(&mut rng, 1.0) };
        let direction = self.scaled_to_flange(shape, amplitude_m);
        let angular_rad_s = frequency_hz * std::f64::consts::TAU;
        self.ring = (amplitude_m > 0.0).then_some(Ring { direction, angular_rad_s, decay_s, age_s: 0.0 });
    }

    /// Small joint displacement of this shape that moves the flange by `size_m`.
    fn scaled_to_flange(&self, shape: Joints, size_m: f64) -> Joints {
        let twist = self.arm.jacobian(&self.target) * nalgebra::Vector6::from(shape);
        let moved_m = twist.fixed_rows::<3>(0).norm();
        let length = largest(&shape);
        if length <= 0.0 {
            return [0.0; 6];
        }
        // Turning the last joint hardly moves the flange: never more than 1 mrad for that.
        let scale = (size_m / moved_m).min(1e-3 / length);
        shape.map(|s| s * scale)
    }
}

/// Largest absolute value.
pub(super) fn largest(values: &Joints) -> f64 {
    values.iter().fold(0.0, |sum, v| v.abs().max(sum))
}
