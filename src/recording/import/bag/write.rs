//! Writes a bag as a session: packets, then the images of each pose and what was captured there.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::messages::{self, Pixels};
use super::stops::{Found, Stop};
use super::survey::{Survey, each_message, wrong};
use super::{LAYOUT, Pictures};
use crate::config::Topics;
use crate::recording::import::ImportReport;
use crate::recording::import::error::{ImportError, Place};
use crate::recording::import::image_file::whole_format;
use crate::recording::import::write::{Remains, SETUP};
use crate::recording::scan::Message;
use crate::recording::{About, Attachment, EventPacket, FORMAT_VERSION, ImportSetup, Kind, Writer};
use crate::session::{Captured, Exposure, Input, Stamp};

/// A bag, surveyed.
pub(super) struct Bag<'a> {
    pub(super) path: &'a Path,
    pub(super) name: &'a str,
    pub(super) map: &'a Topics,
    pub(super) survey: &'a Survey,
    pub(super) found: &'a Found,
}

impl Bag<'_> {
    /// Writes the recording `output`; after an error nothing is left of it.
    #[expect(clippy::too_many_arguments, reason = "each is used once, here")]
    pub(super) fn write(
        &self,
        output: &Path,
        setup: ImportSetup,
        attachments: Vec<Attachment>,
        session_id: &str,
        pictures: Pictures<'_>,
        mut notices: Vec<String>,
        progress: &mut dyn FnMut(usize, usize),
    ) -> Result<ImportReport, ImportError> {
        let data = serde_json::to_vec_pretty(&setup)
            .map_err(|why| Place::file(SETUP).wrong(format!("cannot be made: {why}")))?;
        let all: Vec<_> = [Attachment { name: SETUP.into(), data }].into_iter().chain(attachments).collect();
        let writer = Writer::create(output, &self.about(session_id), &all)?;
        // Only now is the partial file ours to remove.
        let remains = Remains::of(output);
        let kept = self.found.stops.iter().flat_map(|s| &s.exposures).filter(|e| e.exposure.image).count();
        let total = kept + self.survey.packets.len();
        let mut copy = Copy { bag: self, writer, pictures, progress, done: 0, total, images: 0, unusable: 0 };
        (copy.progress)(0, total);
        copy.packets()?;
        copy.captures()?;
        let Copy { writer, images, unusable, .. } = copy;
        if unusable > 0 {
            notices.push(format!("{unusable} images are cut or no PNG or JPEG, and are left out"));
        }
        let path: PathBuf = writer.finish()?;
        remains.keep();
        let event_bytes = self.event_bytes();
        Ok(ImportReport { path, layout: LAYOUT.into(), poses: setup.poses.len(), images, event_bytes, notices })
    }

    fn event_bytes(&self) -> u64 {
        self.survey.packets.iter().map(|packet| packet.bytes as u64).sum()
    }

    fn about(&self, session_id: &str) -> About {
        let Survey { library, sha256, damage, .. } = self.survey;
        let mut facts = BTreeMap::from([
            (format!("sha256:{}", self.name), sha256.clone()),
            ("host_origin_s".into(), self.found.origin_s.to_string()),
            ("bag_written_by".into(), library.clone()),
        ]);
        if !damage.is_empty() {
            facts.insert("bag_damage".into(), damage.join("; "));
        }
        About {
            format_version: FORMAT_VERSION,
            kind: Kind::Imported,
            session_id: session_id.into(),
            program_version: env!("CARGO_PKG_VERSION").into(),
            facts,
        }
    }

    /// Nanoseconds since the session began.
    fn since_origin_ns(&self, stamp_ns: u64) -> u64 {
        stamp_ns.saturating_sub(self.found.origin_s * 1_000_000_000)
    }
}

/// A recording that is being filled.
struct Copy<'a> {
    bag: &'a Bag<'a>,
    writer: Writer,
    pictures: Pictures<'a>,
    progress: &'a mut dyn FnMut(usize, usize),
    done: usize,
    total: usize,
    images: usize,
    unusable: usize,
}

impl Copy<'_> {
    fn step(&mut self) {
        self.done += 1;
        (self.progress)(self.done, self.total);
    }

    fn packets(&mut self) -> Result<(), ImportError> {
        let bag = self.bag;
        let Some(event) = &bag.map.event else { return Ok(()) };
        let (mut surveyed, mut sequence) = (bag.survey.packets.iter(), 0);
        each_message(bag.path, bag.name, &mut |message| {
            if message.channel.topic != event.topic {
                return Ok(());
            }
            let (packet, format) = messages::packet(message).map_err(|what| wrong(bag.name, &event.topic, &what))?;
            let at = surveyed.next().ok_or_else(|| changed(bag.name))?;
            // A number is left out where packets are missing: there a decoder has to begin anew.
            sequence += if at.after_gap { 2 } else { 1 };
            let stamp_ns = bag.since_origin_ns(packet.stamp_ns);
            let time_base_ns = u64::try_from(at.time_us).unwrap_or(0).saturating_mul(1000);
            let encoding = format.encoding().into();
            let packet = EventPacket { stamp_ns, sequence, time_base_ns, encoding, ..packet };
            self.writer.events(Stamp(stamp_ns), &packet)?;
            self.step();
            Ok(())
        })?;
        Ok(())
    }

    /// Images come in the order of the bag, captures go out in their own.
    fn captures(&mut self) -> Result<(), ImportError> {
        let (bag, mut waiting) = (self.bag, Waiting::of(&self.bag.found.stops));
        if let Some(rgb) = &bag.map.rgb {
            let mut number = 0;
            each_message(bag.path, bag.name, &mut |message| {
                if message.channel.topic != rgb.topic {
                    return Ok(());
                }
                if let Some(place) = waiting.places.remove(&number) {
                    let image = self.image(message, &rgb.topic)?;
                    waiting.put(place, image);
                    self.step();
                }
                number += 1;
                while let Some((pose, images)) = waiting.complete() {
                    self.capture(pose, images)?;
                }
                Ok(())
            })?;
            if !waiting.places.is_empty() {
                return Err(changed(bag.name));
            }
        }
        while let Some((pose, images)) = waiting.complete() {
            self.capture(pose, images)?;
        }
        Ok(())
    }

    /// The image as a file; `None` where it is damaged.
    fn image(&mut self, message: &Message, topic: &str) -> Result<Option<Encoded>, ImportError> {
        let bag = self.bag;
        let wrong = |what: String| wrong(bag.name, topic, &what);
        let bytes = match messages::picture(message).map_err(wrong)?.pixels {
            Pixels::Gray(gray) => (self.pictures.encode)(&gray).map_err(wrong)?,
            Pixels::Encoded(bytes) => bytes,
        };
        let (Ok(format), Ok(size)) = (whole_format(&bytes), (self.pictures.probe)(&bytes)) else {
            self.unusable += 1;
            return Ok(None);
        };
        let said = bag.map.rgb.as_ref().map(|rgb| (rgb.width, rgb.height));
        if said != Some(size) {
            let (width, height) = said.unwrap_or_default();
            return Err(wrong(format!(
                "has an image of {}x{}, the map says {width}x{height}: correct it",
                size.0, size.1
            )));
        }
        Ok(Some(Encoded { bytes, format }))
    }

    fn capture(&mut self, pose: usize, mut images: BTreeMap<usize, Encoded>) -> Result<(), ImportError> {
        let stop = &self.bag.found.stops[pose];
        let mut exposures: Vec<Exposure> = Vec::new();
        for (index, exposed) in stop.exposures.iter().enumerate() {
            let image = images.remove(&index);
            if let Some(Encoded { bytes, format }) = &image {
                self.writer.image(Stamp::from_seconds(exposed.exposure.start_s), bytes, format)?;
                self.images += 1;
            }
            exposures.push(Exposure { image: image.is_some(), ..exposed.exposure });
        }
        let end_s = exposures.iter().map(|e| e.end_s).chain(stop.declared.still_s.map(|[_, to_s]| to_s));
        let end_s = end_s.fold(0.0, f64::max);
        // All packets come before the first capture, so they are what it delivered.
        let event_bytes = if pose == 0 { self.bag.event_bytes() } else { 0 };
        let captured = Captured { pose, attempt: 0, exposures, event_bytes, declared: Some(stop.declared.clone()) };
        Ok(self.writer.input(Stamp::from_seconds(end_s), &Input::Captured(captured))?)
    }
}

fn changed(name: &str) -> ImportError {
    Place::file(name).wrong("changed while it was imported; import it when its recording has ended")
}

/// An image as a file.
struct Encoded {
    bytes: Vec<u8>,
    format: &'static str,
}

/// Images of captures that are not complete yet.
struct Waiting {
    /// Pose and place among its exposures of each image that is kept, by its number in the bag.
    places: BTreeMap<usize, (usize, usize)>,
    /// Images still to come, and those that are there, pose by pose.
    poses: Vec<(usize, BTreeMap<usize, Encoded>)>,
    next: usize,
}

impl Waiting {
    fn of(stops: &[Stop]) -> Self {
        let (mut places, mut poses) = (BTreeMap::new(), Vec::new());
        for (pose, stop) in stops.iter().enumerate() {
            let kept = stop.exposures.iter().enumerate().filter(|(_, e)| e.exposure.image);
            let before = places.len();
            places.extend(kept.map(|(index, e)| (e.image, (pose, index))));
            poses.push((places.len() - before, BTreeMap::new()));
        }
        Self { places, poses, next: 0 }
    }

    fn put(&mut self, (pose, index): (usize, usize), image: Option<Encoded>) {
        if let Some((missing, images)) = self.poses.get_mut(pose) {
            *missing -= 1;
            images.extend(image.map(|image| (index, image)));
        }
    }

    /// The next pose, once all its images are there.
    fn complete(&mut self) -> Option<(usize, BTreeMap<usize, Encoded>)> {
        let (_, images) = self.poses.get_mut(self.next).filter(|(missing, _)| *missing == 0)?;
        self.next += 1;
        Some((self.next - 1, std::mem::take(images)))
    }
}
