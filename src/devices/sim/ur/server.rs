//! The one loop of the simulated controller: sockets, orders, program, drives, in a fixed order.
//!
//! Everything happens on one thread. What a client sent on one socket before it sent on another is
//! seen in that order, because all sockets are read before time advances.

use std::cell::RefCell;
use std::net::TcpListener as StdListener;
use std::rc::Rc;
use std::task::{Context, Poll};

use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc::UnboundedReceiver;
use tokio::time::{Duration, Instant};

use super::body::{Body, Runtime, Safety, TICK_NS};
use super::clock::SimClock;
use super::dashboard::DashboardClient;
use super::handle::Order;
use super::inputs::ClientId;
use super::link::Link;
use super::outputs::Snapshot;
use super::pacing::{Due, Pacer};
use super::primary;
use super::rtde_client::RtdeClient;
use super::script_client::ScriptClient;
use super::truth::Truth;
use super::urscript::{Program, Slice};
use crate::devices::rtde::TextLevel;

/// Cycles between two states of the primary interface: 10 Hz.
const STATE_TICKS: u64 = 50;

/// Cycles run without looking at the sockets, where nobody waits.
const BURST_TICKS: u64 = 50;

/// Clients of each kind.
const MAX_CLIENTS: usize = 32;

/// The interfaces, in the order of the listeners.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Interface {
    Rtde,
    Primary,
    Secondary,
    Realtime,
    Dashboard,
}

/// When the loop goes on although no socket has anything.
enum Wait {
    Briefly,
    Until(Instant),
    Forever,
}

pub(super) struct Server {
    body: Rc<RefCell<Body>>,
    clock: SimClock,
    truth: Truth,
    listeners: Vec<(Interface, TcpListener)>,
    orders: UnboundedReceiver<Order>,
    rtde: Vec<RtdeClient>,
    scripts: Vec<ScriptClient>,
    dashboards: Vec<DashboardClient>,
    program: Option<Program>,
    /// The arm must come to rest before a new program begins.
    settling: bool,
    pacer: Pacer,
    time_runs: bool,
    mute: bool,
    clients: ClientId,
}

/// What came in while waiting.
#[derive(Default)]
struct Arrived {
    streams: Vec<(Interface, TcpStream)>,
    orders: Vec<Order>,
    ended: bool,
}

impl Server {
    /// Must be called inside the runtime that will run it.
    pub(super) fn new(
        body: Body,
        clock: SimClock,
        truth: Truth,
        listeners: Vec<(Interface, StdListener)>,
        orders: UnboundedReceiver<Order>,
    ) -> std::io::Result<Self> {
        let listeners: std::io::Result<Vec<_>> =
            listeners.into_iter().map(|(i, l)| TcpListener::from_std(l).map(|l| (i, l))).collect();
        truth.push(0.0, body.motion.true_joints());
        Ok(Self {
            body: Rc::new(RefCell::new(body)),
            clock,
            truth,
            listeners: listeners?,
            orders,
            rtde: Vec::new(),
            scripts: Vec::new(),
            dashboards: Vec::new(),
            program: None,
            settling: false,
            pacer: Pacer::default(),
            time_runs: false,
            mute: false,
            clients: 0,
        })
    }

    /// Serves until the controller is dropped.
    pub(super) async fn run(mut self) {
        loop {
            let wait = self.advance();
            let arrived = self.wait(wait).await;
            if arrived.ended {
                return;
            }
            self.serve(arrived);
        }
    }

    async fn wait(&mut self, wait: Wait) -> Arrived {
        let mut arrived = Arrived::default();
        match wait {
            Wait::Briefly => {
                // Lets the runtime look at the sockets.
                tokio::task::yield_now().await;
                std::future::poll_fn(|cx| {
                    let _ = self.poll_ready(cx, &mut arrived);
                    Poll::Ready(())
                })
                .await;
            }
            Wait::Until(deadline) => {
                let ready = std::future::poll_fn(|cx| self.poll_ready(cx, &mut arrived));
                let _ = tokio::time::timeout_at(deadline, ready).await;
            }
            Wait::Forever => std::future::poll_fn(|cx| self.poll_ready(cx, &mut arrived)).await,
        }
        arrived
    }

    fn poll_ready(&mut self, cx: &mut Context<'_>, arrived: &mut Arrived) -> Poll<()> {
        let mut ready = false;
        for (interface, listener) in &self.listeners {
            while let Poll::Ready(accepted) = listener.poll_accept(cx) {
                ready = true;
                let Ok((stream, _)) = accepted else { break };
                arrived.streams.push((*interface, stream));
            }
        }
        while let Poll::Ready(order) = self.orders.poll_recv(cx) {
            ready = true;
            match order {
                None | Some(Order::ShutDown) => {
                    arrived.ended = true;
                    break;
                }
                Some(order) => arrived.orders.push(order),
            }
        }
        for link in self.links() {
            ready |= link.poll_ready(cx);
        }
        if ready { Poll::Ready(()) } else { Poll::Pending }
    }

    fn links(&self) -> impl Iterator<Item = &Link> {
        let scripts = self.scripts.iter().map(|c| &c.link);
        scripts.chain(self.dashboards.iter().map(|c| &c.link)).chain(self.rtde.iter().map(|c| &c.link))
    }

    /// Orders first, then scripts, then the dashboard, then RTDE, whose answers let time go on.
    fn serve(&mut self, arrived: Arrived) {
        for (interface, stream) in arrived.streams {
            self.welcome(interface, Link::new(stream));
        }
        for order in arrived.orders {
            self.obey(order);
        }
        let programs: Vec<String> = self.scripts.iter_mut().flat_map(ScriptClient::serve).collect();
        for text in programs {
            self.start_program(&text);
        }
        let body = self.body.clone();
        let stop = self.dashboards.iter_mut().fold(false, |stop, d| d.serve(&mut body.borrow_mut()) | stop);
        if stop {
            self.stop_program();
        }
        for client in &mut self.rtde {
            client.serve(&mut body.borrow_mut());
            self.time_runs |= client.is_started();
        }
        self.send_texts();
        self.forget_closed();
    }

    fn welcome(&mut self, interface: Interface, link: Link) {
        let greeting = || primary::greeting(&self.body.borrow(), &self.truth.individual().believed);
        match interface {
            Interface::Rtde if self.rtde.len() < MAX_CLIENTS => {
                self.clients += 1;
                self.rtde.push(RtdeClient::new(self.clients, link));
            }
            Interface::Primary | Interface::Secondary if self.scripts.len() < MAX_CLIENTS => {
                self.scripts.push(ScriptClient::new(link, Some(&greeting())));
            }
            Interface::Realtime if self.scripts.len() < MAX_CLIENTS => {
                self.scripts.push(ScriptClient::new(link, None));
            }
            Interface::Dashboard if self.dashboards.len() < MAX_CLIENTS => {
                self.dashboards.push(DashboardClient::new(link));
            }
            // Full: the connection is dropped.
            Interface::Rtde
            | Interface::Primary
            | Interface::Secondary
            | Interface::Realtime
            | Interface::Dashboard => {}
        }
    }

    fn forget_closed(&mut self) {
        self.scripts.retain(|c| c.link.is_open());
        self.dashboards.retain(|c| c.link.is_open());
        let mut body = self.body.borrow_mut();
        self.rtde.retain(|client| {
            if !client.link.is_open() {
                body.inputs.release(client.id);
            }
            client.link.is_open()
        });
    }

    fn send_texts(&mut self) {
        let texts = self.body.borrow_mut().take_texts();
        for text in &texts {
            self.rtde.iter_mut().for_each(|client| client.send_text(text));
        }
    }

    fn obey(&mut self, order: Order) {
        let body = self.body.clone();
        let mut body = body.borrow_mut();
        match order {
            Order::ProtectiveStop => body.protective_stop("ordered by the test"),
            Order::EmergencyStop => {
                (body.safety, body.powered) = (Safety::EmergencyStop, false);
                let deceleration = body.config.safety_stop_rad_s2;
                body.motion.stop(deceleration);
            }
            Order::PowerOff => body.powered = false,
            Order::Recover => (body.safety, body.powered) = (Safety::Normal, true),
            Order::Pause => body.pause_program(),
            Order::Resume => body.resume_program(),
            Order::DigitalInput(bit, true) => body.digital_inputs |= 1 << bit.min(63),
            Order::DigitalInput(bit, false) => body.digital_inputs &= !(1 << bit.min(63)),
            Order::SpeedFraction(fraction) => body.config.speed_fraction = fraction,
            Order::ShutDown => {}
            Order::Mute(mute) => self.mute = mute,
            Order::Inject(bytes) => self.rtde.iter_mut().for_each(|client| client.link.send(&bytes)),
            Order::DropConnections => {
                self.rtde.iter_mut().for_each(|c| c.link.close());
                self.scripts.iter_mut().for_each(|c| c.link.close());
                self.dashboards.iter_mut().for_each(|c| c.link.close());
            }
        }
        let stop = !body.powered;
        drop(body);
        if stop {
            self.stop_program();
        }
    }

    fn start_program(&mut self, text: &str) {
        let mut body = self.body.borrow_mut();
        if !body.config.remote_control || !body.may_run() {
            return body.say(TextLevel::Warning, "script ignored: not in remote control, or the robot may not move");
        }
        match Program::new(text, self.body.clone()) {
            Ok(program) => {
                body.program_ended();
                body.runtime = Runtime::Playing;
                (self.program, self.settling, self.time_runs) = (Some(program), true, true);
            }
            Err(why) => body.say(TextLevel::Exception, format!("compile error: {why}")),
        }
    }

    fn stop_program(&mut self) {
        self.program = None;
        self.body.borrow_mut().program_ended();
    }

    /// Runs the cycles that are due.
    fn advance(&mut self) -> Wait {
        if !self.time_runs {
            return Wait::Forever;
        }
        let now = Instant::now();
        if let Some(deadline) = self.lock_step_deadline(now) {
            return Wait::Until(deadline);
        }
        let (scale, tick) = (self.scale(), self.body.borrow().tick);
        match self.pacer.due(now, tick, scale, Duration::from_nanos(TICK_NS)) {
            Due::Unlimited => self.run_ticks(BURST_TICKS),
            Due::Ticks(count) => self.run_ticks(count),
            Due::At(instant) => return Wait::Until(instant),
        }
        Wait::Briefly
    }

    /// Until when the loop waits for a driving client; those that took too long are given up.
    fn lock_step_deadline(&mut self, now: Instant) -> Option<Instant> {
        let patience = self.body.borrow().config.lock_step_patience;
        for client in &mut self.rtde {
            let late = client.awaiting_since().is_some_and(|since| now.saturating_duration_since(since) >= patience);
            if late {
                client.lose_patience();
            }
        }
        self.rtde.iter().filter_map(RtdeClient::awaiting_since).min().map(|since| since + patience)
    }

    /// Simulated seconds per real second: as configured while a client drives, else 1.
    fn scale(&self) -> f64 {
        let driven = self.rtde.iter().any(RtdeClient::drives);
        if driven { self.body.borrow().config.time_scale } else { 1.0 }
    }

    /// Runs cycles, and stops where a driving client must answer first.
    fn run_ticks(&mut self, count: u64) {
        for _ in 0..count {
            self.tick();
            if self.rtde.iter().any(|c| c.awaiting_since().is_some()) {
                break;
            }
        }
    }

    fn tick(&mut self) {
        self.run_program();
        let late = self.body.borrow_mut().watchdogs_stop();
        if late {
            self.stop_program();
        }
        self.body.borrow_mut().tick_drives();
        self.send_texts();
        self.report();
    }

    /// Sets clock and truth, and sends what is due in this cycle.
    fn report(&mut self) {
        let body = self.body.borrow();
        self.truth.push(body.now_s(), body.motion.true_joints());
        self.clock.set_ns(body.now_ns());
        let body = &*body;
        if !self.mute && self.rtde.iter().any(|c| c.is_due(body.tick)) {
            let snapshot = Snapshot::take(body);
            for client in self.rtde.iter_mut().filter(|c| c.is_due(body.tick)) {
                client.send_outputs(body, &snapshot);
            }
        }
        if !self.mute && body.tick.is_multiple_of(STATE_TICKS) && !self.scripts.is_empty() {
            let state = primary::state(body, &self.truth.individual().believed);
            self.scripts.iter_mut().for_each(|client| client.send_state(&state));
        }
    }

    fn run_program(&mut self) {
        let Some(program) = &mut self.program else { return };
        self.settling &= self.body.borrow().motion.is_busy();
        let runs = self.body.borrow().runtime == Runtime::Playing && !self.settling;
        if !runs {
            return;
        }
        match program.resume() {
            Slice::Running => return,
            Slice::Ended => {}
            Slice::Failed(why) => {
                self.body.borrow_mut().say(TextLevel::Exception, format!("runtime exception: {why}"));
            }
        }
        self.stop_program();
    }
}
