//! `cellcal events`: looks into event files.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use super::progress::say;
use super::{Exit, print};
use crate::cv::codec;
use crate::events::RawInfo;
use crate::image::GrayImage;
use crate::recording::Recording;
use crate::runner;

/// Looks into event files.
#[derive(Debug, Subcommand)]
pub(super) enum Events {
    /// What a Prophesee RAW file holds.
    Info(Info),
    /// Draws the events of a pose of a session.
    Image(Image),
}

/// How events become an image.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum How {
    /// Dark where a pixel fired: what the paper detects corners in.
    Fired,
    /// The last polarity: white ON, black OFF, gray silent.
    Polarity,
    /// How often a pixel got brighter, dark is often.
    On,
    /// How often a pixel got darker, dark is often.
    Off,
    /// Events that agree with the display's transitions minus those that do not, dark is often.
    Signed,
}

#[derive(Debug, Args)]
pub(super) struct Image {
    /// A session.
    session: PathBuf,
    /// The pose.
    #[arg(long)]
    pose: String,
    /// How events become an image.
    #[arg(long, value_enum, default_value = "fired")]
    how: How,
    /// The PNG to write.
    #[arg(long, short)]
    output: PathBuf,
}

impl Image {
    fn execute(self) -> anyhow::Result<Exit> {
        let recording = Recording::open(&self.session)?;
        let named = |why: String| anyhow::anyhow!("{}: {why}", self.session.display());
        let all = runner::accumulated(&recording, &self.pose).map_err(named)?;
        let image = match self.how {
            How::Fired => all.last.image(),
            How::Polarity => all.last.polarity_image(),
            How::On => shaded(&all.last.image(), all.counts.on()),
            How::Off => shaded(&all.last.image(), all.counts.off()),
            How::Signed if all.signed().is_empty() => {
                return Err(named(
                    "the display was not watched in this session, so nothing tells its transitions".into(),
                ));
            }
            How::Signed => all.signed_image(),
        };
        let png = codec::encode_png(&image)?;
        std::fs::write(&self.output, png).map_err(|why| anyhow::anyhow!("{}: {why}", self.output.display()))?;
        say(&format!("wrote {}", self.output.display()));
        Ok(Exit::Ok)
    }
}

/// Counts as shades; black is the 99th percentile of those that are not 0.
fn shaded(like: &GrayImage, counts: &[u32]) -> GrayImage {
    let mut some: Vec<u32> = counts.iter().copied().filter(|n| *n > 0).collect();
    some.sort_unstable();
    let full = f64::from(some.get(some.len() * 99 / 100).copied().unwrap_or(1));
    let shade = |n: &u32| (255.0 - 255.0 * (f64::from(*n) / full).min(1.0)).round() as u8;
    GrayImage { width: like.width, height: like.height, pixels: counts.iter().map(shade).collect() }
}

#[derive(Debug, Args)]
pub(super) struct Info {
    /// A RAW file: EVT2, EVT2.1 or EVT3.
    file: PathBuf,
    /// As JSON.
    #[arg(long)]
    json: bool,
}

impl Events {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        let Info { file, json } = match self {
            Self::Info(info) => info,
            Self::Image(image) => return image.execute(),
        };
        let name = file.display();
        let bytes = std::fs::read(&file).map_err(|why| anyhow::anyhow!("{name}: {why}"))?;
        let info = RawInfo::from_bytes(&bytes).map_err(|why| anyhow::anyhow!("{name}: {why}"))?;
        if json {
            print(&format!("{}\n", serde_json::to_string_pretty(&info)?))?;
        } else {
            print(&described(&serde_json::to_value(&info)?))?;
        }
        let RawInfo { truncated_bytes, outside, .. } = info;
        if truncated_bytes > 0 {
            say(&format!("warning: {name} ends {truncated_bytes} bytes into a word: it was cut off"));
        }
        if outside > 0 {
            say(&format!("warning: {outside} events lie outside the declared sensor size"));
        }
        Ok(if truncated_bytes > 0 || outside > 0 { Exit::Warnings } else { Exit::Ok })
    }
}

/// One line a fact, in the order of the JSON.
fn described(info: &serde_json::Value) -> String {
    let Some(fields) = info.as_object() else { return String::new() };
    let line = |(key, value): (&String, &serde_json::Value)| match value.as_array() {
        Some(list) => format!("{key:<16} {}\n", list.len()),
        None => format!("{key:<16} {}\n", value.to_string().trim_matches('"')),
    };
    fields.iter().map(line).collect()
}
