//! `cellcal events`: looks into event files.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::progress::say;
use super::{Exit, print};
use crate::events::RawInfo;

/// Looks into event files.
#[derive(Debug, Subcommand)]
pub(super) enum Events {
    /// What a Prophesee RAW file holds.
    Info(Info),
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
        let Self::Info(Info { file, json }) = self;
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
