//! From the images and raw events of a recording to what each camera saw at each pose.
//!
//! One pass over the events for the trigger edges, one for the windows; detection on all cores, results in
//! a fixed order. Memory: a few images at a time beside the recording itself.

use std::collections::BTreeMap;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::event_windows::{decode, event_windows};
use super::setup::Setup;
use crate::board::View;
use crate::calibration::result::{PairedBy, Timing};
use crate::calibration::settings::Method;
use crate::cv::{CvError, codec};
use crate::events::sync::Window;
use crate::events::{Accumulated, Answered, BlinkClock, Event, LastPolarity, Sink, Trigger};
use crate::geometry::Camera;
use crate::image::{FloatImage, GrayImage};
use crate::recording::{Entry, Kind, Recording};
use crate::session::{Exposure, Input, Outcome, PoseRecord, Stamp};
use crate::vision::{self, precise};

/// What the cameras saw, pose by pose.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Seen {
    /// One map for each pose; a camera without an image at a pose is absent.
    pub(super) views: Vec<BTreeMap<Camera, View>>,
    /// How events and exposures were brought together, where there are both.
    pub(super) timing: Option<SeenTiming>,
    /// Images and windows that could not be used, in words.
    pub(super) problems: Vec<String>,
}

/// The part of the timing that the result shows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct SeenTiming {
    #[serde(default)]
    pub(super) paired_by: PairedBy,
    pub(super) offset_s: f64,
    pub(super) drift_ppm: f64,
    pub(super) residual_rms_s: f64,
    #[serde(default)]
    pub(super) arrival_latency_s: Option<f64>,
    pub(super) windows: [usize; 2],
    pub(super) notes: Vec<String>,
}

impl Seen {
    /// Of a resumed session the clocks of the first part are shown.
    pub(super) fn add_timing(&mut self, timing: SeenTiming) {
        match &mut self.timing {
            Some(first) => {
                first.windows = [0, 1].map(|i| first.windows[i] + timing.windows[i]);
                first.notes.extend(timing.notes);
            }
            none => *none = Some(timing),
        }
    }
}

impl From<SeenTiming> for Timing {
    fn from(seen: SeenTiming) -> Self {
        let SeenTiming { paired_by, offset_s, drift_ppm, residual_rms_s, arrival_latency_s, windows, notes } = seen;
        Self { paired_by, offset_s, drift_ppm, residual_rms_s, arrival_latency_s, windows, notes }
    }
}

/// One exposure of a session.
pub(super) struct Shot<'a> {
    /// The pose that it observes; absent for repeated captures and exposures outside the still interval.
    pub(super) pose: Option<usize>,
    /// The pose that it was taken at.
    pub(super) taken_at: usize,
    pub(super) exposure: Exposure,
    image: Option<&'a [u8]>,
}

/// Finds the corners in everything that the recording holds. `progress` hears done and total.
pub(super) fn look(
    recording: &Recording,
    setup: &Setup,
    outcome: &Outcome,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Seen {
    if let Some(views) = declared_views(outcome) {
        return Seen { views, timing: None, problems: Vec::new() };
    }
    let parts = parts(recording);
    let shots: Vec<Vec<Shot<'_>>> = parts.iter().map(|part| part.shots(outcome)).collect();
    let mut seen = Seen { views: vec![BTreeMap::new(); outcome.poses.len()], timing: None, problems: Vec::new() };
    let counter = Counter::new(shots.iter().flatten(), setup, progress);
    let (mut frames, mut events) = (Vec::new(), Vec::new());
    for (part, shots) in parts.iter().zip(&shots) {
        frames.extend(frame_views(shots, setup, &counter, &mut seen.problems));
        if let Some(event) = setup.cameras.get(&Camera::Event) {
            let size = (event.width as u16, event.height as u16);
            let windows = event_windows(part, setup, shots, outcome, &mut seen);
            events.extend(match setup.settings.method {
                Method::Paper => {
                    let image = LastPolarity::new(size.0, size.1);
                    event_views(part, image, &|image| vision::event_view(&setup.board, image), &windows, &counter)
                }
                Method::Precise => {
                    let image = Answered::new(size.0, size.1, outcome.display.as_ref().map(BlinkClock::of));
                    event_views(part, image, &|image| precise::event_view(&setup.board, image), &windows, &counter)
                }
            });
        }
    }
    put(&mut seen.views, Camera::Rgb, frames);
    put(&mut seen.views, Camera::Event, events);
    if parts.len() > 1
        && let Some(timing) = &mut seen.timing
    {
        timing.notes.push(format!("resumed {} times: each part has a clock offset of its own", parts.len() - 1));
    }
    count_lost_views(shots.iter().flatten(), setup, &mut seen);
    seen
}

/// The corners that the source of an import declares; `None` where it has images and events to look at.
fn declared_views(outcome: &Outcome) -> Option<Vec<BTreeMap<Camera, View>>> {
    let views = |record: &PoseRecord| {
        let captured = record.capture.and_then(|capture| outcome.captures.get(capture));
        captured.and_then(|captured| captured.declared.as_ref()).map(|d| d.views.clone()).unwrap_or_default()
    };
    let views: Vec<_> = outcome.poses.iter().map(views).collect();
    views.iter().any(|views| !views.is_empty()).then_some(views)
}

/// All that the events of a pose's windows give, in one image; signed where the display was watched.
///
/// # Errors
/// A sentence, for a recording that does not replay, a pose that is not there, and one without events.
pub fn accumulated(recording: &Recording, pose_id: &str) -> Result<Accumulated, String> {
    let setup = Setup::of_recording(recording).map_err(|why| why.to_string())?;
    let outcome = super::solve::replay(recording, &setup).map_err(|why| why.to_string())?;
    let known = || setup.poses.iter().map(|(id, _)| id.as_str()).collect::<Vec<_>>().join(", ");
    let pose = setup.poses.iter().position(|(id, _)| id == pose_id);
    let pose = pose.ok_or_else(|| format!("there is no pose {pose_id}; the poses are {}", known()))?;
    let event = setup.cameras.get(&Camera::Event).ok_or("the session has no event camera")?;
    let clock = outcome.display.as_ref().map(BlinkClock::of);
    let all = Accumulated::new(event.width as u16, event.height as u16, clock);
    let mut seen = Seen { views: Vec::new(), timing: None, problems: Vec::new() };
    let mut within = Within { windows: Vec::new(), all };
    for part in parts(recording) {
        let windows = event_windows(&part, &setup, &part.shots(&outcome), &outcome, &mut seen);
        within.windows = windows.into_iter().filter(|(of, _)| *of == pose).map(|(_, window)| window).collect();
        if !within.windows.is_empty() {
            decode(&part, &mut within, &mut |_, _| ())?;
            return Ok(within.all);
        }
    }
    seen.problems.push(format!("pose {pose_id} has no event window"));
    Err(seen.problems.join("; "))
}

/// Events inside some windows.
struct Within {
    windows: Vec<Window>,
    all: Accumulated,
}

impl Sink for Within {
    fn event(&mut self, event: Event) {
        if self.windows.iter().any(|w| (w.start_us..w.end_us).contains(&event.t_us)) {
            self.all.event(event);
        }
    }

    fn trigger(&mut self, _trigger: Trigger) {}
}

/// What was recorded without a break: a resumed session has more than one part, each with its own event clock.
pub(super) struct Part<'a> {
    pub(super) entries: &'a [Entry],
    /// Whether the first packets begin in the middle of a stream, stamped with their arrival.
    pub(super) joins: bool,
    /// Captures in the parts before.
    pub(super) captures_before: usize,
}

fn parts(recording: &Recording) -> Vec<Part<'_>> {
    let joins = recording.about.kind == Kind::Live;
    let mut captures_before = 0;
    let split = recording.entries.split(|entry| matches!(entry, Entry::Input(_, Input::Resumed)));
    let part = |entries: &'_ [Entry]| {
        let count = entries.iter().filter(|e| matches!(e, Entry::Input(_, Input::Captured(_)))).count();
        captures_before += count;
        captures_before - count
    };
    let before: Vec<usize> = split.clone().map(part).collect();
    split.zip(before).map(|(entries, captures_before)| Part { entries, joins, captures_before }).collect()
}

/// A camera that must have seen a pose but gave nothing has seen no corner there: it counts as missed.
fn count_lost_views<'a>(shots: impl Iterator<Item = &'a Shot<'a>>, setup: &Setup, seen: &mut Seen) {
    for shot in shots {
        let Some((pose, views)) = shot.pose.and_then(|p| Some((p, seen.views.get_mut(p)?))) else { continue };
        for camera in setup.cameras.keys() {
            let expected = *camera == Camera::Event || shot.exposure.image;
            if expected && !views.contains_key(camera) {
                views.insert(*camera, View::default());
                seen.problems.push(format!(
                    "pose {}: nothing usable of the {camera} camera is in the recording",
                    setup.poses[pose].0
                ));
            }
        }
    }
}

/// Counts looked-at images for the progress display.
struct Counter<'a> {
    done: std::sync::atomic::AtomicUsize,
    total: usize,
    progress: &'a (dyn Fn(usize, usize) + Sync),
}

impl<'a> Counter<'a> {
    fn new<'s>(
        shots: impl Iterator<Item = &'s Shot<'s>>,
        setup: &Setup,
        progress: &'a (dyn Fn(usize, usize) + Sync),
    ) -> Self {
        let counted = shots.filter(|s| s.pose.is_some()).count();
        let total = counted * setup.cameras.len();
        Self { done: 0.into(), total, progress }
    }

    fn step(&self) {
        let done = self.done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
        (self.progress)(done, self.total);
    }
}

impl<'a> Part<'a> {
    /// Every exposure in order, with its image; the images of a capture stand before it in the recording.
    fn shots(&self, outcome: &Outcome) -> Vec<Shot<'a>> {
        let mut images = Vec::new();
        let (mut shots, mut capture) = (Vec::new(), self.captures_before);
        for entry in self.entries {
            match entry {
                Entry::Image(at, bytes) => images.push((*at, bytes.as_slice())),
                Entry::Input(_, Input::Captured(captured)) => {
                    let record = outcome.poses.get(captured.pose).filter(|r| r.capture == Some(capture));
                    for exposure in &captured.exposures {
                        let still = record.and_then(|r| r.evidence.as_ref()).is_none_or(|e| {
                            // Half a nanosecond of slack: recorded times are whole nanoseconds.
                            exposure.start_s >= e.from_s - 5e-10 && exposure.end_s <= e.to_s + 5e-10
                        });
                        let pose = (record.is_some() && still && !exposure.closing).then_some(captured.pose);
                        // By its stamp: where a record is lost, the images of another capture must not slip in.
                        let at = Stamp::from_seconds(exposure.start_s);
                        let image =
                            images.iter().find(|(stamp, _)| exposure.image && *stamp == at).map(|(_, bytes)| *bytes);
                        shots.push(Shot { pose, taken_at: captured.pose, exposure: *exposure, image });
                    }
                    images.clear();
                    capture += 1;
                }
                Entry::Input(..) | Entry::Command(_) | Entry::Events(_) => {}
            }
        }
        shots
    }
}

fn frame_views(
    shots: &[Shot<'_>],
    setup: &Setup,
    counter: &Counter<'_>,
    problems: &mut Vec<String>,
) -> Vec<(usize, View)> {
    let Some(camera) = setup.cameras.get(&Camera::Rgb) else { return Vec::new() };
    let wanted: Vec<_> = shots.iter().filter_map(|s| Some((s.pose?, s.image?))).collect();
    let look = |(pose, bytes): &(usize, &[u8])| -> Result<(usize, View), String> {
        let named = |why: String| format!("pose {}: the image cannot be used: {why}", setup.poses[*pose].0);
        let image = codec::decode_gray(bytes).map_err(|e| named(e.to_string()))?;
        if (image.width, image.height) != (camera.width as usize, camera.height as usize) {
            let (w, h) = (image.width, image.height);
            return Err(named(format!("it is {w}x{h}, the camera is declared as {}x{}", camera.width, camera.height)));
        }
        let view = match setup.settings.method {
            Method::Paper => vision::frame_view(&setup.board, &image),
            Method::Precise => precise::frame_view(&setup.board, &image),
        };
        let view = view.map_err(|e| named(e.to_string()))?;
        counter.step();
        Ok((*pose, view))
    };
    let looked: Vec<_> = wanted.par_iter().map(look).collect();
    let mut views = Vec::new();
    for result in looked {
        match result {
            Ok(view) => views.push(view),
            Err(problem) => problems.push(problem),
        }
    }
    views
}

/// Fuses the views of each pose; order of poses, whatever the order of the images.
fn put(all: &mut [BTreeMap<Camera, View>], camera: Camera, views: Vec<(usize, View)>) {
    let mut by_pose: BTreeMap<usize, Vec<View>> = BTreeMap::new();
    for (pose, view) in views {
        by_pose.entry(pose).or_default().push(view);
    }
    for (pose, views) in by_pose {
        if let Some(slot) = all.get_mut(pose) {
            slot.insert(camera, vision::fuse(&views));
        }
    }
}

/// What the events of a window become.
trait WindowImage: Sink {
    type Image: Send + Sync;

    /// The image of the window, and nothing left for the next one.
    fn take(&mut self) -> Self::Image;
}

impl WindowImage for LastPolarity {
    type Image = GrayImage;

    fn take(&mut self) -> GrayImage {
        let image = self.image();
        self.clear();
        image
    }
}

impl WindowImage for Answered {
    type Image = FloatImage;

    fn take(&mut self) -> FloatImage {
        let image = self.image();
        self.clear();
        image
    }
}

fn event_views<W: WindowImage>(
    part: &Part<'_>,
    image: W,
    view: &(dyn Fn(&W::Image) -> Result<View, CvError> + Sync),
    windows: &[(usize, Window)],
    counter: &Counter<'_>,
) -> Vec<(usize, View)> {
    let look = |batch: Batch<W::Image>| -> Vec<(usize, View)> {
        let one = |(pose, image): &(usize, W::Image)| {
            let view = view(image).unwrap_or_default();
            counter.step();
            (*pose, view)
        };
        batch.par_iter().map(one).collect()
    };
    let mut sink = Windows { windows, next: 0, image, batch: Vec::new(), views: Vec::new(), look: &look };
    // Whatever could be decoded is used; an unknown encoding was reported with the triggers.
    let _ = decode(part, &mut sink, &mut |_, _| ());
    sink.finish()
}

/// Images detected at once: enough for every core, few enough for the memory.
const BATCH: usize = 8;

/// Event images with the pose that each observes.
type Batch<I> = Vec<(usize, I)>;

/// Accumulates the events of each window into an image.
struct Windows<'a, W: WindowImage> {
    windows: &'a [(usize, Window)],
    next: usize,
    image: W,
    batch: Batch<W::Image>,
    views: Vec<(usize, View)>,
    look: &'a dyn Fn(Batch<W::Image>) -> Vec<(usize, View)>,
}

impl<W: WindowImage> Windows<'_, W> {
    fn close(&mut self) {
        self.batch.push((self.windows[self.next].0, self.image.take()));
        self.next += 1;
        if self.batch.len() >= BATCH {
            let batch = std::mem::take(&mut self.batch);
            self.views.extend((self.look)(batch));
        }
    }

    fn finish(mut self) -> Vec<(usize, View)> {
        while self.next < self.windows.len() {
            self.close();
        }
        let batch = std::mem::take(&mut self.batch);
        self.views.extend((self.look)(batch));
        self.views
    }
}

impl<W: WindowImage> Sink for Windows<'_, W> {
    fn event(&mut self, event: Event) {
        while self.windows.get(self.next).is_some_and(|(_, w)| event.t_us >= w.end_us) {
            self.close();
        }
        if self.windows.get(self.next).is_some_and(|(_, w)| event.t_us >= w.start_us) {
            self.image.event(event);
        }
    }

    fn trigger(&mut self, _trigger: Trigger) {}
}
