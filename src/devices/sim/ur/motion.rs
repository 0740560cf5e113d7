//! How the simulated arm moves: trapezoidal paths, slowing down on a path, ringing after a stop.

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

/// Largest joint speed of the drives, rad/s; a path that asks for more is a protective stop.
const MAX_JOINT_SPEED_RAD_S: f64 = std::f64::consts::PI;

/// Time in which the unseen part of the pose settles to a new place while moving, s.
const SETTLE_S: f64 = 0.1;

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
    pace: Pace,
    rate: f64,
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
            pace: Pace::Follow,
            rate: 1.0,
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

    /// Whether a path is being followed or left.
    pub(super) fn is_busy(&self) -> bool {
        self.path.is_some()
    }

    /// What `is_steady()` says: no motion and the ringing has died down.
    pub(super) fn is_steady(&self) -> bool {
        self.path.is_none() && self.ring.is_none_or(|r| r.envelope_rad_s() < self.steady_rad_s)
    }

    /// Starts a joint move; speed and acceleration are those of the leading joint.
    pub(super) fn start_joint_move(&mut self, to: Joints, speed_rad_s: f64, acceleration_rad_s2: f64) {
        let from = self.target;
        let length = (0..6).map(|i| (to[i] - from[i]).abs()).fold(0.0, f64::max);
        self.start(Way::Joint { from, to }, length, speed_rad_s, acceleration_rad_s2);
    }

    /// Starts a straight line of the flange that ends at these joint positions.
    pub(super) fn start_line(&mut self, to: &Joints, speed_m_s: f64, acceleration_m_s2: f64) {
        let (from, to) = (self.base_from_tcp(&self.target), self.base_from_tcp(to));
        let length = from.distance_to_m(&to).max(EQUIVALENT_RADIUS_M * from.angle_to_rad(&to));
        let tcp_from_flange = self.flange_from_tcp.inverse();
        let way = Way::Line { from: from * tcp_from_flange, to: to * tcp_from_flange };
        self.start(way, length, speed_m_s, acceleration_m_s2);
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
        let mut rng = noise::generator(self.seed, Stream::Settling, self.stops);
        let size_m = noise::between(&mut rng, self.flaws.repeatability_m);
        self.unseen_goal = self.scaled_to_flange(noise::normal(&mut rng, 1.0), size_m);
    }

    /// Slows down and forgets the path; the leading joint decelerates with at least this, rad/s2.
    pub(super) fn stop(&mut self, deceleration_rad_s2: f64) {
        self.pace = Pace::Stop { per_s: self.slowing_per_s(deceleration_rad_s2) };
    }

    /// Slows down and stays on the path.
    pub(super) fn pause(&mut self, deceleration_rad_s2: f64) {
        self.pace = Pace::Pause { per_s: self.slowing_per_s(deceleration_rad_s2) };
    }

    /// Follows the path again after a pause.
    pub(super) fn resume(&mut self) {
        self.pace = Pace::Follow;
    }

    fn slowing_per_s(&self, deceleration_rad_s2: f64) -> f64 {
        deceleration_rad_s2.max(0.01) * self.rate / largest(&self.target_speed).max(1e-3)
    }

    /// One cycle; the path runs at `speed_fraction` of its planned speed.
    pub(super) fn tick(&mut self, speed_fraction: f64) -> Result<(), PathFault> {
        if let Some(ring) = &mut self.ring {
            ring.age_s += TICK_S;
            if ring.age_s > 20.0 * ring.decay_s {
                self.ring = None;
            }
        }
        if self.path.is_none() {
            return Ok(());
        }
        for i in 0..6 {
            self.unseen[i] += (self.unseen_goal[i] - self.unseen[i]) * (TICK_S / SETTLE_S);
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
        self.path = None;
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

#[cfg(test)]
mod tests {
    use super::*;

    fn flawless(seed: u64) -> Motion {
        let config = SimUrConfig { flaws: Flaws::none(), ..SimUrConfig::default() };
        Motion::new(&config, &Individual::draw(&config, seed), seed)
    }

    #[test]
    fn a_joint_move_keeps_its_speed_and_acceleration() {
        let mut motion = flawless(1);
        let from = motion.target();
        motion.start_joint_move(std::array::from_fn(|i| from[i] + 0.1 * i as f64), 0.4, 0.8);
        let (mut time_s, mut before, mut fastest) = (0.0, 0.0, 0.0_f64);
        while motion.is_busy() {
            motion.tick(1.0).unwrap();
            let speed = motion.target_speed()[5];
            assert!((speed - before).abs() <= 0.8 * TICK_S + 0.4e-2, "{speed} after {before}");
            (before, fastest, time_s) = (speed, fastest.max(speed), time_s + TICK_S);
        }
        // 0.5 rad at 0.4 rad/s and 0.8 rad/s2: ramps of 0.5 s and 0.1 rad each, 0.3 rad in 0.75 s.
        assert!((time_s - 1.75).abs() < 3.0 * TICK_S, "{time_s}");
        assert!((fastest - 0.4).abs() < 1e-9, "{fastest}");
        assert!((motion.target()[5] - from[5] - 0.5).abs() < 1e-12);
    }

    #[test]
    fn short_moves_are_triangles() {
        let profile = Trapezoid::new(0.1, 10.0, 1.0);
        assert!((profile.duration_s() - 2.0 * 0.1_f64.sqrt()).abs() < 1e-12);
        assert!((profile.at(profile.duration_s() / 2.0) - 0.5).abs() < 1e-12);
        assert!((profile.at(profile.duration_s()) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_stop_slows_the_leading_joint_as_asked_and_stays_on_the_path() {
        let mut motion = flawless(2);
        let from = motion.target();
        motion.start_joint_move(from.map(|q| q + 2.0), 1.0, 10.0);
        (0..250).for_each(|_| motion.tick(1.0).unwrap());
        motion.stop(5.0);
        let mut ticks = 0;
        while motion.is_busy() {
            motion.tick(1.0).unwrap();
            ticks += 1;
        }
        assert!((f64::from(ticks) * TICK_S - 0.2).abs() < 0.005, "{ticks} ticks");
        let moved = motion.target()[0] - from[0];
        assert!((motion.target()[3] - from[3] - moved).abs() < 1e-12 && moved < 0.6);
    }

    #[test]
    fn ringing_has_the_size_asked_for_and_dies() {
        let config = SimUrConfig::default();
        let mut motion = Motion::new(&config, &Individual::draw(&config, 3), 3);
        let to = std::array::from_fn(|i| motion.target()[i] + 0.2);
        motion.start_joint_move(to, 1.0, 3.0);
        while motion.is_busy() {
            motion.tick(1.0).unwrap();
        }
        assert!(!motion.is_steady());
        let rest = motion.arm().forward(&motion.target());
        let mut largest_m = 0.0_f64;
        let mut ticks = 0;
        while !motion.is_steady() {
            motion.tick(1.0).unwrap();
            largest_m = largest_m.max(rest.distance_to_m(&motion.arm().forward(&motion.encoded())));
            ticks += 1;
        }
        assert!((0.04e-3..0.5e-3).contains(&largest_m), "{largest_m}");
        assert!((20..600).contains(&ticks), "{ticks}");
    }

    #[test]
    fn a_line_out_of_reach_is_a_fault() {
        let mut motion = flawless(4);
        let stretched = [0.0, -1.57, 0.0, 0.0, 1.57, 0.0];
        let mut other = stretched;
        other[0] = 3.0;
        motion.target = stretched;
        // Through the axis of the base: the first joint would have to jump.
        motion.start_line(&other, 0.25, 0.5);
        let fault = (0..5000).find_map(|_| motion.tick(1.0).err());
        assert!(fault.is_some());
    }
}
