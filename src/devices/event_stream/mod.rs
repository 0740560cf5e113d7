//! An event camera from a stream of packets: what all real event cameras and their recordings share.
//!
//! A thread takes packets as they come and keeps the last moment, so that a capture has the events from before it. A
//! driver is a [`PacketSource`]. Uses `events` for the sensor's time. Start at [`StreamedCamera`].

mod raw_file;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

pub use raw_file::RawFile;

use super::{CameraError, CameraFacts, Clock, EventCamera, PRE_ROLL_S, RawEvents};
use crate::events::{Decoder, Event, Format, Sink, Trigger};
use crate::geometry::Camera;
use crate::session::Stamp;

/// How long a source is asked to wait for a packet.
const WAIT: Duration = Duration::from_millis(20);
/// A stream that is silent for longer has failed, s: even a dark sensor sends its time.
const SILENT_S: f64 = 2.0;
/// At the end of a capture packets that are on their way are waited for up to this long.
const LATE: Duration = Duration::from_millis(60);
/// Memory of one capture, bytes: 30 s of 20 million events a second.
const CAPTURE_BYTES_MAX: usize = 2_400_000_000;

/// Words as a bus delivers them.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Packet {
    /// The words, little-endian.
    pub words: Vec<u8>,
    /// When it reached the host, on the session's clock.
    pub arrived: Stamp,
    /// Whether packets before it were lost because nobody took them in time.
    pub after_loss: bool,
}

/// Where packets come from.
pub trait PacketSource: Send {
    /// Waits for the next packet, not much longer than `wait`; `None` if nothing came.
    ///
    /// # Errors
    /// A sentence, when nothing will come any more.
    fn next(&mut self, wait: Duration) -> Result<Option<Packet>, String>;
}

/// What the thread and the camera share.
#[derive(Default)]
struct Shared {
    packets: VecDeque<RawEvents>,
    bytes: usize,
    recording: bool,
    /// When the last packet came.
    last: Stamp,
    /// Breaks in the stream of this capture.
    losses: u32,
    failed: Option<String>,
}

/// A [`PacketSource`] as an event camera.
pub struct StreamedCamera {
    shared: Arc<(Mutex<Shared>, Condvar)>,
    clock: Arc<dyn Clock>,
    facts: CameraFacts,
    size: [u32; 2],
    format: Format,
    stop: Arc<AtomicBool>,
    reader: Option<JoinHandle<()>>,
}

impl StreamedCamera {
    /// Begins to take packets of `format` from `source`.
    ///
    /// # Errors
    /// [`CameraError::Failed`] if no thread can be started.
    pub fn start(
        source: Box<dyn PacketSource>,
        facts: CameraFacts,
        size: [u32; 2],
        format: Format,
        clock: Arc<dyn Clock>,
    ) -> Result<Self, CameraError> {
        let shared = Arc::new((Mutex::new(Shared { last: clock.now(), ..Shared::default() }), Condvar::new()));
        let stop = Arc::new(AtomicBool::new(false));
        let reader =
            Reader { source, decoder: Decoder::new(format), shared: Arc::clone(&shared), stop: Arc::clone(&stop) };
        let spawned = std::thread::Builder::new().name("events".into()).spawn(move || reader.run());
        let failed = |error: std::io::Error| CameraError::Failed { camera: Camera::Event, why: error.to_string() };
        let reader = Some(spawned.map_err(failed)?);
        Ok(Self { shared, clock, facts, size, format, stop, reader })
    }

    fn locked(&self) -> MutexGuard<'_, Shared> {
        self.shared.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn check(&self, shared: &Shared) -> Result<(), CameraError> {
        let camera = Camera::Event;
        if let Some(why) = &shared.failed {
            return Err(CameraError::Failed { camera, why: why.clone() });
        }
        let silent_s = self.clock.now().seconds() - shared.last.seconds();
        if silent_s > SILENT_S { Err(CameraError::Silent { camera, silent_s }) } else { Ok(()) }
    }
}

impl EventCamera for StreamedCamera {
    fn facts(&self) -> CameraFacts {
        self.facts.clone()
    }

    fn size(&self) -> [u32; 2] {
        self.size
    }

    fn encoding(&self) -> &'static str {
        self.format.encoding()
    }

    fn begin(&mut self) -> Result<(), CameraError> {
        let mut shared = self.locked();
        self.check(&shared)?;
        let from = Stamp::from_seconds((self.clock.now().seconds() - PRE_ROLL_S).max(0.0));
        shared.keep_since(from);
        (shared.recording, shared.losses) = (true, 0);
        Ok(())
    }

    fn take(&mut self) -> Result<Vec<RawEvents>, CameraError> {
        let mut shared = self.locked();
        self.check(&shared)?;
        shared.bytes = 0;
        Ok(std::mem::take(&mut shared.packets).into())
    }

    fn end(&mut self) -> Result<Vec<RawEvents>, CameraError> {
        let asked = self.clock.now();
        let (lock, came) = &*self.shared;
        let shared = lock.lock().unwrap_or_else(PoisonError::into_inner);
        let late = |shared: &mut Shared| shared.last < asked && shared.failed.is_none();
        let (mut shared, _) = came.wait_timeout_while(shared, LATE, late).unwrap_or_else(PoisonError::into_inner);
        shared.recording = false;
        shared.bytes = 0;
        let packets = std::mem::take(&mut shared.packets);
        self.check(&shared)?;
        if shared.losses > 0 {
            let why = format!(
                "events were lost {} times during the capture: the computer was too slow or the scene too busy; raise the \
                 thresholds (biases diff_on, diff_off), close the iris, or stop what else runs on this computer",
                shared.losses
            );
            return Err(CameraError::Failed { camera: Camera::Event, why });
        }
        Ok(packets.into())
    }
}

impl Drop for StreamedCamera {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(reader) = self.reader.take() {
            // A reader that panicked has nothing more to say.
            let _ = reader.join();
        }
    }
}

impl Shared {
    fn keep_since(&mut self, from: Stamp) {
        while self.packets.front().is_some_and(|packet| packet.arrived < from) {
            let dropped = self.packets.pop_front().map_or(0, |packet| packet.words.len());
            self.bytes = self.bytes.saturating_sub(dropped);
        }
    }

    fn take(&mut self, packet: RawEvents, after_loss: bool) {
        self.last = packet.arrived;
        self.losses += u32::from(after_loss && self.recording);
        self.bytes += packet.words.len();
        self.packets.push_back(packet);
        if !self.recording {
            self.keep_since(Stamp::from_seconds((self.last.seconds() - PRE_ROLL_S).max(0.0)));
        } else if self.bytes > CAPTURE_BYTES_MAX {
            self.losses += 1;
            self.packets.clear();
            self.bytes = 0;
        }
    }
}

/// The thread that takes packets.
struct Reader {
    source: Box<dyn PacketSource>,
    decoder: Decoder,
    shared: Arc<(Mutex<Shared>, Condvar)>,
    stop: Arc<AtomicBool>,
}

impl Reader {
    fn run(mut self) {
        let mut time = SensorTime::default();
        while !self.stop.load(Ordering::Relaxed) {
            let next = self.source.next(WAIT);
            let mut shared = None;
            match next {
                Ok(None) => continue,
                Ok(Some(packet)) => {
                    time.first_us = None;
                    self.decoder.decode_into(&packet.words, &mut time);
                    let Packet { words, arrived, after_loss } = packet;
                    let first_us = time.first_us.unwrap_or(time.last_us);
                    let packet = RawEvents { first_us, arrived, words };
                    shared
                        .insert(self.shared.0.lock().unwrap_or_else(PoisonError::into_inner))
                        .take(packet, after_loss);
                }
                Err(why) => {
                    shared.insert(self.shared.0.lock().unwrap_or_else(PoisonError::into_inner)).failed = Some(why);
                    self.stop.store(true, Ordering::Relaxed);
                }
            }
            drop(shared);
            self.shared.1.notify_all();
        }
    }
}

/// The sensor time at which a packet begins.
#[derive(Default)]
struct SensorTime {
    first_us: Option<i64>,
    last_us: i64,
}

impl SensorTime {
    fn at(&mut self, t_us: i64) {
        self.first_us.get_or_insert(t_us);
        self.last_us = t_us;
    }
}

impl Sink for SensorTime {
    #[inline]
    fn event(&mut self, event: Event) {
        self.at(event.t_us);
    }

    fn trigger(&mut self, trigger: Trigger) {
        self.at(trigger.t_us);
    }
}
