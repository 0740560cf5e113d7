//! What is wrong with the network at the moment, and the delays and pieces that it makes of packages.

use std::collections::VecDeque;

use bytes::{Bytes, BytesMut};

use super::faults::Fault;
use super::inputs::ClientId;
use super::link::Link;
use super::motion::TICK_S;
use super::noise::{self, Stream};

/// Cycles over which the pieces of one package are spread: 18 ms are not reached.
const SPREAD_TICKS: usize = 9;

/// Bytes that may be on their way to one client; it is disconnected above that.
const MAX_DELAYED_BYTES: usize = 1 << 23;

/// What is wrong with the network.
#[derive(Debug, Clone, Default)]
pub(super) struct Network {
    /// The cycle of now; `None` while time stands because nobody has started anything.
    pub(super) tick: Option<u64>,
    seed: u64,
    pub(super) refuses: bool,
    pub(super) is_stalled: bool,
    pub(super) is_mute: bool,
    pub(super) refuses_protocol: bool,
    pub(super) refuses_start: bool,
    fragment_bytes: Option<usize>,
    coalesce_packages: Option<usize>,
    late_ticks: u64,
    jitter_ms: f64,
    missing: Vec<String>,
    in_use: Vec<String>,
    wrong_type: Vec<String>,
    not_a_number: Vec<String>,
}

impl Network {
    pub(super) fn new(seed: u64) -> Self {
        Self { seed, ..Self::default() }
    }

    pub(super) fn heal(&mut self) {
        *self = Self { tick: self.tick, ..Self::new(self.seed) };
    }

    /// Whether data packages do not reach the clients at all.
    pub(super) fn is_silent(&self) -> bool {
        self.is_stalled || self.is_mute
    }

    /// Takes up a lasting fault of the network; false where it is of another sort.
    pub(super) fn suffer(&mut self, fault: &Fault) -> bool {
        match fault {
            Fault::Refuse => self.refuses = true,
            Fault::Stall => self.is_stalled = true,
            Fault::Mute => self.is_mute = true,
            Fault::WrongProtocol => self.refuses_protocol = true,
            Fault::NoStart => self.refuses_start = true,
            Fault::Fragment { bytes } => self.fragment_bytes = Some(*bytes),
            Fault::Coalesce { packages } => self.coalesce_packages = Some(*packages),
            Fault::Late { by_ms } => self.late_ticks = (by_ms * 1e-3 / TICK_S).round() as u64,
            Fault::Jitter { up_to_ms } => self.jitter_ms = *up_to_ms,
            Fault::MissingField { name } => self.missing.push(name.clone()),
            Fault::InUse { name } => self.in_use.push(name.clone()),
            Fault::WrongType { name } => self.wrong_type.push(name.clone()),
            Fault::Nan { name } => self.not_a_number.push(name.clone()),
            _ => return false,
        }
        true
    }

    pub(super) fn is_missing(&self, name: &str) -> bool {
        self.missing.iter().any(|n| n == name)
    }

    pub(super) fn is_in_use(&self, name: &str) -> bool {
        self.in_use.iter().any(|n| n == name)
    }

    pub(super) fn has_wrong_type(&self, name: &str) -> bool {
        self.wrong_type.iter().any(|n| n == name)
    }

    pub(super) fn is_not_a_number(&self, name: &str) -> bool {
        self.not_a_number.iter().any(|n| n == name)
    }

    fn delay_ticks(&self, client: ClientId, package: u64) -> u64 {
        if self.jitter_ms <= 0.0 {
            return self.late_ticks;
        }
        let mut rng = noise::generator(self.seed, Stream::Network, client << 40 | package);
        self.late_ticks + (noise::between(&mut rng, [0.0, self.jitter_ms]) * 1e-3 / TICK_S) as u64
    }
}

/// What a package is for the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Output values.
    Data,
    /// A client waits for it.
    Answer,
    /// Whatever else is said.
    Aside,
}

#[derive(Debug)]
struct Piece {
    due_tick: u64,
    bytes: Bytes,
    /// Data packages that are complete with this piece.
    completes: usize,
    kind: Kind,
}

/// The way to one RTDE client, through the network.
#[derive(Debug)]
pub(super) struct Wire {
    pub(super) link: Link,
    client: ClientId,
    packages: u64,
    /// Data packages that wait for others, to leave together.
    held: BytesMut,
    held_packages: usize,
    on_the_way: VecDeque<Piece>,
    on_the_way_bytes: usize,
    on_the_way_answers: usize,
    /// Data packages that have been sent in full and not been counted.
    sent: usize,
}

impl Wire {
    pub(super) fn new(link: Link, client: ClientId) -> Self {
        Self {
            link,
            client,
            packages: 0,
            held: BytesMut::new(),
            held_packages: 0,
            on_the_way: VecDeque::new(),
            on_the_way_bytes: 0,
            on_the_way_answers: 0,
            sent: 0,
        }
    }

    /// Sends a package, sooner or later.
    pub(super) fn send(&mut self, bytes: &[u8], kind: Kind, network: &Network) {
        if let (Kind::Data, Some(packages)) = (kind, network.coalesce_packages) {
            self.held.extend_from_slice(bytes);
            self.held_packages += 1;
            if self.held_packages >= packages {
                self.let_go(network);
            }
        } else {
            self.let_go(network);
            self.dispatch(&Bytes::copy_from_slice(bytes), usize::from(kind == Kind::Data), kind, network);
        }
        self.deliver(network);
    }

    fn let_go(&mut self, network: &Network) {
        if self.held_packages > 0 {
            let (bytes, packages) = (self.held.split().freeze(), std::mem::take(&mut self.held_packages));
            self.dispatch(&bytes, packages, Kind::Data, network);
        }
    }

    fn dispatch(&mut self, bytes: &Bytes, packages: usize, kind: Kind, network: &Network) {
        self.packages += 1;
        let first_tick = network.tick.unwrap_or(0) + network.delay_ticks(self.client, self.packages);
        let size = network.fragment_bytes.unwrap_or(bytes.len()).max(1);
        let pieces = bytes.len().div_ceil(size);
        let spread = pieces.min(SPREAD_TICKS);
        for i in 0..pieces {
            let piece = bytes.slice(i * size..bytes.len().min((i + 1) * size));
            let last = self.on_the_way.back().map_or(0, |p| p.due_tick);
            let due_tick = last.max(first_tick + (i * spread / pieces) as u64);
            let completes = if i + 1 == pieces { packages } else { 0 };
            self.on_the_way_bytes += piece.len();
            self.on_the_way_answers += usize::from(kind == Kind::Answer);
            self.on_the_way.push_back(Piece { due_tick, bytes: piece, completes, kind });
        }
        if self.on_the_way_bytes > MAX_DELAYED_BYTES {
            self.link.close();
        }
    }

    /// Sends what is due; without time there is no delay, but there are pieces.
    pub(super) fn deliver(&mut self, network: &Network) {
        if network.coalesce_packages.is_none() {
            self.let_go(network);
        }
        let now = network.tick.unwrap_or(u64::MAX);
        while let Some(piece) = self.on_the_way.pop_front_if(|p| p.due_tick <= now) {
            self.link.send(&piece.bytes);
            self.on_the_way_bytes -= piece.bytes.len();
            self.on_the_way_answers -= usize::from(piece.kind == Kind::Answer);
            self.sent += piece.completes;
        }
    }

    /// Data packages that have been sent in full since the last call.
    pub(super) fn take_sent(&mut self) -> usize {
        std::mem::take(&mut self.sent)
    }

    /// Whether an answer is on its way: then the client can do nothing but wait.
    pub(super) fn owes_answer(&self) -> bool {
        self.on_the_way_answers > 0
    }
}
