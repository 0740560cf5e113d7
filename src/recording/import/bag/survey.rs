//! The first reading of a bag: everything but pixels and words, and whether it is what the map says.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::ops::ControlFlow;
use std::path::Path;

use sha2::{Digest as _, Sha256};

use super::messages::{self, Pixels};
use super::robot::{Model, RobotAt, Watched};
use crate::config::{EventTopic, ImageTopic, RobotTopic, Topics};
use crate::events::{Decoder, Event, Sink, Trigger};
use crate::recording::import::error::{ImportError, Place};
use crate::recording::import::source::io_error;
use crate::recording::scan::{self, Found, Message};

/// What a bag holds of what its map names.
#[derive(Debug, Default)]
pub(super) struct Survey {
    /// The program that wrote it.
    pub(super) library: String,
    /// SHA-256 of the file, hexadecimal.
    pub(super) sha256: String,
    /// What was lost, in words.
    pub(super) damage: Vec<String>,
    /// Stamps of the images in order of the file, nanoseconds.
    pub(super) images_ns: Vec<u64>,
    /// The packets of the event camera, in order of the file.
    pub(super) packets: Vec<PacketAt>,
    /// Rising edges by trigger input.
    pub(super) rising_edges: BTreeMap<u8, usize>,
    /// Packets that are missing between those that are there.
    pub(super) lost_packets: u64,
    /// Events outside the sensor.
    pub(super) outside: u64,
    /// The arm in order of time.
    pub(super) robot: Vec<RobotAt>,
    /// Messages by topic.
    topics: BTreeMap<String, usize>,
}

/// A packet, as far as the words need not be kept.
#[derive(Debug, Clone, Copy)]
pub(super) struct PacketAt {
    /// Stamp of its header, nanoseconds.
    pub(super) stamp_ns: u64,
    /// Sensor time at its begin, microseconds.
    pub(super) time_us: i64,
    /// Whether packets before it are missing.
    pub(super) after_gap: bool,
    /// Its words, bytes.
    pub(super) bytes: usize,
}

/// Reads the messages of a bag one by one; an error of `take` ends it. Says what was lost.
pub(super) fn each_message(
    path: &Path,
    name: &str,
    take: &mut dyn FnMut(&Message) -> Result<(), ImportError>,
) -> Result<(String, String, Vec<String>), ImportError> {
    let io = |why: std::io::Error| io_error(name, &why);
    let file = File::open(path).map_err(io)?;
    let length = file.metadata().map_err(io)?.len();
    let mut hashing = Hashing { inner: BufReader::new(file), sha: Sha256::new() };
    let (mut library, mut failed) = (String::new(), None);
    let damage = scan::walk(&mut hashing, length, &mut |found| {
        match found {
            Found::Library(by) => library = by,
            Found::Message(message) => failed = take(&message).err(),
            Found::Attachment(..) | Found::Metadata(..) => {}
        }
        if failed.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    if let Some(error) = failed {
        return Err(error);
    }
    std::io::copy(&mut hashing, &mut std::io::sink()).map_err(io)?;
    let sha256 = hashing.sha.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    Ok((library, sha256, damage))
}

/// Hashes what is read.
struct Hashing<R> {
    inner: R,
    sha: Sha256,
}

impl<R: Read> Read for Hashing<R> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        let count = self.inner.read(into)?;
        self.sha.update(&into[..count]);
        Ok(count)
    }
}

/// The error about a topic of the bag.
pub(super) fn wrong(name: &str, topic: &str, what: &str) -> ImportError {
    Place::file(name).wrong(format!("topic {topic} {what}"))
}

/// Reads a bag once; `model` is that of the arm where joints are recorded.
pub(super) fn survey(path: &Path, name: &str, map: &Topics, model: Option<Model>) -> Result<Survey, ImportError> {
    let watched = match model {
        Some(model) => Watched::Joints { model: Box::new(model), samples: Vec::new() },
        None => Watched::Tf { moving: BTreeMap::new(), fixed: BTreeMap::new() },
    };
    let mut reading = Reading { name, map, survey: Survey::default(), watched, decoder: None, watch: Watch::default() };
    let (library, sha256, damage) = each_message(path, name, &mut |message| reading.message(message))?;
    let Reading { mut survey, watched, watch, .. } = reading;
    (survey.library, survey.sha256, survey.damage) = (library, sha256, damage);
    (survey.rising_edges, survey.outside) = (watch.rising_edges, watch.outside);
    check_topics(&survey, name, map)?;
    if let Some(robot) = &map.robot {
        let (RobotTopic::Joints { topic, .. } | RobotTopic::Tf { topic, .. }) = robot;
        survey.robot = watched.samples(robot).map_err(|what| wrong(name, topic, &what))?;
    }
    Ok(survey)
}

/// Every topic of the map must be in the bag.
fn check_topics(survey: &Survey, name: &str, map: &Topics) -> Result<(), ImportError> {
    let robot = map.robot.as_ref().map(|robot| match robot {
        RobotTopic::Joints { topic, .. } | RobotTopic::Tf { topic, .. } => topic,
    });
    let named = [map.rgb.as_ref().map(|rgb| &rgb.topic), map.event.as_ref().map(|event| &event.topic), robot];
    let Some(missing) = named.into_iter().flatten().find(|topic| !survey.topics.contains_key(*topic)) else {
        return Ok(());
    };
    let known: Vec<&String> = survey.topics.keys().collect();
    let known = if known.is_empty() { "no messages at all".into() } else { super::super::some_of(&known) };
    let damaged = if survey.damage.is_empty() { String::new() } else { format!(" ({})", survey.damage.join("; ")) };
    Err(Place::file(name)
        .wrong(format!("has no messages on {missing}, which the map names; it has {known}{damaged}: correct the map")))
}

/// A bag that is being read for the first time.
struct Reading<'a> {
    name: &'a str,
    map: &'a Topics,
    survey: Survey,
    watched: Watched,
    decoder: Option<(Decoder, u64)>,
    watch: Watch,
}

impl Reading<'_> {
    fn message(&mut self, message: &Message) -> Result<(), ImportError> {
        let topic = message.channel.topic.as_str();
        match self.survey.topics.get_mut(topic) {
            Some(count) => *count += 1,
            None => drop(self.survey.topics.insert(topic.to_owned(), 1)),
        }
        let name = self.name;
        self.mapped(message).map_err(|what| wrong(name, topic, &what))
    }

    fn mapped(&mut self, message: &Message) -> Result<(), String> {
        let topic = message.channel.topic.as_str();
        let map = self.map;
        if let Some(rgb) = map.rgb.as_ref().filter(|rgb| rgb.topic == topic) {
            self.image(message, rgb)?;
        }
        if let Some(event) = map.event.as_ref().filter(|event| event.topic == topic) {
            self.packet(message, event)?;
        }
        match &map.robot {
            Some(RobotTopic::Joints { topic: of_joints, .. }) if of_joints == topic => {
                let state = messages::joints(message)?;
                stamped(state.stamp_ns)?;
                if let Watched::Joints { model, samples } = &mut self.watched {
                    samples.extend(model.at(&state));
                }
            }
            Some(RobotTopic::Tf { topic: of_tf, static_topic, .. }) if of_tf == topic || static_topic == topic => {
                let is_fixed = static_topic == topic;
                messages::transforms(message)?.into_iter().for_each(|placed| self.watched.place(placed, is_fixed));
            }
            _ => {}
        }
        Ok(())
    }

    fn image(&mut self, message: &Message, rgb: &ImageTopic) -> Result<(), String> {
        let picture = messages::picture(message)?;
        stamped(picture.stamp_ns)?;
        if let Pixels::Gray(gray) = &picture.pixels
            && (gray.width, gray.height) != (rgb.width as usize, rgb.height as usize)
        {
            let (w, h) = (gray.width, gray.height);
            return Err(format!("has an image of {w}x{h}, the map says {}x{}: correct it", rgb.width, rgb.height));
        }
        self.survey.images_ns.push(picture.stamp_ns);
        Ok(())
    }

    fn packet(&mut self, message: &Message, event: &EventTopic) -> Result<(), String> {
        let (packet, format) = messages::packet(message)?;
        stamped(packet.stamp_ns)?;
        if (packet.width, packet.height) != (event.width, event.height) {
            let (w, h) = (packet.width, packet.height);
            return Err(format!("is of a {w}x{h} sensor, the map says {}x{}: correct it", event.width, event.height));
        }
        (self.watch.width, self.watch.height) = (event.width, event.height);
        let last = self.survey.packets.last().copied();
        let (decoder, sequence) = self.decoder.get_or_insert_with(|| (Decoder::new(format), packet.sequence));
        if decoder.format() != format {
            return Err(format!(
                "changes its encoding from {} to {format} midway: cut the bag there",
                decoder.format()
            ));
        }
        // Numbers that start anew or stand still say nothing.
        let lost = packet.sequence.saturating_sub(*sequence).saturating_sub(1);
        *sequence = packet.sequence;
        let mut before_us = self.watch.last_us;
        if let Some(last) = last.filter(|_| lost > 0) {
            self.survey.lost_packets += lost;
            let since_us = (packet.stamp_ns.saturating_sub(last.stamp_ns) / 1000) as i64;
            let about_us = before_us.unwrap_or(last.time_us).saturating_add(since_us);
            decoder.set_epoch_us(about_us);
            before_us = Some(about_us);
        }
        self.watch.first_us = None;
        decoder.decode_into(&packet.events, &mut self.watch);
        let time_us = self.watch.first_us.or(before_us).unwrap_or(0);
        let bytes = packet.events.len();
        self.survey.packets.push(PacketAt { stamp_ns: packet.stamp_ns, time_us, after_gap: lost > 0, bytes });
        Ok(())
    }
}

/// Everything is brought together by stamps.
fn stamped(stamp_ns: u64) -> Result<(), String> {
    if stamp_ns > 0 {
        return Ok(());
    }
    Err("has a message without a stamp in its header (0); images, events and robot are brought together by those"
        .into())
}

/// Watches the time and the triggers while packets are decoded.
#[derive(Default)]
struct Watch {
    width: u32,
    height: u32,
    /// Time of the first event or edge of the packet.
    first_us: Option<i64>,
    last_us: Option<i64>,
    outside: u64,
    rising_edges: BTreeMap<u8, usize>,
}

impl Watch {
    fn at(&mut self, t_us: i64) {
        self.first_us = self.first_us.or(Some(t_us));
        self.last_us = Some(t_us);
    }
}

impl Sink for Watch {
    fn event(&mut self, event: Event) {
        self.at(event.t_us);
        self.outside += u64::from(u32::from(event.x) >= self.width || u32::from(event.y) >= self.height);
    }

    fn trigger(&mut self, trigger: Trigger) {
        self.at(trigger.t_us);
        if trigger.rising {
            *self.rising_edges.entry(trigger.channel).or_default() += 1;
        }
    }
}
