//! `cellcal target png`: the two images at a panel's own resolution.

use std::path::PathBuf;

use clap::Args;

use super::options::size;
use crate::board;
use crate::cli::exit::UsageError;
use crate::cli::progress::say;
use crate::cli::{Exit, print, read_text};
use crate::config;
use crate::cv::{charuco, codec};
use crate::image::GrayImage;

/// Two PNGs at the panel's own resolution: the pattern and the blended state.
#[derive(Debug, Args)]
pub(in crate::cli) struct Png {
    /// The cell whose board and opacity to draw.
    cell: PathBuf,
    /// Panel size in pixels, such as 800x480.
    #[arg(long, visible_alias = "size", value_parser = size)]
    panel: [u32; 2],
    /// Pixel pitch of the panel in mm; makes the squares as large as the cell says. Without it they fill the panel.
    #[arg(long)]
    pitch_mm: Option<f64>,
    /// Folder for the two files.
    #[arg(short, long, default_value = ".")]
    output: PathBuf,
    /// Prints what was made as JSON.
    #[arg(long)]
    json: bool,
}

impl Png {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        let cell = config::parse_cell(&read_text(&self.cell)?, &self.cell.display().to_string())?;
        let board = &cell.board;
        let (px, fits) = self.px_per_square(board)?;
        let pattern = centred(&board::raster(board, &charuco::markers(board)?, px), self.panel);
        let blended = board::blend_with_white(&pattern, cell.display.alpha);
        std::fs::create_dir_all(&self.output)?;
        let mut files = Vec::new();
        for (name, image) in [("pattern.png", &pattern), ("blended.png", &blended)] {
            let path = self.output.join(name);
            std::fs::write(&path, codec::encode_png(image)?)?;
            files.push(path.display().to_string());
        }
        let square_mm = self.pitch_mm.map(|p| p * f64::from(px));
        if let Some(square_mm) = square_mm.filter(|mm| (mm - board.square_m * 1e3).abs() > 1e-6) {
            let wanted_mm = board.square_m * 1e3;
            say(&format!(
                "note: whole pixels make squares of {square_mm:.4} mm, the cell says {wanted_mm} mm: put the real size into the cell"
            ));
        }
        let made = serde_json::json!({
            "files": files, "panel_px": self.panel, "px_per_square": px, "largest_px_per_square": fits, "alpha": cell.display.alpha,
            "square_mm": square_mm.map_or(serde_json::json!("measure it on the panel"), |mm| serde_json::json!(mm)),
        });
        if self.json {
            print(&format!("{}\n", serde_json::to_string_pretty(&made)?))?;
        } else {
            print(&format!("{}\n{}\n", files[0], files[1]))?;
        }
        Ok(Exit::Ok)
    }

    /// Whole pixels a square, and the most that the panel has room for with a quiet zone of half a square.
    fn px_per_square(&self, board: &board::Board) -> anyhow::Result<(u32, u32)> {
        let [w, h] = self.panel;
        let fits = (w / board.squares_x).min(h / board.squares_y);
        let with_quiet_zone = (w / (board.squares_x + 1)).min(h / (board.squares_y + 1));
        let px = match self.pitch_mm {
            None => with_quiet_zone,
            Some(pitch) if pitch.is_finite() && pitch > 0.0 => (board.square_m * 1e3 / pitch).round() as u32,
            Some(pitch) => {
                return Err(UsageError(format!("--pitch-mm {pitch} is no pixel pitch; expected mm above 0")).into());
            }
        };
        if px < 8 || px > fits {
            let (x, y) = (board.squares_x, board.squares_y);
            return Err(UsageError(format!(
                "{px} px a square: a {x}x{y} board has 8 to {fits} px a square on a {w}x{h} panel; use other squares or another panel"
            ))
            .into());
        }
        if px > with_quiet_zone {
            say(
                "note: less than half a square of white around the board; keep the bezel of the panel bright or use smaller squares",
            );
        }
        Ok((px, fits))
    }
}

/// The board in the middle of a white panel.
pub(super) fn centred(board: &GrayImage, [width, height]: [u32; 2]) -> GrayImage {
    let mut panel = GrayImage::filled(width as usize, height as usize, 255);
    let (x0, y0) = ((panel.width - board.width) / 2, (panel.height - board.height) / 2);
    for (row, line) in board.pixels.chunks(board.width).enumerate() {
        let start = (y0 + row) * panel.width + x0;
        panel.pixels[start..start + board.width].copy_from_slice(line);
    }
    panel
}
