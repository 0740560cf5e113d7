//! Which pixels see the display: those that get brighter and darker about equally often, not too often.

use super::super::Event;

/// Changes of a pixel in one direction that are more than noise.
const CHANGES_MIN: u16 = 2;
/// One direction may have this many times the events of the other.
const UNEVEN_MAX: u16 = 4;
/// Pixels that fire more often are hot, Hz: a display has at most some events for each of its transitions.
const RATE_MAX_HZ: f64 = 1500.0;

/// The pixels that blink.
pub(super) struct Blinking {
    width: usize,
    height: usize,
    is: Vec<bool>,
}

impl Blinking {
    pub(super) fn find(events: &[Event], [width, height]: [u16; 2], seconds: f64) -> Self {
        let (width, height) = (usize::from(width), usize::from(height));
        let mut counts = vec![[0_u16; 2]; width * height];
        for event in events {
            let (x, y) = (usize::from(event.x), usize::from(event.y));
            if x < width
                && let Some(count) = counts.get_mut(y * width + x)
            {
                let one = &mut count[usize::from(event.on)];
                *one = one.saturating_add(1);
            }
        }
        let blinks = |[off, on]: &[u16; 2]| {
            let (few, many) = (*off.min(on), *off.max(on));
            few >= CHANGES_MIN && many <= few.saturating_mul(UNEVEN_MAX) && f64::from(many) <= RATE_MAX_HZ * seconds
        };
        let is: Vec<bool> = counts.iter().map(blinks).collect();
        Self { width, height, is }.without_loners()
    }

    /// A hot pixel stands alone, cells of a board do not.
    fn without_loners(self) -> Self {
        let at = |x: usize, y: usize| self.is.get(y * self.width + x).copied().unwrap_or(false);
        let has_company = |x: usize, y: usize| {
            let columns = x.saturating_sub(1)..(x + 2).min(self.width);
            let around = columns.flat_map(|c| (y.saturating_sub(1)..(y + 2).min(self.height)).map(move |r| (c, r)));
            around.filter(|(c, r)| at(*c, *r)).count() >= 4
        };
        let pixels = (0..self.height).flat_map(|y| (0..self.width).map(move |x| (x, y)));
        let is = pixels.map(|(x, y)| at(x, y) && has_company(x, y)).collect();
        Self { is, ..self }
    }

    pub(super) fn count(&self) -> usize {
        self.is.iter().filter(|is| **is).count()
    }

    pub(super) fn has(&self, event: &Event) -> bool {
        let (x, y) = (usize::from(event.x), usize::from(event.y));
        x < self.width && self.is.get(y * self.width + x).copied().unwrap_or(false)
    }

    /// First column, first row, last column, last row, without the outermost 1 % on each side.
    pub(super) fn extent(&self) -> [u16; 4] {
        let of = |length: usize, index: &dyn Fn(usize) -> usize| {
            let mut counts = vec![0_usize; length];
            for (i, _) in self.is.iter().enumerate().filter(|(_, is)| **is) {
                if let Some(count) = counts.get_mut(index(i)) {
                    *count += 1;
                }
            }
            let one_percent = self.count() / 100;
            let mut sum = 0;
            let below: Vec<usize> = counts
                .iter()
                .map(|count| {
                    sum += count;
                    sum
                })
                .collect();
            let first = below.iter().position(|sum| *sum > one_percent).unwrap_or(0);
            let last = below.iter().position(|sum| *sum >= self.count() - one_percent).unwrap_or(0);
            [first, last].map(|i| u16::try_from(i).unwrap_or(u16::MAX))
        };
        let width = self.width.max(1);
        let ([x0, x1], [y0, y1]) = (of(self.width, &|i| i % width), of(self.height, &|i| i / width));
        [x0, y0, x1, y1]
    }
}
