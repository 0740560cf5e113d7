//! Accumulation of events into images, as the paper does it: a pixel that fired is dark on light.

use super::{Event, Sink, Trigger};
use crate::image::GrayImage;

/// Value of a pixel that fired.
const FIRED: u8 = 0;
/// Value of a pixel that did not.
const SILENT: u8 = 255;

/// The size of the sensor, and the events that did not fit it.
#[derive(Debug, Clone)]
struct Bounds {
    width: usize,
    height: usize,
    outside: u64,
}

impl Bounds {
    fn new(width: u16, height: u16) -> Self {
        Self { width: width.into(), height: height.into(), outside: 0 }
    }

    fn pixels(&self) -> usize {
        self.width * self.height
    }

    /// Index of the pixel, row by row; `None` is counted.
    #[inline]
    fn index(&mut self, event: &Event) -> Option<usize> {
        let (x, y) = (usize::from(event.x), usize::from(event.y));
        if x < self.width && y < self.height {
            return Some(y * self.width + x);
        }
        self.outside += 1;
        None
    }
}

/// The last polarity of every pixel since the start of a window.
///
/// White cells of the blinking board do not change and stay silent, so [`Self::image`] has the polarity of the board.
#[derive(Debug, Clone)]
pub struct LastPolarity {
    bounds: Bounds,
    last: Vec<Option<bool>>,
}

impl LastPolarity {
    /// An image of `width` by `height` pixels in which nothing fired.
    pub fn new(width: u16, height: u16) -> Self {
        let bounds = Bounds::new(width, height);
        Self { last: vec![None; bounds.pixels()], bounds }
    }

    /// Adds one event; one outside the image is only counted.
    #[inline]
    pub fn add(&mut self, event: &Event) {
        if let Some(slot) = self.bounds.index(event).and_then(|index| self.last.get_mut(index)) {
            *slot = Some(event.on);
        }
    }

    /// Adds events in order of time.
    pub fn add_all(&mut self, events: &[Event]) {
        events.iter().for_each(|event| self.add(event));
    }

    /// Forgets all events, for the next window.
    pub fn clear(&mut self) {
        self.last.fill(None);
        self.bounds.outside = 0;
    }

    /// Events that did not fit the image.
    pub fn outside(&self) -> u64 {
        self.bounds.outside
    }

    /// Pixels that fired.
    pub fn fired(&self) -> usize {
        self.last.iter().flatten().count()
    }

    /// The event image of the paper: 0 where a pixel fired, of either polarity, 255 elsewhere.
    pub fn image(&self) -> GrayImage {
        self.paint(|last| if last.is_some() { FIRED } else { SILENT })
    }

    /// The last polarities: 0 for OFF, 255 for ON, 128 where nothing fired.
    pub fn polarity_image(&self) -> GrayImage {
        self.paint(|last| match last {
            Some(true) => 255,
            Some(false) => 0,
            None => 128,
        })
    }

    fn paint(&self, value: impl Fn(&Option<bool>) -> u8) -> GrayImage {
        let pixels = self.last.iter().map(value).collect();
        GrayImage { width: self.bounds.width, height: self.bounds.height, pixels }
    }
}

impl Sink for LastPolarity {
    #[inline]
    fn event(&mut self, event: Event) {
        self.add(&event);
    }

    fn trigger(&mut self, _: Trigger) {}
}

/// How often every pixel fired, for each polarity; for finding hot pixels and for contrast.
#[derive(Debug, Clone)]
pub struct PolarityCounts {
    bounds: Bounds,
    on: Vec<u32>,
    off: Vec<u32>,
}

impl PolarityCounts {
    /// Counts of zero for `width` by `height` pixels.
    pub fn new(width: u16, height: u16) -> Self {
        let bounds = Bounds::new(width, height);
        Self { on: vec![0; bounds.pixels()], off: vec![0; bounds.pixels()], bounds }
    }

    /// Adds one event; one outside the image is only counted.
    #[inline]
    pub fn add(&mut self, event: &Event) {
        let counts = if event.on { &mut self.on } else { &mut self.off };
        if let Some(slot) = self.bounds.index(event).and_then(|index| counts.get_mut(index)) {
            *slot = slot.saturating_add(1);
        }
    }

    /// ON events of every pixel, row by row.
    pub fn on(&self) -> &[u32] {
        &self.on
    }

    /// OFF events of every pixel, row by row.
    pub fn off(&self) -> &[u32] {
        &self.off
    }

    /// Events that did not fit the image.
    pub fn outside(&self) -> u64 {
        self.bounds.outside
    }
}

impl Sink for PolarityCounts {
    #[inline]
    fn event(&mut self, event: Event) {
        self.add(&event);
    }

    fn trigger(&mut self, _: Trigger) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(x: u16, y: u16, on: bool) -> Event {
        Event { t_us: 0, x, y, on }
    }

    #[test]
    fn either_polarity_is_dark_and_the_last_one_is_kept() {
        let mut last = LastPolarity::new(3, 2);
        last.add_all(&[event(0, 0, true), event(2, 1, true), event(2, 1, false)]);
        assert_eq!(last.image().pixels, [0, 255, 255, 255, 255, 0]);
        assert_eq!(last.polarity_image().pixels, [255, 128, 128, 128, 128, 0]);
        assert_eq!(last.fired(), 2);
        last.clear();
        assert_eq!(last.image(), GrayImage::filled(3, 2, 255));
    }

    #[test]
    fn events_outside_are_counted() {
        let mut last = LastPolarity::new(3, 2);
        let mut counts = PolarityCounts::new(3, 2);
        for outside in [event(3, 0, true), event(0, 2, false), event(u16::MAX, u16::MAX, true)] {
            last.add(&outside);
            counts.add(&outside);
        }
        assert_eq!((last.outside(), last.fired(), counts.outside()), (3, 0, 3));
        let mut nothing = LastPolarity::new(0, 0);
        nothing.add(&event(0, 0, true));
        assert_eq!(nothing.outside(), 1);
    }

    #[test]
    fn counts_are_kept_for_each_polarity() {
        let mut counts = PolarityCounts::new(2, 1);
        [event(0, 0, true), event(0, 0, true), event(1, 0, false)].iter().for_each(|event| counts.add(event));
        assert_eq!((counts.on(), counts.off()), (&[2, 0][..], &[0, 1][..]));
    }
}
