//! `cellcal schema`: the JSON Schemas that editors check YAML files with.

use clap::{Args, ValueEnum};

use super::{Exit, print};
use crate::config;

/// Prints the JSON Schema of a file.
#[derive(Debug, Args)]
pub(super) struct Schema {
    /// Which file.
    #[arg(value_enum)]
    file: File,
    /// Accepted for uniformity: a schema is JSON anyway.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum File {
    Cell,
    Trajectory,
    Topics,
}

impl Schema {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        let schema = match self.file {
            File::Cell => config::cell_schema(),
            File::Trajectory => config::trajectory_schema(),
            File::Topics => config::topics_schema(),
        };
        print(&format!("{}\n", serde_json::to_string_pretty(&schema)?))?;
        Ok(Exit::Ok)
    }
}
