//! The controller without its sockets and its program: arm, safety, registers, watchdogs.

use super::config::{Individual, SimUrConfig};
use super::inputs::{Inputs, REGISTERS};
use super::io::Io;
use super::motion::{Motion, TICK_S};
use super::panel::Panel;
use crate::devices::rtde::{TextLevel, TextMessage};
use crate::geometry::kinematics::Joints;

/// Nanoseconds of one controller cycle.
pub(super) const TICK_NS: u64 = 2_000_000;

/// Text messages kept for clients that have not fetched them.
const MAX_TEXTS: usize = 100;

/// Time that a controller takes to boot.
const BOOT_S: f64 = 5.0;

/// State of the safety system, the worst last; the numbers are the safety modes of RTDE.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Safety {
    Normal = 1,
    Reduced = 2,
    ProtectiveStop = 3,
    SafeguardStop = 5,
    EmergencyStop = 7,
    Violation = 8,
    Fault = 9,
}

impl Safety {
    /// The safety mode of RTDE.
    pub(super) fn mode(self) -> i32 {
        self as i32
    }

    /// The safety status bits of RTDE.
    pub(super) fn status_bits(self) -> u32 {
        const STOPPED_DUE_TO_SAFETY: u32 = 1 << 10;
        match self {
            Self::Normal => 1,
            Self::Reduced => 1 << 1,
            Self::ProtectiveStop => 1 << 2 | STOPPED_DUE_TO_SAFETY,
            Self::SafeguardStop => 1 << 4 | STOPPED_DUE_TO_SAFETY,
            Self::EmergencyStop => 1 << 6 | 1 << 7 | STOPPED_DUE_TO_SAFETY,
            Self::Violation => 1 << 8 | STOPPED_DUE_TO_SAFETY,
            Self::Fault => 1 << 9 | STOPPED_DUE_TO_SAFETY,
        }
    }

    /// The word of the dashboard.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Normal => "NORMAL",
            Self::Reduced => "REDUCED",
            Self::ProtectiveStop => "PROTECTIVE_STOP",
            Self::SafeguardStop => "SAFEGUARD_STOP",
            Self::EmergencyStop => "ROBOT_EMERGENCY_STOP",
            Self::Violation => "VIOLATION",
            Self::Fault => "FAULT",
        }
    }

    /// Whether the drives may move.
    pub(super) fn allows_motion(self) -> bool {
        matches!(self, Self::Normal | Self::Reduced)
    }
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
    pub(super) io: Io,
    pub(super) panel: Panel,
    pub(super) payload_inertia_kg_m2: [f64; 6],
    /// Line of the program that is executed.
    pub(super) script_line: u32,
    pub(super) safety: Safety,
    pub(super) powered: bool,
    /// Until when the controller boots.
    booting_until_tick: u64,
    /// Somebody holds the freedrive button.
    pub(super) teach_button: bool,
    /// The dashboard answers with errors only.
    pub(super) dashboard_refuses: bool,
    pub(super) runtime: Runtime,
    pub(super) watchdogs: Vec<Watchdog>,
    texts: Vec<TextMessage>,
    log: Vec<String>,
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
            digital_inputs: config.digital_inputs,
            digital_outputs: 0,
            io: Io::default(),
            panel: Panel::default(),
            payload_inertia_kg_m2: [0.0; 6],
            script_line: 0,
            safety: Safety::Normal,
            powered: true,
            booting_until_tick: 0,
            teach_button: false,
            dashboard_refuses: false,
            runtime: Runtime::Stopped,
            watchdogs: Vec::new(),
            texts: Vec::new(),
            log: Vec::new(),
        }
    }

    /// Simulated time, nanoseconds.
    pub(super) fn now_ns(&self) -> u64 {
        self.config.start_ns + self.tick * TICK_NS
    }

    /// Simulated time, s.
    pub(super) fn now_s(&self) -> f64 {
        self.now_ns() as f64 * 1e-9
    }

    /// Whether a program may run.
    pub(super) fn may_run(&self) -> bool {
        self.powered && self.panel.brakes_released && self.safety.allows_motion()
    }

    pub(super) fn speed_fraction(&self) -> f64 {
        self.config.speed_fraction.clamp(0.0, 1.0)
    }

    pub(super) fn say(&mut self, level: TextLevel, message: impl Into<String>) {
        if self.texts.len() < MAX_TEXTS {
            self.texts.push(TextMessage { message: message.into(), source: "simulator".into(), level });
        }
    }

    pub(super) fn take_texts(&mut self) -> Vec<TextMessage> {
        std::mem::take(&mut self.texts)
    }

    /// What a program says; it goes to the primary interface, not to RTDE.
    pub(super) fn log(&mut self, message: impl Into<String>) {
        if self.log.len() < MAX_TEXTS {
            self.log.push(message.into());
        }
    }

    pub(super) fn take_log(&mut self) -> Vec<String> {
        std::mem::take(&mut self.log)
    }

    /// Brakes what is left of a motion command that nobody waits for.
    pub(super) fn leave_motion(&mut self) {
        if !self.motion.is_stopping() {
            self.motion.stop(self.config.program_stop_rad_s2);
        }
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
        self.script_line = 0;
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
        self.say(TextLevel::Exception, format!("protective stop: {why}"));
        self.stop_for_safety(Safety::ProtectiveStop);
    }

    /// A stop that keeps the power: the arm brakes on its path and the program pauses.
    pub(super) fn stop_for_safety(&mut self, safety: Safety) {
        if safety == Safety::ProtectiveStop {
            self.panel.stopped_since_tick = self.tick;
        }
        self.safety = self.safety.max(safety);
        self.motion.pause(self.config.safety_stop_rad_s2);
        if self.runtime == Runtime::Playing {
            self.runtime = Runtime::Paused;
        }
    }

    /// Power off: the arm brakes and forgets its path. Ending the program is left to the caller.
    pub(super) fn cut_power(&mut self, safety: Safety) {
        self.safety = self.safety.max(safety);
        self.powered = false;
        if self.motion.is_busy() {
            self.motion.stop(self.config.safety_stop_rad_s2);
        }
    }

    /// What a restart of the controller leaves: the arm where it is, and nothing else. Booting ends without power.
    pub(super) fn restart(&mut self, boots: bool) {
        self.inputs = Inputs::new();
        (self.output_int, self.output_double) = ([0; REGISTERS], [0.0; REGISTERS]);
        (self.digital_outputs, self.io) = (0, Io::default());
        self.config.boot_time_s = -self.now_s();
        if boots {
            self.booting_until_tick = self.tick + Self::ticks_of(BOOT_S);
            self.cut_power(Safety::Normal);
        } else if self.motion.is_busy() {
            self.motion.stop(self.config.safety_stop_rad_s2);
        }
    }

    /// Whether the controller is still booting.
    pub(super) fn is_booting(&self) -> bool {
        self.tick < self.booting_until_tick
    }

    /// What an operator does after a stop; a paused program stays paused.
    pub(super) fn recover(&mut self) {
        (self.safety, self.powered, self.booting_until_tick) = (Safety::Normal, true, 0);
        self.panel.brakes_released = true;
    }

    /// Makes another TCP the active one: x, y, z (m) and axis-angle vector (rad) in the flange.
    pub(super) fn set_tcp_offset(&mut self, tcp_offset: [f64; 6]) {
        self.config.tcp_offset = tcp_offset;
        self.motion.set_tcp_offset(tcp_offset);
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
