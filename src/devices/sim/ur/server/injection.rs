//! Does to the controller what the words of `faults` say, when they say it.

use bytes::Bytes;
use rand::RngCore as _;

use super::Server;
use crate::devices::rtde::{Package, TextLevel};
use crate::devices::sim::ur::body::{Runtime, Safety};
use crate::devices::sim::ur::faults::{Fault, Planned, When};
use crate::devices::sim::ur::handle::Order;
use crate::devices::sim::ur::motion::TICK_S;
use crate::devices::sim::ur::network::Kind;
use crate::devices::sim::ur::noise::{self, Stream};
use crate::devices::sim::ur::urscript::Program;
use crate::geometry::{Flange, Tcp, Transform};

/// Bytes of garbage.
const GARBAGE_BYTES: usize = 100;

/// A package kind that RTDE does not have.
const UNKNOWN_KIND: u8 = b'Z';

/// What somebody else runs: it does nothing and never ends.
const FOREIGN_PROGRAM: &str = "def foreign():\n  while (True):\n    sync()\n  end\nend\n";

/// Faults that are still to come.
#[derive(Debug)]
pub(super) struct Schedule {
    waiting: Vec<Waiting>,
}

#[derive(Debug)]
struct Waiting {
    planned: Planned,
    /// When that came true which it waits for.
    since_tick: Option<u64>,
}

/// What a schedule looks at.
struct View {
    tick: u64,
    connected: bool,
    motions_begun: u64,
    moving: bool,
}

impl Schedule {
    pub(super) fn new(planned: &[Planned]) -> Self {
        let waiting = |planned: &Planned| Waiting { planned: planned.clone(), since_tick: None };
        Self { waiting: planned.iter().map(waiting).collect() }
    }

    /// Takes out what is due, in the order of the configuration.
    fn due(&mut self, view: &View) -> Vec<Fault> {
        let due = self.waiting.extract_if(.., |waiting| waiting.is_due(view));
        due.map(|waiting| waiting.planned.fault).collect()
    }
}

impl Waiting {
    fn is_due(&mut self, view: &View) -> bool {
        let ticks = |seconds: f64| (seconds / TICK_S).round() as u64;
        let (reached, after_ticks) = match self.planned.when {
            When::Connect { after_s } => {
                let lasting = after_s <= 0.0 && !self.planned.fault.needs_connection();
                (lasting || view.connected, ticks(after_s))
            }
            When::Time { at_s } => (view.tick >= ticks(at_s), 0),
            When::Move { number, after_s } => (view.motions_begun >= number, ticks(after_s)),
            When::Still { number, after_s } => {
                let ended = view.motions_begun > number || (view.motions_begun == number && !view.moving);
                (ended, ticks(after_s))
            }
        };
        if reached && self.since_tick.is_none() {
            self.since_tick = Some(view.tick);
        }
        self.since_tick.is_some_and(|since| view.tick >= since + after_ticks)
    }
}

impl Server {
    pub(super) fn obey(&mut self, order: Order) {
        match order {
            Order::Fault(fault) => self.apply(&fault),
            Order::Recover => self.body.borrow_mut().recover(),
            Order::Resume => self.body.borrow_mut().resume_program(),
            Order::Unmute => self.network.is_mute = false,
            Order::Inject(bytes) => self.put_into_streams(&bytes),
            Order::SpeedFraction(fraction) => self.body.borrow_mut().config.speed_fraction = fraction,
            Order::DigitalInput(bit, on) => self.set_digital_input(bit, on),
            Order::ShutDown => {}
        }
    }

    /// Applies the faults that are due in this cycle.
    pub(super) fn apply_due(&mut self) {
        let view = {
            let body = self.body.borrow();
            let (motions_begun, moving) = (body.motion.begun(), body.motion.is_busy());
            View { tick: body.tick, connected: self.clients > 0, motions_begun, moving }
        };
        for fault in self.schedule.due(&view) {
            self.apply(&fault);
        }
    }

    fn apply(&mut self, fault: &Fault) {
        self.disturbed = true;
        match fault {
            Fault::Drop => self.close_all(),
            Fault::Reset => self.reset_all(),
            Fault::Garbage => self.put_into_streams(&self.garbage()),
            Fault::Size { bytes } => self.put_into_streams(&[&bytes.to_be_bytes()[..], b"U"].concat()),
            Fault::Unknown => self.put_unknown_package(),
            Fault::Text => self.rtde.iter_mut().for_each(|c| c.text(TextLevel::Warning, "by order", &self.network)),
            Fault::Restart => self.restart(false),
            Fault::Boot => self.restart(true),
            Fault::ProtectiveStop => self.body.borrow_mut().protective_stop("by order"),
            Fault::SafeguardStop => self.body.borrow_mut().stop_for_safety(Safety::SafeguardStop),
            Fault::Reduced => self.reduce(),
            Fault::EmergencyStop => self.cut_power(Safety::EmergencyStop),
            Fault::Violation => self.cut_power(Safety::Violation),
            Fault::Fault => self.cut_power(Safety::Fault),
            Fault::PowerOff => self.cut_power(Safety::Normal),
            Fault::Pause => self.body.borrow_mut().pause_program(),
            Fault::StopProgram => self.stop_program(),
            Fault::ForeignProgram => self.run_foreign_program(),
            Fault::DigitalInput { bit, on } => self.set_digital_input(*bit, *on),
            Fault::ClockBack { by_s } => self.body.borrow_mut().config.boot_time_s -= by_s,
            Fault::Slider { fraction } => self.body.borrow_mut().config.speed_fraction = *fraction,
            Fault::TeachButton => self.body.borrow_mut().teach_button = true,
            Fault::LocalControl => self.body.borrow_mut().config.remote_control = false,
            Fault::DashboardRefuse => self.body.borrow_mut().dashboard_refuses = true,
            Fault::Payload { kg } => self.body.borrow_mut().config.payload_kg = *kg,
            Fault::TcpOffset { dz_mm } => self.shift_tcp(*dz_mm * 1e-3),
            Fault::Heal => self.heal(),
            Fault::Refuse
            | Fault::Stall
            | Fault::Mute
            | Fault::Fragment { .. }
            | Fault::Coalesce { .. }
            | Fault::Jitter { .. }
            | Fault::Late { .. }
            | Fault::WrongProtocol
            | Fault::NoStart
            | Fault::MissingField { .. }
            | Fault::InUse { .. }
            | Fault::WrongType { .. }
            | Fault::Nan { .. } => self.spoil_network(fault),
        }
    }

    fn spoil_network(&mut self, fault: &Fault) {
        self.network.suffer(fault);
        self.stall_links();
        if self.network.is_silent() {
            self.rtde.iter_mut().for_each(super::RtdeClient::forgive);
        }
    }

    /// Makes the links as they are to be.
    fn stall_links(&mut self) {
        let stalled = self.network.is_stalled;
        self.rtde.iter_mut().for_each(|c| c.wire.link.stall(stalled));
        self.scripts.iter_mut().for_each(|c| c.link.stall(stalled));
        self.dashboards.iter_mut().for_each(|c| c.link.stall(stalled));
    }

    fn close_all(&mut self) {
        self.rtde.iter_mut().for_each(|c| c.wire.link.close_in_order());
        self.scripts.iter_mut().for_each(|c| c.link.close_in_order());
        self.dashboards.iter_mut().for_each(|c| c.link.close_in_order());
        self.forget_closed();
    }

    fn reset_all(&mut self) {
        self.rtde.iter_mut().for_each(|c| c.wire.link.reset());
        self.scripts.iter_mut().for_each(|c| c.link.reset());
        self.dashboards.iter_mut().for_each(|c| c.link.reset());
        self.forget_closed();
    }

    fn put_into_streams(&mut self, bytes: &[u8]) {
        self.rtde.iter_mut().for_each(|client| client.wire.send(bytes, Kind::Aside, &self.network));
    }

    fn put_unknown_package(&mut self) {
        let package = Package { kind: UNKNOWN_KIND, payload: Bytes::from_static(b"cellcal") };
        if let Ok(bytes) = package.to_bytes() {
            self.put_into_streams(&bytes);
        }
    }

    fn garbage(&self) -> [u8; GARBAGE_BYTES] {
        let body = self.body.borrow();
        let mut bytes = [0; GARBAGE_BYTES];
        noise::generator(body.seed, Stream::Network, body.tick).fill_bytes(&mut bytes);
        bytes
    }

    fn restart(&mut self, boots: bool) {
        self.close_all();
        self.stop_program();
        self.body.borrow_mut().restart(boots);
    }

    fn cut_power(&mut self, safety: Safety) {
        self.stop_program();
        self.body.borrow_mut().cut_power(safety);
    }

    fn reduce(&mut self) {
        let mut body = self.body.borrow_mut();
        body.safety = body.safety.max(Safety::Reduced);
    }

    fn set_digital_input(&mut self, bit: u32, on: bool) {
        let mut body = self.body.borrow_mut();
        let mask = 1 << bit.min(63);
        body.digital_inputs = if on { body.digital_inputs | mask } else { body.digital_inputs & !mask };
    }

    fn shift_tcp(&mut self, dz_m: f64) {
        let mut body = self.body.borrow_mut();
        let along_z = Transform::<Tcp, Tcp>::from_pose_vector([0.0, 0.0, dz_m, 0.0, 0.0, 0.0]);
        let shifted = Transform::<Flange, Tcp>::from_pose_vector(body.config.tcp_offset) * along_z;
        body.set_tcp_offset(shifted.pose_vector());
    }

    fn run_foreign_program(&mut self) {
        let program = Program::new(FOREIGN_PROGRAM, self.body.clone());
        self.stop_program();
        let mut body = self.body.borrow_mut();
        if let (Ok(program), true) = (program, body.may_run()) {
            body.runtime = Runtime::Playing;
            (self.program, self.settling, self.foreign) = (Some(program), true, true);
        }
    }

    fn heal(&mut self) {
        self.network.heal();
        self.stall_links();
        if self.foreign {
            self.stop_program();
        }
        let mut body = self.body.borrow_mut();
        body.recover();
        (body.teach_button, body.dashboard_refuses, body.digital_inputs) = (false, false, 0);
        let healthy = &self.healthy;
        body.config.remote_control = healthy.remote_control;
        body.config.speed_fraction = healthy.speed_fraction;
        body.config.payload_kg = healthy.payload_kg;
        body.set_tcp_offset(healthy.tcp_offset);
    }
}
