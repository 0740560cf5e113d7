//! Which board: that of a cell, or of the options.

use std::path::Path;

use clap::Args;

use crate::board::Board;
use crate::cli::exit::UsageError;
use crate::cli::read_text;
use crate::config::{self, DisplayCell};
use crate::cv::charuco;

/// The board and its blended state; what is not given comes from the cell.
#[derive(Debug, Args)]
pub(super) struct BoardOptions {
    /// Squares along x and y, such as 7x5.
    #[arg(long, value_parser = counts, value_name = "NXxNY")]
    squares: Option<[u32; 2]>,
    /// Side of a square, mm.
    #[arg(long)]
    square_mm: Option<f64>,
    /// Side of a marker, mm; keeps its share of the square where only that is given.
    #[arg(long)]
    marker_mm: Option<f64>,
    /// ArUco dictionary by OpenCV's name.
    #[arg(long)]
    dictionary: Option<String>,
    /// Share of white in the blended state, 0 to 0.95.
    #[arg(long)]
    alpha: Option<f64>,
}

/// What is shown.
pub(super) struct Shown {
    pub(super) cell: Option<String>,
    pub(super) board: Board,
    pub(super) display: DisplayCell,
}

impl BoardOptions {
    /// The board of `cell`, or that of the paper, with the options in place of its own values; checked.
    pub(super) fn shown(&self, cell: Option<&Path>) -> anyhow::Result<Shown> {
        let mut shown = match cell {
            Some(path) => {
                let cell = config::parse_cell(&read_text(path)?, &path.display().to_string())?;
                Shown { cell: Some(cell.name), board: cell.board, display: cell.display }
            }
            None => Shown { cell: None, board: paper_board(), display: DisplayCell::default() },
        };
        let board = &mut shown.board;
        if let Some([x, y]) = self.squares {
            (board.squares_x, board.squares_y) = (x, y);
        }
        let ratio = board.marker_m / board.square_m;
        if let Some(mm) = self.square_mm {
            (board.square_m, board.marker_m) = (mm * 1e-3, mm * 1e-3 * ratio);
        }
        if let Some(mm) = self.marker_mm {
            board.marker_m = mm * 1e-3;
        }
        if let Some(dictionary) = &self.dictionary {
            board.dictionary.clone_from(dictionary);
        }
        board.check().map_err(|e| UsageError(e.to_string()))?;
        charuco::check_dictionary(board).map_err(|e| UsageError(e.to_string()))?;
        if let Some(alpha) = self.alpha {
            if !(0.0..=0.95).contains(&alpha) {
                return Err(UsageError(format!("--alpha {alpha} is outside 0 to 0.95")).into());
            }
            shown.display.alpha = alpha;
        }
        Ok(shown)
    }
}

/// The board of the paper.
fn paper_board() -> Board {
    Board { squares_x: 7, squares_y: 5, square_m: 0.012, marker_m: 0.0096, dictionary: "DICT_4X4_50".into() }
}

/// Two whole numbers with an `x` between them.
fn pair(text: &str) -> Option<[u32; 2]> {
    let (a, b) = text.split_once('x')?;
    Some([a.parse().ok()?, b.parse().ok()?])
}

/// A size in pixels.
pub(super) fn size(text: &str) -> Result<[u32; 2], String> {
    pair(text).filter(|size| size.iter().all(|n| (16..=16384).contains(n))).ok_or_else(|| {
        format!("`{text}` is no panel size; expected WIDTHxHEIGHT in pixels, 16 to 16384, such as 800x480")
    })
}

fn counts(text: &str) -> Result<[u32; 2], String> {
    pair(text).ok_or_else(|| format!("`{text}` are no squares; expected squares along x and y, such as 7x5"))
}
