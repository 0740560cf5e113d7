//! How many of the display's transitions each pixel answered: what corners are fitted to.

use super::{BlinkClock, Event, Sink, Trigger};
use crate::image::FloatImage;

/// Counts answers of every pixel: events of the polarity that their transition has.
#[derive(Debug, Clone)]
pub struct Answered {
    width: usize,
    height: usize,
    clock: Option<BlinkClock>,
    counts: Vec<[u16; 2]>,
}

impl Answered {
    /// Nothing yet, for `width` by `height` pixels.
    pub fn new(width: u16, height: u16) -> Self {
        let (width, height) = (usize::from(width), usize::from(height));
        Self { width, height, clock: None, counts: vec![[0; 2]; width * height] }
    }

    /// ON and OFF events of every pixel.
    pub fn image(&self) -> FloatImage {
        let values = self.counts.iter().map(|[off, on]| f32::from(*off) + f32::from(*on)).collect();
        FloatImage { width: self.width, height: self.height, values }
    }
}

impl Sink for Answered {
    #[inline]
    fn event(&mut self, event: Event) {
        let (x, y) = (usize::from(event.x), usize::from(event.y));
        if x < self.width
            && let Some(counts) = self.counts.get_mut(y * self.width + x)
        {
            let slot = &mut counts[usize::from(event.on)];
            *slot = slot.saturating_add(1);
        }
    }

    fn trigger(&mut self, _: Trigger) {}
}
