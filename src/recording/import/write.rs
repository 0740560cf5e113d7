//! Writes a data set as a session, in the order in which a run of our own would have logged it.

use std::fs;
use std::path::{Path, PathBuf};

use super::data_set::{Capture, DataSet};
use super::error::{ImportError, Place};
use super::{ImportReport, Probe, image_file};
use crate::geometry::Camera;
use crate::recording::{About, Attachment, FORMAT_VERSION, Kind, RecordingError, Writer};
use crate::session::{Captured, Input, Stamp};

/// The attachment that stands in for cell and trajectory.
pub(super) const SETUP: &str = "import.json";

/// Refuses an output that exists, before a long survey.
pub(super) fn check_output(output: &Path) -> Result<(), RecordingError> {
    if !output.exists() {
        return Ok(());
    }
    let why = std::io::Error::new(std::io::ErrorKind::AlreadyExists, "exists already; choose another name");
    Err(RecordingError::Io { path: output.into(), why })
}

/// Writes the recording `output`; after an error nothing is left of it.
pub(super) fn write(
    data_set: DataSet,
    output: &Path,
    session_id: &str,
    probe: Probe<'_>,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<ImportReport, ImportError> {
    let about = about(&data_set, session_id);
    let writer = Writer::create(output, &about, &attachments(&data_set)?)?;
    // Only now is the partial file ours to remove.
    let remains = Remains::of(output);
    let images = data_set.captures.iter().flat_map(|c| &c.exposures).filter(|shot| shot.image.is_some()).count();
    let total = images + data_set.events.as_ref().map_or(0, |events| events.packets());
    let mut copy = Copy { writer, data_set: &data_set, probe, progress, done: 0, total };
    copy.progress();
    let event_bytes = copy.events()?;
    for (index, capture) in data_set.captures.iter().enumerate() {
        // All packets come before the first capture, so they are what it delivered.
        copy.capture(capture, if index == 0 { event_bytes } else { 0 })?;
    }
    let path = copy.writer.finish()?;
    remains.keep();
    let DataSet { layout, source, setup, .. } = data_set;
    let (layout, poses, notices) = (layout.to_owned(), setup.poses.len(), source.notices());
    Ok(ImportReport { path, layout, poses, images, event_bytes, notices })
}

fn about(data_set: &DataSet, session_id: &str) -> About {
    About {
        format_version: FORMAT_VERSION,
        kind: Kind::Imported,
        session_id: session_id.into(),
        program_version: env!("CARGO_PKG_VERSION").into(),
        facts: data_set.source.facts.clone(),
    }
}

fn attachments(data_set: &DataSet) -> Result<Vec<Attachment>, ImportError> {
    let data = serde_json::to_vec_pretty(&data_set.setup)
        .map_err(|why| Place::file(SETUP).wrong(format!("cannot be made: {why}")))?;
    let header = data_set.events.as_ref().map(|raw| raw.header.clone());
    let header = header.map(|data| Attachment { name: "events.header".into(), data });
    Ok([Attachment { name: SETUP.into(), data }].into_iter().chain(header).collect())
}

/// A recording that is being filled.
struct Copy<'a> {
    writer: Writer,
    data_set: &'a DataSet,
    probe: Probe<'a>,
    progress: &'a mut dyn FnMut(usize, usize),
    done: usize,
    total: usize,
}

impl Copy<'_> {
    fn progress(&mut self) {
        (self.progress)(self.done, self.total);
    }

    fn step(&mut self) {
        self.done += 1;
        self.progress();
    }

    /// Copies the event packets; returns their bytes.
    fn events(&mut self) -> Result<u64, ImportError> {
        let Some(events) = &self.data_set.events else { return Ok(0) };
        events.copy(|packet| {
            self.writer.events(Stamp(packet.stamp_ns), packet)?;
            self.step();
            Ok(())
        })?;
        Ok(events.event_bytes)
    }

    /// Copies the images of a capture, then says that it is complete.
    fn capture(&mut self, capture: &Capture, event_bytes: u64) -> Result<(), ImportError> {
        for shot in &capture.exposures {
            let Some(file) = &shot.image else { continue };
            let image = match self.data_set.setup.cameras.get(&Camera::Rgb) {
                Some(rgb) => {
                    let size = (rgb.width, rgb.height);
                    image_file::read_sized(file, size, self.data_set.size_declared_in, self.probe)?
                }
                None => image_file::read(file, self.probe)?,
            };
            self.writer.image(Stamp::from_seconds(shot.exposure.start_s), &image.bytes, image.format)?;
            self.step();
        }
        let captured = Captured {
            pose: capture.pose,
            attempt: 0,
            exposures: capture.exposures.iter().map(|shot| shot.exposure).collect(),
            event_bytes,
            declared: Some(capture.declared.clone()),
        };
        Ok(self.writer.input(Stamp::from_seconds(capture.end_s()), &Input::Captured(captured))?)
    }
}

/// Removes an unfinished recording when it is dropped, unless it was kept.
pub(super) struct Remains {
    /// What to remove; absent where it is not ours.
    partial: Option<PathBuf>,
}

impl Remains {
    /// The unfinished file that the writer makes for `output`; none where it will refuse to.
    pub(super) fn of(output: &Path) -> Self {
        let partial = output.with_extension("mcap.partial");
        Self { partial: (!output.exists()).then_some(partial) }
    }

    /// The file is complete.
    pub(super) fn keep(mut self) {
        self.partial = None;
    }
}

impl Drop for Remains {
    fn drop(&mut self) {
        if let Some(partial) = &self.partial {
            // Nothing to be done where the system refuses; the error that led here is reported.
            let _ = fs::remove_file(partial);
        }
    }
}
