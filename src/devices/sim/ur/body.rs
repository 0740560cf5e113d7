//! The controller without its sockets and its program: arm, safety, registers, watchdogs.

use super::config::{Individual, SimUrConfig};
use super::inputs::{Inputs, REGISTERS};
use super::motion::{Motion, TICK_S};
use crate::devices::rtde::{TextLevel, TextMessage};
use crate::geometry::kinematics::Joints;

/// Nanoseconds of one controller cycle.
pub(super) const TICK_NS: u64 = 2_000_000;

/// Text messages kept for clients that have not fetched them.
const MAX_TEXTS: usize = 100;

/// Whether the drives may move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Safety {
    Normal,
    ProtectiveStop,
    EmergencyStop,
}

/// State of the user's program; the numbers of RTDE.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Runtime {
    Stopped = 1,
    Playing = 2,
    Paused = 4,
}

/// What a watchdog does when its input is late.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum WatchdogAction {
    Ignore,
    Pause,
    Stop,
}

/// One `rtde_set_watchdog`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Watchdog {
    pub(super) slot: usize,
    pub(super) period_ticks: u64,
    pub(super) since_tick: u64,
    pub(super) action: WatchdogAction,
}

/// The controller's state, advanced tick by tick.
#[derive(Debug)]
pub(super) struct Body {
    pub(super) config: SimUrConfig,
    pub(super) seed: u64,
    pub(super) tick: u64,
    pub(super) motion: Motion,
    pub(super) inputs: Inputs,
    pub(super) output_int: [i32; REGISTERS],
    pub(super) output_double: [f64; REGISTERS],
    pub(super) digital_inputs: u64,
    pub(super) digital_outputs: u64,
    pub(super) safety: Safety,
    pub(super) powered: bool,
    pub(super) runtime: Runtime,
    pub(super) watchdogs: Vec<Watchdog>,
    texts: Vec<TextMessage>,
}

impl Body {
    pub(super) fn new(config: &SimUrConfig, individual: &Individual, seed: u64) -> Self {
        Self {
            config: config.clone(),
            seed,
            tick: 0,
            motion: Motion::new(config, individual, seed),
            inputs: Inputs::new(),
            output_int: [0; REGISTERS],
            output_double: [0.0; REGISTERS],
            digital_inputs: 0,
            digital_outputs: 0,
            safety: Safety::Normal,
            powered: true,
            runtime: Runtime::Stopped,
            watchdogs: Vec::new(),
            texts: Vec::new(),
        }
    }

    /// Simulated time, nanoseconds.
    pub(super) fn now_ns(&self) -> u64 {
        self.tick * TICK_NS
    }

    /// Simulated time, s.
    pub(super) fn now_s(&self) -> f64 {
        self.now_ns() as f64 * 1e-9
    }

    /// Whether a program may run.
    pub(super) fn may_run(&self) -> bool {
        self.powered && self.safety == Safety::Normal
    }

    pub(super) fn speed_fraction(&self) -> f64 {
        self.inputs.speed_slider().unwrap_or(self.config.speed_fraction).clamp(0.0, 1.0)
    }

    pub(super) fn say(&mut self, level: TextLevel, message: impl Into<String>) {
        if self.texts.len() < MAX_TEXTS {
            self.texts.push(TextMessage { message: message.into(), source: "simulator".into(), level });
        }
    }

    pub(super) fn take_texts(&mut self) -> Vec<TextMessage> {
        std::mem::take(&mut self.texts)
    }

    /// Whether a late input asks to stop the program; pauses are done here.
    pub(super) fn watchdogs_stop(&mut self) -> bool {
        if self.runtime != Runtime::Playing {
            return false;
        }
        let late = |w: &&Watchdog| {
            let last = self.inputs.updated_tick(w.slot).max(w.since_tick);
            self.tick.saturating_sub(last) > w.period_ticks
        };
        let actions: Vec<_> = self.watchdogs.iter().filter(late).map(|w| w.action).collect();
        if actions.contains(&WatchdogAction::Stop) {
            self.say(TextLevel::Error, "RTDE watchdog: input is late, program stopped");
            return true;
        }
        if actions.contains(&WatchdogAction::Pause) {
            self.say(TextLevel::Warning, "RTDE watchdog: input is late, program paused");
            self.pause_program();
        }
        false
    }

    /// What a program stop does to the body; the program itself belongs to the caller.
    pub(super) fn program_ended(&mut self) {
        self.runtime = Runtime::Stopped;
        self.watchdogs.clear();
        if self.motion.is_busy() {
            self.motion.stop(self.config.program_stop_rad_s2);
        }
    }

    pub(super) fn pause_program(&mut self) {
        if self.runtime == Runtime::Playing {
            self.runtime = Runtime::Paused;
            self.motion.pause(self.config.program_stop_rad_s2);
        }
    }

    pub(super) fn resume_program(&mut self) {
        if self.runtime == Runtime::Paused && self.may_run() {
            self.runtime = Runtime::Playing;
            self.watchdogs.iter_mut().for_each(|w| w.since_tick = self.tick);
            self.motion.resume();
        }
    }

    pub(super) fn protective_stop(&mut self, why: &str) {
        self.safety = Safety::ProtectiveStop;
        self.say(TextLevel::Exception, format!("protective stop: {why}"));
        self.motion.pause(self.config.safety_stop_rad_s2);
        if self.runtime == Runtime::Playing {
            self.runtime = Runtime::Paused;
        }
    }

    /// One cycle of the drives.
    pub(super) fn tick_drives(&mut self) {
        self.tick += 1;
        let fraction = self.speed_fraction();
        if let Err(fault) = self.motion.tick(fraction) {
            self.protective_stop(&fault.0);
        }
    }

    /// What `is_within_safety_limits` says for joint positions: joint limits and the box of the TCP.
    pub(super) fn is_within_limits(&self, joints_rad: &Joints) -> bool {
        let arm = self.motion.arm();
        let inside = |q: f64, [low, high]: [f64; 2]| q >= low && q <= high;
        let joints_good = joints_rad.iter().zip(&arm.joints).all(|(q, joint)| inside(*q, joint.limits_rad));
        let tcp = self.motion.base_from_tcp(joints_rad).translation_m();
        let boxed = |limits: &[[f64; 2]; 3]| tcp.iter().zip(limits).all(|(x, range)| inside(*x, *range));
        joints_good && self.config.safety_box_m.as_ref().is_none_or(boxed)
    }

    /// Ticks of a time, rounded up, at least one.
    pub(super) fn ticks_of(seconds: f64) -> u64 {
        (seconds / TICK_S).ceil().max(1.0) as u64
    }
}
