//! A RAW file played at its own pace, again and again: for bringing a cell up without its event camera.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use super::{Packet, PacketSource, StreamedCamera};
use crate::devices::{CameraError, CameraFacts, Clock};
use crate::events::{Decoder, Event, Header, Sink, Trigger};
use crate::geometry::Camera;
use crate::session::Stamp;

/// Packets hold this much time, microseconds.
const PACKET_US: i64 = 10_000;
/// Words that are looked at to find where a packet ends.
const STEP_BYTES: usize = 1024;

/// The recording, cut into packets, and how far it has been played.
pub struct RawFile {
    words: Vec<u8>,
    /// End of each packet in `words`, and its time since the first, microseconds.
    ends: Vec<(usize, i64)>,
    next: usize,
    /// When the first packet of this round was due, s.
    began_s: f64,
    clock: Arc<dyn Clock>,
}

impl RawFile {
    /// Opens a file as an event camera; `size` is that of the cell.
    ///
    /// # Errors
    /// [`CameraError::Failed`] for a file that cannot be read, is no RAW file, holds no event or has another size.
    pub fn open(path: &Path, size: [u32; 2], clock: Arc<dyn Clock>) -> Result<StreamedCamera, CameraError> {
        let failed =
            |why: String| CameraError::Failed { camera: Camera::Event, why: format!("{}: {why}", path.display()) };
        let bytes = std::fs::read(path).map_err(|error| failed(error.to_string()))?;
        let header = Header::parse(&bytes).map_err(|error| failed(error.to_string()))?;
        let found = [header.width, header.height].map(|n| n.map(u32::from));
        if let [Some(width), Some(height)] = found
            && [width, height] != size
        {
            let [w, h] = size;
            return Err(failed(format!("it is {width} x {height}, the cell says {w} x {h}; correct width and height")));
        }
        let words = bytes.get(header.len_bytes..).unwrap_or_default().to_vec();
        let ends = packets(&words, header.format);
        if ends.is_empty() {
            return Err(failed("it holds no event".into()));
        }
        let facts = CameraFacts {
            model: format!("RAW file {}", path.display()),
            serial: header.field("serial_number").map(str::to_owned),
            ..CameraFacts::default()
        };
        let began_s = clock.now().seconds();
        let source = Self { words, ends, next: 0, began_s, clock: Arc::clone(&clock) };
        StreamedCamera::start(Box::new(source), facts, size, header.format, clock)
    }
}

impl PacketSource for RawFile {
    #[expect(clippy::disallowed_methods, reason = "plays at the pace of the recording")]
    fn next(&mut self, wait: Duration) -> Result<Option<Packet>, String> {
        let Some((end, at_us)) = self.ends.get(self.next).copied() else {
            // The time of the last packet passes before the first comes again.
            self.began_s = self.clock.now().seconds();
            self.next = 0;
            return Ok(None);
        };
        let due_s = self.began_s + at_us as f64 * 1e-6;
        let missing_s = due_s - self.clock.now().seconds();
        if missing_s > 0.0 {
            std::thread::sleep(wait.min(Duration::from_secs_f64(missing_s)));
        }
        let now = self.clock.now();
        if now.seconds() < due_s {
            return Ok(None);
        }
        let begin = self.next.checked_sub(1).and_then(|last| self.ends.get(last)).map_or(0, |(end, _)| *end);
        self.next += 1;
        let words = self.words.get(begin..end).unwrap_or_default().to_vec();
        Ok(Some(Packet { words, arrived: Stamp::from_seconds(now.seconds()), after_loss: false }))
    }
}

/// Where packets end, and the time since the first event at which each is complete, microseconds.
fn packets(words: &[u8], format: crate::events::Format) -> Vec<(usize, i64)> {
    let (mut decoder, mut last) = (Decoder::new(format), Last(None));
    let (mut ends, mut begun, mut first) = (Vec::new(), None, None);
    for (i, step) in words.chunks(STEP_BYTES).enumerate() {
        decoder.decode_into(step, &mut last);
        let Some(now_us) = last.0 else { continue };
        let (first_us, begun_us) = (*first.get_or_insert(now_us), *begun.get_or_insert(now_us));
        if now_us.saturating_sub(begun_us) >= PACKET_US {
            ends.push(((i * STEP_BYTES + step.len()), now_us.saturating_sub(first_us)));
            begun = Some(now_us);
        }
    }
    if let (Some(now_us), Some(first_us)) = (last.0, first) {
        ends.push((words.len(), now_us.saturating_sub(first_us).max(0)));
    }
    ends
}

struct Last(Option<i64>);

impl Sink for Last {
    fn event(&mut self, event: Event) {
        self.0 = Some(event.t_us);
    }

    fn trigger(&mut self, trigger: Trigger) {
        self.0 = Some(trigger.t_us);
    }
}
