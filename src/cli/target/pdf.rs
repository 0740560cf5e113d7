//! `cellcal target pdf`: the board on paper.

use std::path::PathBuf;

use clap::Args;

use super::options::BoardOptions;
use crate::board::print::{self, PAPERS, Paper};
use crate::cli::exit::UsageError;
use crate::cli::progress::say;
use crate::cli::{Exit, print as print_out};
use crate::cv::charuco;

/// The board on paper in true scale.
#[derive(Debug, Args)]
pub(in crate::cli) struct Pdf {
    /// The file to write.
    output: PathBuf,
    /// The cell whose board to print; without it that of the paper, 7x5 squares of 12 mm.
    #[arg(long)]
    cell: Option<PathBuf>,
    #[command(flatten)]
    board: BoardOptions,
    /// Sheet: a4, a3 or letter.
    #[arg(long, default_value = "a4", value_parser = paper)]
    paper: Paper,
}

fn paper(text: &str) -> Result<Paper, String> {
    let found = PAPERS.into_iter().find(|p| p.name == text.to_lowercase());
    found.ok_or_else(|| format!("`{text}` is no paper that is known; use a4, a3 or letter"))
}

impl Pdf {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        let shown = self.board.shown(self.cell.as_deref())?;
        let markers = charuco::markers(&shown.board)?;
        let file = print::pdf(&shown.board, &markers, self.paper).map_err(|e| UsageError(e.to_string()))?;
        let wrong = |e: std::io::Error| anyhow::anyhow!("{}: {e}", self.output.display());
        std::fs::write(&self.output, file).map_err(wrong)?;
        say("note: print at 100 %, measure both rulers, and put the printed size of a square into the cell");
        print_out(&format!("{}\n", self.output.display()))?;
        Ok(Exit::Ok)
    }
}
