//! Which images and which robot poses belong together: the poses of the session.

use super::robot::{self, RobotAt};
use super::survey::Survey;
use crate::calibration::settings::PoseKind;
use crate::config::{ImageTopic, StampOf, Stops, Topics, TopicsMode};
use crate::recording::import::error::{ImportError, Place};
use crate::session::{Declared, Exposure};

/// A pose of the session.
#[derive(Debug)]
pub(super) struct Stop {
    /// Its id.
    pub(super) id: String,
    /// What it is for.
    pub(super) kind: PoseKind,
    /// What the bag says about it.
    pub(super) declared: Declared,
    /// Its exposures in order of time; also those on the way to it, which no image is kept of.
    pub(super) exposures: Vec<Exposed>,
}

/// An exposure and where its image is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Exposed {
    /// When, seconds since the origin.
    pub(super) exposure: Exposure,
    /// Which of the images of the bag, in order of the file.
    pub(super) image: usize,
}

/// The poses of a bag and what was passed over.
#[derive(Debug)]
pub(super) struct Found {
    /// In order of time; at least one.
    pub(super) stops: Vec<Stop>,
    /// Seconds of the clock of the stamps at which the session begins.
    pub(super) origin_s: u64,
    /// In words.
    pub(super) notices: Vec<String>,
}

/// Finds the poses.
pub(super) fn find(survey: &Survey, map: &Topics, name: &str) -> Result<Found, ImportError> {
    let stamps = survey.images_ns.iter().chain(survey.packets.iter().map(|packet| &packet.stamp_ns));
    let first_ns = stamps.chain(survey.robot.iter().map(|sample| &sample.stamp_ns)).min().copied().unwrap_or(0);
    // A whole second before the first exposure: as small numbers, times keep their nanoseconds.
    let lead_s = map.rgb.as_ref().map_or(0.0, |rgb| rgb.exposure_s).ceil() as u64;
    let origin_s = (first_ns / 1_000_000_000).saturating_sub(lead_s);
    let clock = Clock { origin_ns: origin_s * 1_000_000_000 };
    let mut notices = Vec::new();
    let exposed = map.rgb.as_ref().map(|rgb| exposed(survey, rgb, clock, &mut notices)).unwrap_or_default();
    let mut stops = match &map.stops {
        Stops::EachImage => each_image(&exposed),
        Stops::Still(rule) => {
            let still = robot::still(&survey.robot, rule);
            let ids = (1..).map(|i| format!("stop-{i:03}"));
            let kind = if map.mode == TopicsMode::Handeye { PoseKind::HandEye } else { PoseKind::Intrinsics };
            still.into_iter().zip(ids).map(|(time, id)| stop(id, kind, time, &survey.robot, clock)).collect()
        }
        Stops::Intervals(list) => {
            let ns = |s: f64| (s * 1e9).round() as u64;
            let one = |i: &crate::config::Interval| {
                stop(i.id.clone(), i.kind, [ns(i.from_s), ns(i.to_s)], &survey.robot, clock)
            };
            list.iter().map(one).collect()
        }
    };
    check_robot(&stops, map, name)?;
    if map.stops != Stops::EachImage {
        spread(&mut stops, &exposed, &mut notices);
    }
    if map.rgb.is_some() {
        drop_blind(&mut stops, &mut notices);
    }
    if stops.is_empty() {
        return Err(Place::file(name).wrong(nothing(survey, map)));
    }
    Ok(Found { stops, origin_s, notices })
}

/// The clock of the session.
#[derive(Debug, Clone, Copy)]
struct Clock {
    origin_ns: u64,
}

impl Clock {
    fn seconds(self, stamp_ns: u64) -> f64 {
        stamp_ns.saturating_sub(self.origin_ns) as f64 * 1e-9
    }
}

/// All exposures in order of time; of those with one stamp only the first.
fn exposed(survey: &Survey, rgb: &ImageTopic, clock: Clock, notices: &mut Vec<String>) -> Vec<Exposed> {
    let mut all: Vec<(u64, usize)> = survey.images_ns.iter().copied().zip(0..).collect();
    all.sort_unstable();
    all.dedup_by_key(|(stamp_ns, _)| *stamp_ns);
    let doubled = survey.images_ns.len() - all.len();
    if doubled > 0 {
        notices.push(format!("{doubled} images on {} have the stamp of another one and are left out", rgb.topic));
    }
    let one = |(stamp_ns, image): (u64, usize)| {
        let at_s = clock.seconds(stamp_ns);
        let start_s = if rgb.stamp == StampOf::ExposureStart { at_s } else { at_s - rgb.exposure_s };
        Exposed { exposure: Exposure::whole(start_s, start_s + rgb.exposure_s), image }
    };
    all.into_iter().map(one).collect()
}

fn each_image(exposed: &[Exposed]) -> Vec<Stop> {
    let one = |(i, exposed): (usize, &Exposed)| Stop {
        id: format!("image-{:03}", i + 1),
        kind: PoseKind::Intrinsics,
        declared: Declared::default(),
        exposures: vec![*exposed],
    };
    exposed.iter().enumerate().map(one).collect()
}

fn stop(id: String, kind: PoseKind, time_ns: [u64; 2], robot: &[RobotAt], clock: Clock) -> Stop {
    let mean = robot::mean(robot, time_ns);
    let declared = Declared {
        still_s: Some(time_ns.map(|ns| clock.seconds(ns))),
        base_from_tcp: mean.map(|mean| mean.base_from_tcp),
        joints_rad: mean.and_then(|mean| mean.joints_rad),
        ..Declared::default()
    };
    Stop { id, kind, declared, exposures: Vec::new() }
}

/// A declared interval of a hand-eye recording needs the arm.
fn check_robot(stops: &[Stop], map: &Topics, name: &str) -> Result<(), ImportError> {
    let lacks = |stop: &&Stop| stop.kind != PoseKind::Intrinsics && stop.declared.base_from_tcp.is_none();
    match stops.iter().find(lacks) {
        Some(stop) if map.mode == TopicsMode::Handeye => Err(Place::file(name).wrong(format!(
            "has no sample of the robot in the interval of `{}`; are from_s and to_s on the clock of the stamps?",
            stop.id
        ))),
        _ => Ok(()),
    }
}

/// Gives each exposure to the stop that it was made at, or to the next one without keeping its image: it still has an
/// edge at the trigger input.
fn spread(stops: &mut [Stop], exposed: &[Exposed], notices: &mut Vec<String>) {
    let mut outside = 0;
    for &Exposed { exposure, image } in exposed {
        let inside = |stop: &Stop| {
            stop.declared.still_s.is_some_and(|[from_s, to_s]| exposure.start_s >= from_s && exposure.end_s <= to_s)
        };
        let next = |stop: &Stop| stop.declared.still_s.is_some_and(|[_, to_s]| exposure.start_s < to_s);
        let last = stops.len().saturating_sub(1);
        let at = stops.iter().position(inside);
        let (place, kept) = at.map_or((stops.iter().position(next).unwrap_or(last), false), |at| (at, true));
        outside += usize::from(!kept);
        if let Some(stop) = stops.get_mut(place) {
            stop.exposures.push(Exposed { exposure: Exposure { image: kept, ..exposure }, image });
        }
    }
    if outside > 0 {
        notices.push(format!("{outside} of {} images were taken outside every stop and are left out", exposed.len()));
    }
}

/// Drops stops without an image; their exposures count for the trigger edges of the next one.
fn drop_blind(stops: &mut Vec<Stop>, notices: &mut Vec<String>) {
    let (mut kept, mut blind, mut waiting): (Vec<Stop>, _, Vec<Exposed>) = (Vec::new(), Vec::new(), Vec::new());
    for mut stop in std::mem::take(stops) {
        if stop.exposures.iter().any(|e| e.exposure.image) {
            stop.exposures.splice(0..0, waiting.drain(..));
            kept.push(stop);
        } else {
            waiting.append(&mut stop.exposures);
            blind.push(stop.id);
        }
    }
    if let Some(last) = kept.last_mut() {
        last.exposures.append(&mut waiting);
    }
    if !blind.is_empty() {
        let some = super::super::some_of(&blind);
        notices.push(format!("{} stops have no image and are left out: {some}", blind.len()));
    }
    *stops = kept;
}

/// Why there is no pose at all.
fn nothing(survey: &Survey, map: &Topics) -> String {
    let (images, samples) = (survey.images_ns.len(), survey.robot.len());
    match &map.stops {
        Stops::EachImage => "has no image; there is no pose to import".into(),
        Stops::Intervals(_) => format!(
            "has no image wholly inside a declared interval ({images} images): are from_s and to_s seconds on the clock \
             of the stamps, as `ros2 topic echo` shows them?"
        ),
        Stops::Still(rule) => format!(
            "has no stop of at least {} s with an image wholly inside it ({images} images, {samples} samples of the \
             robot): relax stops.still, or declare intervals",
            rule.hold_s
        ),
    }
}
