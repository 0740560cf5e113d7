//! The one loop of the simulated controller: sockets, orders, program, drives, in a fixed order.
//!
//! Everything happens on one thread. What a client sent on one socket before it sent on another is
//! seen in that order, because all sockets are read before time advances.

mod injection;

use std::cell::RefCell;
use std::net::TcpListener as StdListener;
use std::rc::Rc;
use std::sync::{
    Arc,
    atomic::{AtomicU64, Ordering},
};
use std::task::{Context, Poll};

use tokio::net::{TcpListener, TcpStream};
use tokio::sync::mpsc::UnboundedReceiver;
use tokio::time::{Duration, Instant};

use super::body::{Body, Runtime, TICK_NS};
use super::clock::SimClock;
use super::config::SimUrConfig;
use super::dashboard::{DashboardClient, Wish};
use super::handle::{Order, Ordered};
use super::inputs::ClientId;
use super::link::Link;
use super::network::Network;
use super::outputs::Snapshot;
use super::pacing::{Due, Pacer};
use super::primary;
use super::realtime;
use super::rtde_client::RtdeClient;
use super::script_client::{ScriptClient, Stream};
use super::truth::Truth;
use super::urscript::{Program, Slice};
use crate::devices::rtde::TextLevel;
use injection::Schedule;

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
    orders: UnboundedReceiver<Ordered>,
    rtde: Vec<RtdeClient>,
    scripts: Vec<ScriptClient>,
    dashboards: Vec<DashboardClient>,
    program: Option<Program>,
    /// The arm must come to rest before a new program begins.
    settling: bool,
    pacer: Pacer,
    time_runs: bool,
    /// What was configured, for healing.
    healthy: SimUrConfig,
    network: Network,
    schedule: Schedule,
    /// A program that somebody else started.
    foreign: bool,
    /// Something happened that the clients must see before time rushes on.
    disturbed: bool,
    /// RTDE connections so far.
    clients: ClientId,
    motions_begun: Arc<AtomicU64>,
}

/// What the server shares with whoever started it.
pub(super) struct Shared {
    pub(super) clock: SimClock,
    pub(super) truth: Truth,
    pub(super) orders: UnboundedReceiver<Ordered>,
    pub(super) motions_begun: Arc<AtomicU64>,
}

/// What came in while waiting.
#[derive(Default)]
struct Arrived {
    streams: Vec<(Interface, TcpStream)>,
    orders: Vec<Ordered>,
    ended: bool,
}

impl Server {
    /// Must be called inside the runtime that will run it.
    pub(super) fn new(body: Body, shared: Shared, listeners: Vec<(Interface, StdListener)>) -> std::io::Result<Self> {
        let Shared { clock, truth, orders, motions_begun } = shared;
        let (healthy, network) = (body.config.clone(), Network::new(body.seed));
        let listeners: std::io::Result<Vec<_>> =
            listeners.into_iter().map(|(i, l)| TcpListener::from_std(l).map(|l| (i, l))).collect();
        truth.push(body.now_s(), body.motion.true_joints(), body.digital_outputs);
        clock.set_ns(body.now_ns());
        let mut server = Self {
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
            time_runs: healthy.lock_step_patience.is_zero(),
            schedule: Schedule::new(&healthy.faults),
            healthy,
            network,
            foreign: false,
            disturbed: false,
            clients: 0,
            motions_begun,
        };
        server.apply_due();
        Ok(server)
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
                None | Some(Ordered { order: Order::ShutDown, .. }) => {
                    arrived.ended = true;
                    break;
                }
                Some(ordered) => arrived.orders.push(ordered),
            }
        }
        for link in self.links() {
            ready |= link.poll_ready(cx);
        }
        if ready { Poll::Ready(()) } else { Poll::Pending }
    }

    fn links(&self) -> impl Iterator<Item = &Link> {
        let scripts = self.scripts.iter().map(|c| &c.link);
        scripts.chain(self.dashboards.iter().map(|c| &c.link)).chain(self.rtde.iter().map(|c| &c.wire.link))
    }

    /// New clients first, then orders, then scripts, then the dashboard, then RTDE, whose answers let time go on.
    fn serve(&mut self, arrived: Arrived) {
        for (interface, stream) in arrived.streams {
            self.welcome(interface, stream);
        }
        for Ordered { order, done } in arrived.orders {
            self.obey(order);
            // Whoever ordered it may have given up waiting.
            let _ = done.send(());
        }
        let programs: Vec<String> = self.scripts.iter_mut().flat_map(ScriptClient::serve).collect();
        for text in programs {
            self.start_program(&text);
        }
        let body = self.body.clone();
        let wishes: Vec<Wish> = self.dashboards.iter_mut().flat_map(|d| d.serve(&mut body.borrow_mut())).collect();
        for wish in wishes {
            match wish {
                Wish::Stop => self.stop_program(),
                Wish::Play(text) => self.start_program(text),
            }
        }
        for client in &mut self.rtde {
            client.serve(&mut body.borrow_mut(), &self.network);
            self.time_runs |= client.is_started();
        }
        self.send_texts();
        self.forget_closed();
    }

    fn welcome(&mut self, interface: Interface, stream: TcpStream) {
        if self.network.refuses {
            return;
        }
        let mut link = Link::new(stream);
        link.stall(self.network.is_stalled);
        let greeting = || primary::greeting(&self.body.borrow(), &self.truth.individual().believed);
        match interface {
            Interface::Rtde if self.rtde.len() < MAX_CLIENTS => {
                self.clients += 1;
                self.rtde.push(RtdeClient::new(self.clients, link));
                self.apply_due();
            }
            Interface::Primary if self.scripts.len() < MAX_CLIENTS => {
                self.scripts.push(ScriptClient::new(link, Stream::Primary, &greeting()));
            }
            Interface::Secondary if self.scripts.len() < MAX_CLIENTS => {
                self.scripts.push(ScriptClient::new(link, Stream::Secondary, &greeting()));
            }
            Interface::Realtime if self.scripts.len() < MAX_CLIENTS => {
                self.scripts.push(ScriptClient::new(link, Stream::Realtime, &[]));
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
            if !client.is_open() {
                body.inputs.release(client.id);
            }
            client.is_open()
        });
    }

    /// Texts of the controller go to RTDE clients that are not in their handshake; to the primary
    /// interface goes what the program says too.
    fn send_texts(&mut self) {
        let (texts, log) = {
            let mut body = self.body.borrow_mut();
            (body.take_texts(), body.take_log())
        };
        for text in &texts {
            let started = self.rtde.iter_mut().filter(|client| client.is_started());
            started.for_each(|client| client.send_text(text, &self.network));
        }
        let now_s = self.body.borrow().now_s();
        for text in log.iter().chain(texts.iter().map(|t| &t.message)) {
            let message = primary::text_message(now_s, text);
            self.scripts.iter_mut().for_each(|client| client.send(Stream::Primary, &message));
        }
    }

    fn start_program(&mut self, text: &str) {
        let mut body = self.body.borrow_mut();
        if !body.config.remote_control || !body.may_run() {
            return body.say(TextLevel::Warning, "script ignored: not in remote control, or the robot may not move");
        }
        match Program::new(text, self.body.clone()) {
            Ok(mut program) if program.is_secondary() => {
                drop(body);
                if let Err(why) = program.run_at_once() {
                    let mut body = self.body.borrow_mut();
                    body.say(TextLevel::Exception, format!("runtime exception: {why}"));
                }
            }
            Ok(program) => {
                body.program_ended();
                body.runtime = Runtime::Playing;
                (self.program, self.settling, self.time_runs, self.foreign) = (Some(program), true, true, false);
            }
            Err(why) => body.say(TextLevel::Exception, format!("compile error: {why}")),
        }
    }

    fn stop_program(&mut self) {
        (self.program, self.foreign) = (None, false);
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
        self.rtde.iter_mut().for_each(|client| client.expire(now, patience));
        self.rtde.iter().filter_map(|client| client.awaited_until(patience)).min()
    }

    /// Simulated seconds per real second: as configured while a client drives and is reached, else 1.
    fn scale(&self) -> f64 {
        let driven = self.rtde.iter().any(RtdeClient::drives) && !self.network.is_silent();
        if driven { self.body.borrow().config.time_scale } else { 1.0 }
    }

    /// Runs cycles, and stops where a driving client must answer first.
    fn run_ticks(&mut self, count: u64) {
        for _ in 0..count {
            self.tick();
            if std::mem::take(&mut self.disturbed) || self.rtde.iter().any(RtdeClient::is_awaited) {
                break;
            }
        }
    }

    fn tick(&mut self) {
        self.network.tick = Some(self.body.borrow().tick);
        self.apply_due();
        self.run_program();
        let late = self.body.borrow_mut().watchdogs_stop();
        if late {
            self.stop_program();
        }
        self.body.borrow_mut().tick_drives();
        self.network.tick = Some(self.body.borrow().tick);
        self.motions_begun.store(self.body.borrow().motion.begun(), Ordering::Release);
        self.send_texts();
        self.report();
    }

    /// Sets clock and truth, and sends what is due in this cycle.
    fn report(&mut self) {
        let body = self.body.borrow();
        self.truth.push(body.now_s(), body.motion.true_joints(), body.digital_outputs);
        self.clock.set_ns(body.now_ns());
        let body = &*body;
        if !self.network.is_mute && self.rtde.iter().any(|c| c.is_due(body.tick)) {
            let snapshot = Snapshot::take(body);
            for client in self.rtde.iter_mut().filter(|c| c.is_due(body.tick)) {
                client.send_outputs(body, &snapshot, &self.network);
            }
        }
        self.rtde.iter_mut().for_each(|client| client.deliver(&self.network));
        if !self.network.is_mute && body.tick.is_multiple_of(STATE_TICKS) && !self.scripts.is_empty() {
            let state = primary::state(body, &self.truth.individual().believed);
            for client in &mut self.scripts {
                client.send(Stream::Primary, &state);
                client.send(Stream::Secondary, &state);
            }
        }
        if !self.network.is_mute && self.scripts.iter().any(|client| client.gets(Stream::Realtime)) {
            let package = realtime::package(body, &Snapshot::take(body));
            self.scripts.iter_mut().for_each(|client| client.send(Stream::Realtime, &package));
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
