//! `cellcal report`: shows a session or a result.

use std::path::PathBuf;

use clap::Args;

use super::exit::{self, UsageError};
use super::progress::Bar;
use super::{Exit, print, replay};
use crate::calibration::result::{CalibrationResult, SCHEMA_VERSION};
use crate::report;
use crate::runner::solve::solve_recording;

/// Shows a session or a result as a report.
#[derive(Debug, Args)]
pub(super) struct Report {
    /// A session (.mcap), which is replayed, or a result.json.
    file: PathBuf,
    /// Writes the HTML report here.
    #[arg(long)]
    html: Option<PathBuf>,
    /// Prints result.json instead of the report.
    #[arg(long)]
    json: bool,
}

impl Report {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        let name = self.file.display();
        let bytes = std::fs::read(&self.file).map_err(|why| anyhow::anyhow!("{name}: {why}"))?;
        let result: CalibrationResult = if crate::recording::scan::is_mcap(&bytes) {
            let bar = Bar::new("looking at images");
            solve_recording(&self.file, &mut |_| Ok(Vec::new()), None, &|done, total| bar.show(done, total))?.result
        } else {
            let wrong =
                |e| anyhow::anyhow!("{name} is neither a session (MCAP) nor a result.json of this program: {e}");
            serde_json::from_slice(&bytes).map_err(wrong)?
        };
        if result.schema_version != SCHEMA_VERSION {
            let found = result.schema_version;
            return Err(
                UsageError(format!("{name} has schema_version {found}, this program reads {SCHEMA_VERSION}")).into()
            );
        }
        if let Some(path) = &self.html {
            replay::replace(path, report::html(&result).as_bytes())?;
        }
        if self.json {
            print(&result.to_json()?)?;
        } else {
            print(&report::terminal(&result))?;
        }
        Ok(exit::of_result(&result))
    }
}
