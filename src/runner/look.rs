//! Cameras that look once and again, for people who mount them. Nothing is logged, nothing moves.

use std::sync::atomic::{AtomicBool, Ordering};

use super::capture::{Cameras, Delivered};
use super::handheld::{CameraDevices, Rest};
use crate::devices::{CameraError, EventCamera, RawEvents};
use crate::events::{Decoder, Event, Format, LastPolarity, Sink, Trigger};
use crate::image::GrayImage;

/// A window without trigger edges has this length, s: one and a half cycles of the display.
const WINDOW_S: f64 = 0.1;
/// An edge that comes sooner after another ends no window, s: the closing pulse has 1 ms.
const WINDOW_MIN_S: f64 = 0.005;

/// Cameras and their clock, for looking.
pub struct Looking {
    cameras: Cameras,
    rest: Rest,
    size: [u32; 2],
    encoding: &'static str,
    trigger_channel: u8,
}

/// What the cameras saw.
#[derive(Debug, Clone)]
pub struct Looked {
    /// The image; absent without a frame camera, or where it was lost.
    pub frame: Option<GrayImage>,
    /// The events; absent without an event camera.
    pub events: Option<EventLook>,
}

/// A window of events.
#[derive(Debug, Clone)]
pub struct EventLook {
    /// The window accumulated: 0 where a pixel fired, 255 elsewhere.
    pub image: GrayImage,
    /// Events in the window.
    pub events: usize,
    /// First and last microsecond of the window, on the sensor's clock; the last does not belong to it.
    pub window_us: [i64; 2],
    /// Whether edges at the trigger input cut the window.
    pub triggered: bool,
    /// The words as they came, from before the window until after it.
    pub packets: Vec<RawEvents>,
}

impl EventLook {
    /// Length of the window, s.
    pub fn window_s(&self) -> f64 {
        1e-6 * self.window_us[1].saturating_sub(self.window_us[0]) as f64
    }
}

impl Looking {
    /// Looks with these cameras; `image_period_s` from one image to the next, `trigger_channel` has the exposures.
    pub fn new(devices: CameraDevices, image_period_s: f64, trigger_channel: u8) -> Self {
        let (frame, event, clock, rest) = devices;
        let (size, encoding) = described(event.as_deref());
        let cameras = Cameras::new(frame, event, clock, (1, image_period_s));
        Self { cameras, rest, size, encoding, trigger_channel }
    }

    /// Columns and rows of the event camera.
    pub fn event_size(&self) -> [u32; 2] {
        self.size
    }

    /// Format of the words of the event camera.
    pub fn encoding(&self) -> &'static str {
        self.encoding
    }

    /// Lets a little time pass.
    pub fn rest(&mut self) {
        (self.rest)();
    }

    /// Takes an image and the events of its exposure; `None` when `interrupted` was raised.
    pub fn look(&mut self, interrupted: &AtomicBool) -> Result<Option<Looked>, CameraError> {
        let mut no_pulse = || Err("`rgb.trigger` waits for a pulse of the robot".to_owned());
        self.cameras.begin_look(1)?;
        loop {
            if interrupted.load(Ordering::Relaxed) {
                return Ok(None);
            }
            if let Some(delivered) = self.cameras.poll_look(&mut no_pulse)? {
                return Ok(Some(self.looked(delivered)));
            }
            (self.rest)();
        }
    }

    fn looked(&self, (frames, packets): Delivered) -> Looked {
        let frame = frames.into_iter().find_map(|frame| frame.image);
        let has_events = self.size[0] > 0;
        Looked { frame, events: has_events.then(|| self.window(packets)) }
    }

    fn window(&self, packets: Vec<RawEvents>) -> EventLook {
        let Found { events, triggers } = Found::decoded(&packets, self.encoding);
        let edges = triggers.iter().filter(|t| t.rising && t.channel == self.trigger_channel).map(|t| t.t_us);
        let cut = cut_by(&edges.collect::<Vec<_>>());
        let newest_us = events.iter().map(|event| event.t_us).max().unwrap_or(0);
        // The newest event belongs to the window.
        let window_us = cut.unwrap_or([newest_us + 1 - (WINDOW_S * 1e6) as i64, newest_us + 1]);
        let [width, height] = self.size.map(|n| u16::try_from(n).unwrap_or(u16::MAX));
        let mut image = LastPolarity::new(width, height);
        let inside = events.iter().filter(|event| (window_us[0]..window_us[1]).contains(&event.t_us));
        let events = inside.inspect(|event| image.add(event)).count();
        EventLook { image: image.image(), events, window_us, triggered: cut.is_some(), packets }
    }
}

fn described(event: Option<&dyn EventCamera>) -> ([u32; 2], &'static str) {
    event.map_or(([0, 0], "evt3"), |event| (event.size(), event.encoding()))
}

/// The last window between two rising edges.
fn cut_by(edges_us: &[i64]) -> Option<[i64; 2]> {
    let shortest_us = (WINDOW_MIN_S * 1e6) as i64;
    edges_us.windows(2).rev().map(|w| [w[0], w[1]]).find(|[from, to]| to.saturating_sub(*from) >= shortest_us)
}

/// Everything in some packets, in order of arrival.
#[derive(Default)]
struct Found {
    events: Vec<Event>,
    triggers: Vec<Trigger>,
}

impl Found {
    fn decoded(packets: &[RawEvents], encoding: &str) -> Self {
        let mut found = Self::default();
        let mut decoder = Decoder::new(Format::from_name(encoding).unwrap_or(Format::Evt3));
        if let Some(first) = packets.first() {
            decoder.set_epoch_us(first.first_us);
        }
        packets.iter().for_each(|packet| decoder.decode_into(&packet.words, &mut found));
        found
    }
}

impl Sink for Found {
    fn event(&mut self, event: Event) {
        self.events.push(event);
    }

    fn trigger(&mut self, trigger: Trigger) {
        self.triggers.push(trigger);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_whole_window_counts() {
        assert_eq!(cut_by(&[1_000, 101_000, 201_000, 202_000]), Some([101_000, 201_000]));
        assert_eq!(cut_by(&[5]), None);
        assert_eq!(cut_by(&[]), None);
        assert_eq!(cut_by(&[7_000, 7_500]), None);
        assert_eq!(cut_by(&[i64::MAX, i64::MIN]), None);
    }
}
