//! `cellcal camera grab`: one image, one window of events, and what to turn.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value, json};

use super::Which;
use super::shown::{Shown, judge};
use super::source::Source;
use crate::cli::session::interrupts;
use crate::cli::{Exit, print};
use crate::cv::codec;
use crate::events::{Format, Header};
use crate::geometry::Camera;
use crate::runner::{EventLook, Looked};
use crate::vision::aids::Aids;

/// Takes one image and one window of events, and says what to turn. Nothing moves.
#[derive(Debug, Args)]
pub(in crate::cli) struct Grab {
    /// The cell whose cameras to open.
    cell: PathBuf,
    /// Which camera.
    #[arg(long, value_enum, default_value = "both")]
    camera: Which,
    /// Folder for `rgb.png`, `event.png` and `event.raw`.
    #[arg(short, long, default_value = ".")]
    output: PathBuf,
    /// Prints the aids as JSON.
    #[arg(long)]
    json: bool,
}

impl Grab {
    /// Exit 3 where there is something to turn.
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        let mut source = Source::open(&self.cell, self.camera)?;
        let aids = Aids::new(&source.cell.board)?;
        let Some(looked) = source.looking.look(interrupts()?)? else { return Ok(Exit::Interrupted) };
        if looked.frame.is_none() && source.cameras().contains(&Camera::Rgb) {
            anyhow::bail!("the image of the rgb camera was lost on its way; look at its cable and network");
        }
        let shown = judge(&source.cell.board, &aids, &looked);
        std::fs::create_dir_all(&self.output)
            .map_err(|why| anyhow::anyhow!("--output {}: {why}", self.output.display()))?;
        let mut cameras = serde_json::Map::new();
        for shown in &shown {
            let files = self.write(shown, &looked, &source)?;
            cameras.insert(shown.camera.name().into(), self.entry(shown, &looked, &source, &files));
            if !self.json {
                print(&described(shown, &source, &files))?;
            }
        }
        if self.json {
            let told = json!({ "schema_version": 1, "cell": source.cell.name, "cameras": cameras });
            print(&format!("{}\n", serde_json::to_string_pretty(&told)?))?;
        }
        let advised = shown.iter().any(|s| s.aids.readings().iter().any(|r| r.advice.is_some()));
        Ok(if advised { Exit::Warnings } else { Exit::Ok })
    }

    fn write(&self, shown: &Shown, looked: &Looked, source: &Source) -> anyhow::Result<Vec<PathBuf>> {
        let name = shown.camera.name();
        let mut files = vec![(format!("{name}.png"), codec::encode_png(&shown.image)?)];
        if let (Camera::Event, Some(events)) = (shown.camera, &looked.events) {
            files.push((format!("{name}.raw"), raw_file(events, source)?));
        }
        let write = |(name, bytes): (String, Vec<u8>)| -> anyhow::Result<PathBuf> {
            let path = self.output.join(name);
            std::fs::write(&path, bytes).map_err(|why| anyhow::anyhow!("{}: {why}", path.display()))?;
            Ok(path)
        };
        files.into_iter().map(write).collect()
    }

    fn entry(&self, shown: &Shown, looked: &Looked, source: &Source, files: &[PathBuf]) -> Value {
        let advice: Vec<String> = shown.aids.readings().into_iter().filter_map(|r| r.advice).collect();
        let facts = source.facts.iter().find(|(camera, _)| *camera == shown.camera).map(|(_, facts)| facts);
        let mut entry = json!({
            "files": files.iter().map(|f| f.display().to_string()).collect::<Vec<_>>(),
            "model": facts.map(|f| &f.model), "serial": facts.and_then(|f| f.serial.as_ref()),
            "size": [shown.image.width, shown.image.height], "aids": shown.aids.json(), "advice": advice,
        });
        if let (Camera::Event, Some(EventLook { window_us, triggered, events, .. })) = (shown.camera, &looked.events) {
            entry["window"] = json!({ "us": window_us, "cut_by_triggers": triggered, "events": events });
        }
        entry
    }
}

/// The words as they came, behind a header: more than the window, which stands in the middle.
fn raw_file(events: &EventLook, source: &Source) -> anyhow::Result<Vec<u8>> {
    let format = Format::from_name(source.looking.encoding())?;
    let [width, height] = source.looking.event_size().map(u16::try_from);
    let mut bytes = Header::new(format, width?, height?).to_bytes();
    events.packets.iter().for_each(|packet| bytes.extend_from_slice(&packet.words));
    Ok(bytes)
}

/// What people read: a line an aid, with the advice behind it.
fn described(shown: &Shown, source: &Source, files: &[PathBuf]) -> String {
    let model = source.facts.iter().find(|(camera, _)| *camera == shown.camera).map_or("", |(_, f)| &f.model);
    let mut text = format!("{}: {model}, {} x {}\n", shown.camera, shown.image.width, shown.image.height);
    for reading in shown.aids.readings() {
        let advice = reading.advice.map(|advice| format!("  -> {advice}")).unwrap_or_default();
        // Writing to a string cannot fail.
        let _ = writeln!(text, "  {:<16} {:<10}{advice}", reading.name, reading.value);
    }
    let written = |file: &Path| format!("  {}\n", file.display());
    text + &files.iter().map(|f| written(f)).collect::<String>()
}
