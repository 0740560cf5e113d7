//! Orders from a test to the running simulation.

use std::sync::{
    Arc,
    atomic::{AtomicU64, Ordering},
    mpsc,
};
use std::time::Duration;

use tokio::sync::mpsc::UnboundedSender;

use super::faults::Fault;

/// What a test may order.
#[derive(Debug)]
pub(super) enum Order {
    Fault(Fault),
    Recover,
    Resume,
    Unmute,
    Inject(Vec<u8>),
    DigitalInput(u32, bool),
    SpeedFraction(f64),
    ShutDown,
}

/// An order, and whom to tell that it is done.
#[derive(Debug)]
pub(super) struct Ordered {
    pub(super) order: Order,
    pub(super) done: mpsc::Sender<()>,
}

/// Real time after which an order counts as done, in a controller that hangs.
const PATIENCE: Duration = Duration::from_secs(10);

/// Makes things happen to the simulated robot: every call returns when it has happened, before time goes on.
#[derive(Debug, Clone)]
pub struct SimHandle {
    orders: UnboundedSender<Ordered>,
    motions_begun: Arc<AtomicU64>,
}

impl SimHandle {
    pub(super) fn new(orders: UnboundedSender<Ordered>, motions_begun: Arc<AtomicU64>) -> Self {
        Self { orders, motions_begun }
    }

    fn order(&self, order: Order) {
        let (done, wait) = mpsc::channel();
        // A controller that is gone obeys nothing; its clients see that soon enough.
        if self.orders.send(Ordered { order, done }).is_ok() {
            let _ = wait.recv_timeout(PATIENCE);
        }
    }

    pub(super) fn shut_down(&self) {
        self.order(Order::ShutDown);
    }

    /// Makes this go wrong now; while a client drives, exactly here: time stands until it answers its last sample.
    pub fn inject_fault(&self, fault: Fault) {
        self.order(Order::Fault(fault));
    }

    /// Motions (`movej`, `movel`) that programs have begun so far; a move to where the arm already is is none.
    pub fn motions_begun(&self) -> u64 {
        self.motions_begun.load(Ordering::Acquire)
    }

    /// Protective stop: safety mode 3, the arm brakes, the program pauses.
    pub fn protective_stop(&self) {
        self.order(Order::Fault(Fault::ProtectiveStop));
    }

    /// Emergency stop: safety mode 7, the arm brakes, power off, the program ends.
    pub fn emergency_stop(&self) {
        self.order(Order::Fault(Fault::EmergencyStop));
    }

    /// Power off: robot mode 3, the program ends.
    pub fn power_off(&self) {
        self.order(Order::Fault(Fault::PowerOff));
    }

    /// Back to robot mode 7 and safety mode 1, as after the operator cleared a stop.
    pub fn recover(&self) {
        self.order(Order::Recover);
    }

    /// Pauses the program.
    pub fn pause(&self) {
        self.order(Order::Fault(Fault::Pause));
    }

    /// Lets a paused program go on.
    pub fn resume(&self) {
        self.order(Order::Resume);
    }

    /// Sets a digital input, bit 0 to 63.
    pub fn set_digital_input(&self, bit: u32, on: bool) {
        self.order(Order::DigitalInput(bit, on));
    }

    /// Moves the speed slider, 0 to 1.
    pub fn set_speed_fraction(&self, fraction: f64) {
        self.order(Order::SpeedFraction(fraction));
    }

    /// Sends no data any more, or again; connections stay open and time runs.
    pub fn mute(&self, mute: bool) {
        self.order(if mute { Order::Fault(Fault::Mute) } else { Order::Unmute });
    }

    /// Puts bytes into the stream to every RTDE client.
    pub fn inject(&self, bytes: Vec<u8>) {
        self.order(Order::Inject(bytes));
    }

    /// Closes every connection; new ones are accepted.
    pub fn drop_connections(&self) {
        self.order(Order::Fault(Fault::Drop));
    }
}
