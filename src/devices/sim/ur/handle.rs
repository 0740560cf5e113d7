//! Orders from a test to the running simulation.

use tokio::sync::mpsc::UnboundedSender;

/// What a test may order.
#[derive(Debug)]
pub(super) enum Order {
    ProtectiveStop,
    EmergencyStop,
    PowerOff,
    Recover,
    Pause,
    Resume,
    DigitalInput(u32, bool),
    SpeedFraction(f64),
    Mute(bool),
    Inject(Vec<u8>),
    DropConnections,
    ShutDown,
}

/// Makes things happen to the simulated robot; takes effect before time goes on.
#[derive(Debug, Clone)]
pub struct SimHandle {
    orders: UnboundedSender<Order>,
}

impl SimHandle {
    pub(super) fn new(orders: UnboundedSender<Order>) -> Self {
        Self { orders }
    }

    fn order(&self, order: Order) {
        // A controller that is gone obeys nothing; its clients see that soon enough.
        let _ = self.orders.send(order);
    }

    pub(super) fn shut_down(&self) {
        self.order(Order::ShutDown);
    }

    /// Protective stop: safety mode 3, the arm brakes, the program pauses.
    pub fn protective_stop(&self) {
        self.order(Order::ProtectiveStop);
    }

    /// Emergency stop: safety mode 7, the arm brakes, power off, the program ends.
    pub fn emergency_stop(&self) {
        self.order(Order::EmergencyStop);
    }

    /// Power off: robot mode 3, the program ends.
    pub fn power_off(&self) {
        self.order(Order::PowerOff);
    }

    /// Back to robot mode 7 and safety mode 1, as after the operator cleared a stop.
    pub fn recover(&self) {
        self.order(Order::Recover);
    }

    /// Pauses the program.
    pub fn pause(&self) {
        self.order(Order::Pause);
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
        self.order(Order::Mute(mute));
    }

    /// Puts bytes into the stream to every RTDE client.
    pub fn inject(&self, bytes: Vec<u8>) {
        self.order(Order::Inject(bytes));
    }

    /// Closes every connection; new ones are accepted.
    pub fn drop_connections(&self) {
        self.order(Order::DropConnections);
    }
}
