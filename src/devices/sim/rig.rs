//! The two simulated cameras as drivers, joined by their trigger wire.
//!
//! The frame camera is the master: it exposes at a steady rate, or once for every trigger. The event camera has its
//! own clock, off by seconds and some parts per million, and sends its words in packets that come a little late.

use std::sync::{Arc, Mutex, PoisonError};

use super::hand::HandPath;
use super::scene::Scene;
use super::ur::{SimClock, Truth};
use crate::config::FrameTrigger;
use crate::devices::{
    CameraError, CameraFacts, Clock as _, EventCamera, FrameCamera, FrameImage, PRE_ROLL_S, RawEvents,
};
use crate::events::sync::ClockMap;
use crate::events::{EncodeError, Encoder, Event, Format, Trigger};
use crate::geometry::{self, Base, Camera, Flange, Rgb, Target, Transform};
use crate::image::GrayImage;
use crate::session::{Exposure, Stamp};

/// Length of the closing pulse, s.
const CLOSING_PULSE_S: f64 = 0.001;
/// From a trigger to the begin of its exposure, s.
const TRIGGER_DELAY_S: f64 = 50e-6;
/// Length of a packet of events, and how late packets come, s.
const PACKET_S: f64 = 0.02;
const LATENCY_S: [f64; 2] = [0.0015, 0.006];
/// Events are recorded to this long after the closing edge, s.
const MARGIN_S: f64 = 0.004;

/// Where the simulated cameras and the display truly are.
#[derive(Debug, Clone, Copy)]
pub enum Placement {
    /// The arm carries the display.
    CarriedTarget {
        /// The frame camera in the cell.
        rgb_from_base: Transform<Rgb, Base>,
        /// The event camera in the cell.
        event_from_base: Transform<geometry::Event, Base>,
        /// The display on the arm.
        flange_from_target: Transform<Flange, Target>,
    },
    /// The arm carries the cameras.
    CarriedCameras {
        /// The frame camera on the arm.
        rgb_from_flange: Transform<Rgb, Flange>,
        /// The event camera on the arm.
        event_from_flange: Transform<geometry::Event, Flange>,
        /// The display in the cell.
        base_from_target: Transform<Base, Target>,
    },
}

impl Placement {
    /// The board before the frame camera with the flange here.
    pub fn rgb_from_target(&self, base_from_flange: Transform<Base, Flange>) -> Transform<Rgb, Target> {
        match *self {
            Self::CarriedTarget { rgb_from_base, flange_from_target, .. } => {
                rgb_from_base * base_from_flange * flange_from_target
            }
            Self::CarriedCameras { rgb_from_flange, base_from_target, .. } => {
                rgb_from_flange * base_from_flange.inverse() * base_from_target
            }
        }
    }

    /// The board before the event camera with the flange here.
    pub fn event_from_target(&self, base_from_flange: Transform<Base, Flange>) -> Transform<geometry::Event, Target> {
        match *self {
            Self::CarriedTarget { event_from_base, flange_from_target, .. } => {
                event_from_base * base_from_flange * flange_from_target
            }
            Self::CarriedCameras { event_from_flange, base_from_target, .. } => {
                event_from_flange * base_from_flange.inverse() * base_from_target
            }
        }
    }
}

/// Where what is carried truly is.
pub enum Whereabouts {
    /// On the arm.
    Arm(Box<Truth>),
    /// In the hand of an operator: the flange of [`Placement`].
    Hand(HandPath),
    /// On an arm that stands still for ever.
    Still(Transform<Base, Flange>),
}

impl Whereabouts {
    fn base_from_flange_at(&self, at_s: f64) -> Option<Transform<Base, Flange>> {
        match self {
            Self::Arm(truth) => truth.base_from_flange_at(at_s),
            Self::Hand(path) => path.base_from_flange_at(at_s),
            Self::Still(base_from_flange) => Some(*base_from_flange),
        }
    }

    /// From when on it is known, s.
    fn oldest_s(&self) -> f64 {
        match self {
            Self::Arm(truth) => truth.oldest_s().unwrap_or(0.0),
            Self::Hand(_) | Self::Still(_) => 0.0,
        }
    }

    /// When a digital output went on, after a simulated time, s.
    fn rises(&self, output: u8, after_s: f64) -> Vec<f64> {
        match self {
            Self::Arm(truth) => truth.rises(output, after_s),
            Self::Hand(_) | Self::Still(_) => Vec::new(),
        }
    }
}

/// What both cameras share.
pub struct Rig {
    /// Display and sensors.
    pub scene: Scene,
    /// Where everything truly is.
    pub placement: Placement,
    /// Where arm or hand truly are.
    pub truth: Whereabouts,
    /// Simulated time.
    pub clock: SimClock,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// From one exposure to the next, s.
    pub period_s: f64,
    /// What begins an exposure.
    pub trigger: FrameTrigger,
    /// Whether the exposures drive the trigger input of the event camera.
    pub wired: bool,
    /// Start of some exposure, s.
    pub phase_s: f64,
    /// Event clock at simulated time 0, s.
    pub event_offset_s: f64,
    /// How much faster the event clock runs, ppm.
    pub event_drift_ppm: f64,
    /// Trigger input of the event camera.
    pub trigger_channel: u8,
    /// Image size of the frame camera, pixels.
    pub frame_size: [u32; 2],
    /// Sensor size of the event camera, pixels.
    pub event_size: [u32; 2],
    /// Exposures of the capture that is going on.
    pub burst: Mutex<Vec<Exposure>>,
}

impl Rig {
    /// The next `images` exposures that begin after now, at the camera's own rate.
    fn next_free(&self, images: u32) -> Vec<Exposure> {
        let now_s = self.clock.seconds() + 1e-6;
        let first = ((now_s - self.phase_s) / self.period_s).ceil();
        let start = |i: u32| self.phase_s + (first + f64::from(i)) * self.period_s;
        (0..images).map(|i| Exposure::whole(start(i), start(i) + self.exposure_s)).collect()
    }

    /// Exposures that begin at these times; the last one of a whole capture only ends the window before.
    fn triggered(&self, starts_s: impl Iterator<Item = f64>, images: u32) -> Vec<Exposure> {
        let exposure = |(i, start_s): (usize, f64)| {
            let (start_s, end_s) = (start_s + TRIGGER_DELAY_S, start_s + TRIGGER_DELAY_S + self.exposure_s);
            if i < images as usize { Exposure::whole(start_s, end_s) } else { Exposure::closing(start_s, end_s) }
        };
        starts_s.take(images as usize + 1).enumerate().map(exposure).collect()
    }

    fn set_burst(&self, exposures: &[Exposure]) {
        *self.burst.lock().unwrap_or_else(PoisonError::into_inner) = exposures.to_vec();
    }

    fn burst(&self) -> Vec<Exposure> {
        self.burst.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The edge that ends the last window of a burst, s: a triggered camera exposes once more, a free running one
    /// gives a short pulse.
    fn closing_s(&self, burst: &[Exposure]) -> Option<f64> {
        let last = burst.last()?;
        Some(if last.closing { last.start_s } else { last.start_s + self.period_s })
    }

    fn is_over(&self, burst: &[Exposure]) -> bool {
        let closed = self.closing_s(burst).is_some_and(|closing_s| self.clock.seconds() >= closing_s + 2.0 * MARGIN_S);
        closed && burst.last().is_some_and(|last| self.clock.seconds() >= last.end_s)
    }

    /// True pose of the flange in the middle of an interval.
    fn flange_at(&self, at_s: f64, camera: Camera) -> Result<Transform<Base, Flange>, CameraError> {
        let why = || format!("the simulated arm has no true pose at {at_s:.3} s");
        self.truth.base_from_flange_at(at_s).ok_or_else(|| CameraError::Failed { camera, why: why() })
    }

    /// What the frame camera takes from one time to another, s.
    pub(super) fn image(&self, start_s: f64, end_s: f64) -> Result<GrayImage, CameraError> {
        let pose = self.placement.rgb_from_target(self.flange_at(0.5 * (start_s + end_s), Camera::Rgb)?);
        Ok(self.scene.expose(&pose, start_s, end_s - start_s))
    }

    fn sensor_us(&self, host_us: i64) -> i64 {
        let rate = 1.0 + self.event_drift_ppm * 1e-6;
        (self.event_offset_s * 1e6 + host_us as f64 * rate).round() as i64
    }

    /// The inverse of [`Rig::sensor_us`] without its rounding.
    pub(super) fn host_from_event_clock(&self) -> ClockMap {
        let rate = 1.0 + self.event_drift_ppm * 1e-6;
        ClockMap { offset_s: -self.event_offset_s / rate, ppm: (1.0 / rate - 1.0) * 1e6 }
    }

    /// The exposures of a free running camera between two times besides those of a burst.
    fn around(&self, burst: &[Exposure], from_s: f64, to_s: f64) -> Vec<Exposure> {
        let Some((first, last)) = burst.first().zip(burst.last()) else { return self.on_grid(from_s, to_s) };
        let before = ((first.start_s - from_s) / self.period_s).floor().max(0.0) as u32;
        let after = ((to_s - last.start_s) / self.period_s).floor().max(0.0) as u32;
        let early = (1..=before).map(|i| first.start_s - f64::from(i) * self.period_s);
        let late = (1..=after).map(|i| last.start_s + f64::from(i) * self.period_s);
        early.chain(late).map(|start_s| Exposure::whole(start_s, start_s + self.exposure_s)).collect()
    }

    /// The exposures of a free running camera that begin between two times, or just before.
    fn on_grid(&self, from_s: f64, to_s: f64) -> Vec<Exposure> {
        let number = |at_s: f64| ((at_s - self.phase_s) / self.period_s).floor() as i64;
        let start_s = |i: i64| self.phase_s + i as f64 * self.period_s;
        (number(from_s)..=number(to_s)).map(|i| Exposure::whole(start_s(i), start_s(i) + self.exposure_s)).collect()
    }

    /// What the trigger input sees between two times, in order.
    fn edges(&self, burst: &[Exposure], alone: bool, from_s: f64, to_s: f64) -> Vec<Trigger> {
        if !self.wired {
            return Vec::new();
        }
        let edge = |host_s: f64, rising: bool| {
            let t_us = self.sensor_us((host_s * 1e6).round() as i64);
            Trigger { t_us, channel: self.trigger_channel, rising }
        };
        // A camera that runs freely exposes all the time; a triggered one exposes once more in the burst itself, and a
        // generator closes with a short pulse.
        let free = self.trigger == FrameTrigger::FreeRun && !alone;
        let around = if free { self.around(burst, from_s, to_s) } else { Vec::new() };
        let all = around.iter().chain(burst);
        let mut edges: Vec<_> = all.flat_map(|e| [(e.start_s, true), (e.end_s, false)]).collect();
        if let Some(closing_s) = self.closing_s(burst).filter(|_| alone) {
            edges.extend([(closing_s, true), (closing_s + CLOSING_PULSE_S, false)]);
        }
        edges.retain(|(host_s, _)| (from_s..to_s).contains(host_s));
        edges.sort_by(|a, b| a.0.total_cmp(&b.0));
        edges.into_iter().map(|(host_s, rising)| edge(host_s, rising)).collect()
    }
}

/// The simulated frame camera.
pub struct SimFrameCamera {
    rig: Arc<Rig>,
    /// Images of the capture that is going on.
    waiting: Option<u32>,
    /// When it was asked for, and pulses that were asked for since, s.
    begun_s: f64,
    pulses: usize,
}

impl SimFrameCamera {
    /// A frame camera of the rig.
    pub fn new(rig: Arc<Rig>) -> Self {
        Self { rig, waiting: None, begun_s: 0.0, pulses: 0 }
    }

    /// Exposures that pulses of the robot's output have begun.
    fn pulsed(&self, output: u8, images: u32) -> Vec<Exposure> {
        self.rig.triggered(self.rig.truth.rises(output, self.begun_s).into_iter(), images)
    }

    fn image(&self, exposure: &Exposure) -> Result<FrameImage, CameraError> {
        if exposure.closing {
            return Ok(FrameImage { exposure: *exposure, image: None });
        }
        let image = self.rig.image(exposure.start_s, exposure.end_s)?;
        Ok(FrameImage { exposure: *exposure, image: Some(image) })
    }
}

impl FrameCamera for SimFrameCamera {
    fn facts(&self) -> CameraFacts {
        CameraFacts { model: "simulated frame camera".into(), ..CameraFacts::default() }
    }

    fn size(&self) -> [u32; 2] {
        self.rig.frame_size
    }

    fn begin(&mut self, images: u32) -> Result<(), CameraError> {
        (self.waiting, self.begun_s, self.pulses) = (Some(images), self.rig.clock.seconds(), 0);
        let starts = |i: u32| self.begun_s + f64::from(i) * self.rig.period_s;
        self.rig.set_burst(&match self.rig.trigger {
            FrameTrigger::FreeRun => self.rig.next_free(images),
            FrameTrigger::Software => self.rig.triggered((0..=images).map(starts), images),
            FrameTrigger::RobotOutput(_) => Vec::new(),
        });
        Ok(())
    }

    fn poll(&mut self) -> Result<Option<Vec<FrameImage>>, CameraError> {
        let Some(images) = self.waiting else { return Ok(None) };
        if let FrameTrigger::RobotOutput(output) = self.rig.trigger {
            let pulsed = self.pulsed(output, images);
            self.rig.set_burst(&pulsed);
            if pulsed.len() <= images as usize {
                return Ok(None);
            }
        }
        let burst = self.rig.burst();
        if !self.rig.is_over(&burst) {
            return Ok(None);
        }
        self.waiting = None;
        burst.iter().map(|exposure| self.image(exposure)).collect::<Result<_, _>>().map(Some)
    }

    fn wants_pulse(&mut self) -> bool {
        let (Some(images), FrameTrigger::RobotOutput(output)) = (self.waiting, self.rig.trigger) else { return false };
        let pulsed = self.pulsed(output, images);
        let answered = pulsed.len() == self.pulses;
        let rested = pulsed.last().is_none_or(|last| self.rig.clock.seconds() >= last.start_s + self.rig.period_s);
        let wanted = answered && rested && pulsed.len() <= images as usize;
        self.pulses += usize::from(wanted);
        wanted
    }
}

/// A frame camera that is no part of the simulation, with its exposure signal on the simulated trigger wire.
///
/// It must keep the simulated time: its exposures are the edges that the simulated event camera sees.
pub struct WiredCamera {
    rig: Arc<Rig>,
    camera: Box<dyn FrameCamera>,
    /// Delivered, while the simulated time of the last window is not over.
    delivered: Option<Vec<FrameImage>>,
}

impl WiredCamera {
    /// Wires a camera to the rig.
    pub fn new(rig: Arc<Rig>, camera: Box<dyn FrameCamera>) -> Self {
        Self { rig, camera, delivered: None }
    }
}

impl FrameCamera for WiredCamera {
    fn facts(&self) -> CameraFacts {
        self.camera.facts()
    }

    fn size(&self) -> [u32; 2] {
        self.camera.size()
    }

    fn begin(&mut self, images: u32) -> Result<(), CameraError> {
        self.delivered = None;
        self.rig.set_burst(&[]);
        self.camera.begin(images)
    }

    fn poll(&mut self) -> Result<Option<Vec<FrameImage>>, CameraError> {
        if self.delivered.is_none() {
            self.delivered = self.camera.poll()?;
        }
        let Some(images) = &self.delivered else { return Ok(None) };
        let burst: Vec<_> = images.iter().map(|image| image.exposure).collect();
        self.rig.set_burst(&burst);
        Ok(if self.rig.is_over(&burst) { self.delivered.take() } else { None })
    }

    fn wants_pulse(&mut self) -> bool {
        self.camera.wants_pulse()
    }
}

/// The simulated event camera.
pub struct SimEventCamera {
    rig: Arc<Rig>,
    /// Where there is no frame camera the trigger input is driven by a pulse generator.
    alone: Option<u32>,
    encoder: Encoder,
    /// What is handed over next begins here, s.
    from_s: f64,
    /// Transfers so far.
    sent: u64,
}

impl SimEventCamera {
    /// An event camera of the rig; `alone` is the number of trigger pulses where no frame camera gives them.
    pub fn new(rig: Arc<Rig>, alone: Option<u32>) -> Self {
        Self { rig, alone, encoder: Encoder::new(Format::Evt3), from_s: 0.0, sent: 0 }
    }
}

impl EventCamera for SimEventCamera {
    fn facts(&self) -> CameraFacts {
        CameraFacts { model: "simulated event camera".into(), ..CameraFacts::default() }
    }

    fn size(&self) -> [u32; 2] {
        self.rig.event_size
    }

    fn encoding(&self) -> &'static str {
        "evt3"
    }

    fn begin(&mut self) -> Result<(), CameraError> {
        // It runs before a capture already; before the session nothing is known, and nothing is sent twice.
        self.from_s = (self.rig.clock.seconds() - PRE_ROLL_S).max(self.from_s);
        // The frame camera begins after us, if it does.
        let burst = self.alone.map(|pulses| self.rig.next_free(pulses)).unwrap_or_default();
        self.rig.set_burst(&burst);
        Ok(())
    }

    fn take(&mut self) -> Result<Vec<RawEvents>, CameraError> {
        self.from_s = self.from_s.max(self.rig.truth.oldest_s());
        // Whole transfers that have arrived.
        let transfers = ((self.rig.clock.seconds() - LATENCY_S[1] - self.from_s) / PACKET_S).floor();
        if transfers >= 1.0 { self.until(self.from_s + transfers * PACKET_S) } else { Ok(Vec::new()) }
    }

    fn end(&mut self) -> Result<Vec<RawEvents>, CameraError> {
        let closing_s = self.rig.closing_s(&self.rig.burst());
        self.until(closing_s.map_or(self.rig.clock.seconds(), |closing_s| closing_s + MARGIN_S))
    }
}

impl SimEventCamera {
    /// What was not handed over yet, to a time, s.
    fn until(&mut self, to_s: f64) -> Result<Vec<RawEvents>, CameraError> {
        let burst = self.rig.burst();
        let failed = |why: String| CameraError::Failed { camera: Camera::Event, why };
        let from_s = self.from_s.max(self.rig.truth.oldest_s());
        self.from_s = to_s;
        let base_from_flange = self.rig.flange_at(0.5 * (from_s + to_s), Camera::Event)?;
        let pose = self.rig.placement.event_from_target(base_from_flange);
        let mut events = self.rig.scene.events(&pose, from_s, to_s);
        for Event { t_us, .. } in &mut events {
            *t_us = self.rig.sensor_us(*t_us);
        }
        let edges = self.rig.edges(&burst, self.alone.is_some(), from_s, to_s);
        self.encoder.restart();
        self.packets(&events, &edges, [from_s, to_s]).map_err(|e| failed(e.to_string()))
    }

    /// Words in transfers of 20 ms, each a little late, as a bus delivers them.
    fn packets(
        &mut self,
        events: &[Event],
        edges: &[Trigger],
        span_s: [f64; 2],
    ) -> Result<Vec<RawEvents>, EncodeError> {
        let [from_s, to_s] = span_s;
        let now = self.rig.clock.now();
        let (mut packets, mut first_event, mut first_edge) = (Vec::new(), 0, 0);
        let count = ((to_s - from_s) / PACKET_S).ceil().max(1.0) as usize;
        for i in 1..=count {
            let end_s = if i == count { f64::INFINITY } else { from_s + i as f64 * PACKET_S };
            let end_us = self.rig.sensor_us((end_s * 1e6) as i64);
            let event = if i == count { events.len() } else { events.partition_point(|e| e.t_us < end_us) };
            let edge = if i == count { edges.len() } else { edges.partition_point(|e| e.t_us < end_us) };
            let (of_events, of_edges) = (&events[first_event..event], &edges[first_edge..edge]);
            (first_event, first_edge) = (event, edge);
            let first_us = of_events.first().map(|e| e.t_us).into_iter().chain(of_edges.first().map(|e| e.t_us)).min();
            let Some(first_us) = first_us else { continue };
            let mut words = Vec::new();
            self.encoder.encode(of_events, of_edges, &mut words)?;
            self.sent += 1;
            let arrived_s = end_s.min(to_s) + LATENCY_S[0] + (LATENCY_S[1] - LATENCY_S[0]) * scattered(self.sent);
            packets.push(RawEvents { first_us, arrived: Stamp::from_seconds(arrived_s).min(now), words });
        }
        Ok(packets)
    }
}

/// Evenly scattered in 0..1, without chance.
fn scattered(i: u64) -> f64 {
    (i as f64 * 0.618_033_988_749_894_9).fract()
}
