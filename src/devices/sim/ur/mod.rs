//! A simulated UR5e controller that speaks the real protocols on real sockets.
//!
//! RTDE, the script sockets and the dashboard, a URScript interpreter, an arm with flaws, and the true
//! pose for simulated cameras. Uses `devices::rtde` and `geometry`; never the driver.
//!
//! Time: cycles of 2 ms of simulated time. It stands until somebody watches (the first RTDE start or
//! script). While a client with inputs is started, the two keep step: after a data package, time
//! stands until that client has sent an input package, so that a slow client slows simulated time and
//! a session is the same every time. Where no client drives, or the driver is silent for
//! `lock_step_patience`, time runs at real pace: watchdogs and dead clients behave as in reality. Without
//! lock-step (a patience of zero) time runs from the start; clients that know nothing of it, such as
//! `ur_rtde`, need that. What they upload is executed, not imitated: see `urscript`.
//!
//! Faults: [`SimUrConfig::faults`] and [`SimHandle::inject_fault`] make the robot stop and the network bad, at
//! exact moments of simulated time. While nothing reaches the clients, time runs at real pace.
//!
//! Start at [`SimController::start`].

mod body;
mod clock;
mod config;
mod dashboard;
mod faults;
mod handle;
mod inputs;
mod io;
mod link;
mod motion;
mod network;
mod noise;
mod outputs;
mod pacing;
mod panel;
mod primary;
mod realtime;
mod rtde_client;
mod script_client;
mod server;
#[cfg(test)]
mod tests;
mod truth;
mod urscript;

use std::net::{IpAddr, SocketAddr, TcpListener};
use std::sync::{Arc, atomic::AtomicU64};
use std::thread::JoinHandle;

use tokio::sync::mpsc;

pub use clock::SimClock;
pub use config::{Flaws, Individual, Ports, SimUrConfig};
pub use faults::{Fault, FaultError, Planned, When};
pub use handle::SimHandle;
pub use truth::Truth;

use body::Body;
use server::{Interface, Server, Shared};

/// Stack of the controller thread: the interpreter of scripts is recursive.
const STACK_BYTES: usize = 16 << 20;

/// Why the simulated controller does not start.
#[derive(Debug, thiserror::Error)]
pub enum SimUrError {
    /// A port cannot be had.
    #[error("cannot listen on {address}: {why}; is another controller running? port 0 chooses a free one")]
    Listen {
        /// Where.
        address: SocketAddr,
        /// The reason of the system.
        why: std::io::Error,
    },
    /// The system gives no thread or no event loop.
    #[error("cannot start the controller thread: {0}")]
    Thread(std::io::Error),
}

/// A running simulated controller; it ends when this is dropped.
#[derive(Debug)]
pub struct SimController {
    address: IpAddr,
    ports: Ports,
    clock: SimClock,
    truth: Truth,
    handle: SimHandle,
    thread: Option<JoinHandle<()>>,
}

impl SimController {
    /// Starts a controller; the same configuration and seed give the same arm and the same noise.
    pub fn start(config: SimUrConfig, seed: u64) -> Result<Self, SimUrError> {
        let individual = Individual::draw(&config, seed);
        let (listeners, ports) = listen(&config)?;
        let (address, clock, truth) = (config.address, SimClock::default(), Truth::new(individual.clone(), &config));
        let (sender, orders) = mpsc::unbounded_channel();
        let motions_begun = Arc::<AtomicU64>::default();
        let handle = SimHandle::new(sender, motions_begun.clone());
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(SimUrError::Thread)?;
        let shared = Shared { clock: clock.clone(), truth: truth.clone(), orders, motions_begun };
        let serve = move || {
            let body = Body::new(&config, &individual, seed);
            runtime.block_on(async {
                // Fails only where the runtime takes no sockets; clients then find nobody.
                if let Ok(server) = Server::new(body, shared, listeners) {
                    server.run().await;
                }
            });
        };
        let thread = std::thread::Builder::new().name("sim-ur".into()).stack_size(STACK_BYTES);
        let thread = thread.spawn(serve).map_err(SimUrError::Thread)?;
        Ok(Self { address, ports, clock, truth, handle, thread: Some(thread) })
    }

    /// Where it listens.
    pub fn address(&self) -> IpAddr {
        self.address
    }

    /// The ports it listens on; none is 0.
    pub fn ports(&self) -> Ports {
        self.ports
    }

    /// Its time as a session clock.
    pub fn clock(&self) -> SimClock {
        self.clock.clone()
    }

    /// Where the arm truly is, for the simulated cameras.
    pub fn truth(&self) -> Truth {
        self.truth.clone()
    }

    /// Motions that programs have begun so far, as [`SimHandle::motions_begun`].
    pub fn motions_begun(&self) -> u64 {
        self.handle.motions_begun()
    }

    /// For making things go wrong.
    pub fn handle(&self) -> SimHandle {
        self.handle.clone()
    }
}

impl Drop for SimController {
    fn drop(&mut self) {
        self.handle.shut_down();
        if let Some(thread) = self.thread.take() {
            // A panic of the simulation has been printed by its thread.
            let _ = thread.join();
        }
    }
}

type Listeners = Vec<(Interface, TcpListener)>;

fn listen(config: &SimUrConfig) -> Result<(Listeners, Ports), SimUrError> {
    let mut listeners = Vec::new();
    let mut bind = |interface, port| {
        let address = SocketAddr::new(config.address, port);
        let fail = |why| SimUrError::Listen { address, why };
        let listener = TcpListener::bind(address).map_err(fail)?;
        listener.set_nonblocking(true).map_err(fail)?;
        let port = listener.local_addr().map_err(fail)?.port();
        listeners.push((interface, listener));
        Ok(port)
    };
    let wanted = config.ports;
    let ports = Ports {
        rtde: bind(Interface::Rtde, wanted.rtde)?,
        primary: bind(Interface::Primary, wanted.primary)?,
        secondary: bind(Interface::Secondary, wanted.secondary)?,
        realtime: bind(Interface::Realtime, wanted.realtime)?,
        dashboard: bind(Interface::Dashboard, wanted.dashboard)?,
    };
    Ok((listeners, ports))
}
