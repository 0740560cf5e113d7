//! Which exposures belong to a capture, and when it is over. Times are seconds of the session's clock.

use crate::config::FrameTrigger;
use crate::devices::FrameImage;
use crate::image::GrayImage;
use crate::session::Exposure;

/// An image may arrive this long after its exposure, s.
const PATIENCE_S: f64 = 1.0;
/// The event camera gets this long to deliver the edge that ends the last window, s.
const CLOSING_MARGIN_S: f64 = 0.01;
/// So many triggers in a row without an image mean that the camera is gone.
const SILENT_TRIGGERS: u32 = 2;

/// When a camera exposes, as read back from it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::devices) struct Timing {
    /// What begins an exposure.
    pub(in crate::devices) trigger: FrameTrigger,
    /// Exposure time, s.
    pub(in crate::devices) exposure_s: f64,
    /// From one exposure to the next, s.
    pub(in crate::devices) period_s: f64,
}

/// A capture that is going on.
#[derive(Debug)]
pub(in crate::devices) struct Capture {
    timing: Timing,
    images: usize,
    begun_s: f64,
    taken: Vec<FrameImage>,
    /// When the exposure was triggered that has not arrived yet.
    asked_s: Option<f64>,
    /// When anything arrived for the last time.
    heard_s: f64,
    unanswered: u32,
}

impl Capture {
    /// The next `images` exposures that begin after now.
    pub(in crate::devices) fn new(timing: Timing, images: u32, now_s: f64) -> Self {
        let images = images as usize;
        Self { timing, images, begun_s: now_s, taken: Vec::new(), asked_s: None, heard_s: now_s, unanswered: 0 }
    }

    /// Whether the next exposure is to be triggered now.
    pub(in crate::devices) fn wants_trigger(&self, now_s: f64) -> bool {
        let triggered = self.timing.trigger != FrameTrigger::FreeRun;
        let rested = self.taken.last().is_none_or(|last| now_s >= last.exposure.start_s + self.timing.period_s);
        triggered && rested && self.asked_s.is_none() && self.taken.len() <= self.images
    }

    /// The exposure has been triggered.
    pub(in crate::devices) fn triggered(&mut self, now_s: f64) {
        self.asked_s = Some(now_s);
        self.heard_s = self.heard_s.max(now_s);
    }

    /// Whether the image of an exposure that began then is needed.
    pub(in crate::devices) fn needs_image(&self, start_s: f64) -> bool {
        self.belongs(start_s) && self.taken.len() < self.images
    }

    fn belongs(&self, start_s: f64) -> bool {
        match self.timing.trigger {
            FrameTrigger::FreeRun => start_s >= self.begun_s && self.taken.len() < self.images,
            // Late images of a capture that was given up end before the trigger.
            FrameTrigger::Software | FrameTrigger::RobotOutput(_) => {
                self.asked_s.is_some_and(|asked_s| start_s + self.timing.exposure_s >= asked_s)
            }
        }
    }

    /// An exposure has happened; without an image it was lost.
    pub(in crate::devices) fn take(&mut self, start_s: f64, lost_packets: u32, image: Option<GrayImage>, now_s: f64) {
        self.heard_s = now_s;
        if self.belongs(start_s) {
            (self.asked_s, self.unanswered) = (None, 0);
            self.push(start_s, lost_packets, image);
        }
    }

    fn push(&mut self, start_s: f64, lost_packets: u32, image: Option<GrayImage>) {
        let end_s = start_s + self.timing.exposure_s;
        self.taken.push(if self.taken.len() < self.images {
            let exposure = Exposure { image: image.is_some(), lost_packets, ..Exposure::whole(start_s, end_s) };
            FrameImage { exposure, image }
        } else {
            FrameImage { exposure: Exposure::closing(start_s, end_s), image: None }
        });
    }

    /// A trigger whose image does not come is an exposure without one; after two of them, or where a camera that
    /// should run by itself sends nothing, the answer is since when, s.
    pub(in crate::devices) fn silent_s(&mut self, now_s: f64) -> Option<f64> {
        let Timing { trigger, exposure_s, period_s } = self.timing;
        let waited_s = now_s - self.heard_s;
        let overdue = waited_s > exposure_s + PATIENCE_S;
        match trigger {
            FrameTrigger::FreeRun => (waited_s > exposure_s + 3.0 * period_s + PATIENCE_S).then_some(waited_s),
            // Nobody knows whether the pulse got through: no exposure can be assumed.
            FrameTrigger::RobotOutput(_) => (overdue && self.asked_s.is_some()).then_some(waited_s),
            FrameTrigger::Software => {
                let asked_s = self.asked_s.filter(|_| overdue)?;
                (self.asked_s, self.unanswered) = (None, self.unanswered + 1);
                self.push(asked_s, 0, None);
                (self.unanswered >= SILENT_TRIGGERS).then_some(now_s - self.begun_s)
            }
        }
    }

    /// Whether all exposures are there and the last event window is over.
    pub(in crate::devices) fn is_over(&self, now_s: f64) -> bool {
        let Some(FrameImage { exposure: last, .. }) = self.taken.last() else { return false };
        match self.timing.trigger {
            FrameTrigger::FreeRun => {
                let closed = now_s >= last.start_s + self.timing.period_s + CLOSING_MARGIN_S;
                self.taken.len() >= self.images && closed
            }
            FrameTrigger::Software | FrameTrigger::RobotOutput(_) => {
                self.taken.len() > self.images && now_s >= last.end_s
            }
        }
    }

    /// The exposures, in order.
    pub(in crate::devices) fn into_images(self) -> Vec<FrameImage> {
        self.taken
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FREE: Timing = Timing { trigger: FrameTrigger::FreeRun, exposure_s: 0.08, period_s: 0.1 };

    fn image(value: u8) -> Option<GrayImage> {
        Some(GrayImage::filled(2, 2, value))
    }

    #[test]
    fn free_running_the_next_whole_exposures_count() {
        let mut capture = Capture::new(FREE, 2, 5.0);
        for i in 0..5 {
            let start_s = 4.95 + 0.1 * f64::from(i);
            capture.take(start_s, 0, image(i), start_s + 0.09);
        }
        assert!(!capture.wants_trigger(6.0));
        assert!(!capture.is_over(5.25), "the exposure after the last has not begun");
        assert!(capture.is_over(5.265));
        let images = capture.into_images();
        let values: Vec<u8> = images.iter().map(|i| i.image.as_ref().unwrap().at(0, 0)).collect();
        assert_eq!(values, [1, 2], "the exposure that had begun before does not count");
        assert!(images.iter().all(|i| i.exposure.image && !i.exposure.closing));
    }

    #[test]
    fn each_exposure_is_triggered_and_one_more_closes() {
        let mut capture = Capture::new(Timing { trigger: FrameTrigger::Software, ..FREE }, 2, 1.0);
        let mut now_s = 1.0;
        for i in 0..3_u8 {
            assert!(capture.wants_trigger(now_s) && !capture.is_over(now_s));
            capture.triggered(now_s);
            assert!(!capture.wants_trigger(now_s));
            // A late image of a capture before.
            capture.take(now_s - 0.5, 0, image(99), now_s);
            assert_eq!(capture.needs_image(now_s), i < 2);
            capture.take(now_s + 0.001, u32::from(i), (i != 1).then(|| GrayImage::filled(2, 2, i)), now_s + 0.09);
            assert!(!capture.wants_trigger(now_s + 0.1), "the camera rests for a period");
            now_s += 0.102;
        }
        assert!(!capture.wants_trigger(now_s) && capture.is_over(now_s));
        let exposures: Vec<_> = capture.into_images().into_iter().map(|i| i.exposure).collect();
        assert_eq!(exposures.iter().map(|e| e.image).collect::<Vec<_>>(), [true, false, false]);
        assert_eq!(exposures.iter().map(|e| e.closing).collect::<Vec<_>>(), [false, false, true]);
        assert_eq!(exposures.iter().map(|e| e.lost_packets).collect::<Vec<_>>(), [0, 1, 0]);
    }

    #[test]
    fn silence_is_told_and_one_lost_image_is_none() {
        let mut capture = Capture::new(FREE, 1, 0.0);
        assert_eq!(capture.silent_s(1.3), None);
        assert_eq!(capture.silent_s(1.5), Some(1.5));

        let mut capture = Capture::new(Timing { trigger: FrameTrigger::Software, ..FREE }, 1, 0.0);
        capture.triggered(0.0);
        assert_eq!(capture.silent_s(1.0), None);
        assert_eq!(capture.silent_s(1.1), None);
        assert!(capture.wants_trigger(1.1), "the closing exposure is still to be made");
        capture.triggered(1.1);
        assert_eq!(capture.silent_s(2.3), Some(2.3));

        let mut capture = Capture::new(Timing { trigger: FrameTrigger::RobotOutput(3), ..FREE }, 1, 0.0);
        assert_eq!(capture.silent_s(50.0), None, "nobody has pulsed the line yet");
        capture.triggered(50.0);
        assert!(capture.silent_s(51.2).is_some());
    }
}
