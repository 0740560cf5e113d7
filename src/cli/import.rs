//! `cellcal import`: turns a foreign data set into a session.

use std::path::{Path, PathBuf};

use clap::Args;

use super::exit::UsageError;
use super::progress::{Bar, say};
use super::{Exit, print};
use crate::board::Board;
use crate::cv::codec;
use crate::recording::import::{self, ImportOptions};
use crate::runner::solve::sha256;

/// Turns a foreign data set into a session.
#[derive(Debug, Args)]
pub(super) struct Import {
    /// The folder: a session folder (session.json), or images and poses (cal_data.yaml).
    folder: PathBuf,
    /// The session to write.
    #[arg(short, long)]
    output: PathBuf,
    /// Name of the data set; default: the folder's.
    #[arg(long)]
    name: Option<String>,
    /// The board, such as 5x7:square_m=0.036:marker_m=0.018:DICT_6X6_250; overrides that of the folder.
    #[arg(long, value_parser = board)]
    board: Option<Board>,
    /// Replaces an existing session file.
    #[arg(long)]
    force: bool,
    /// Says what was imported as JSON.
    #[arg(long)]
    json: bool,
}

fn board(text: &str) -> Result<Board, String> {
    let help = || format!("`{text}` is no board; expected such as 5x7:square_m=0.036:marker_m=0.018:DICT_6X6_250");
    let parts: Vec<&str> = text.split(':').collect();
    let &[size, square, marker, dictionary] = parts.as_slice() else { return Err(help()) };
    let (x, y) = size.split_once('x').ok_or_else(help)?;
    let number = |text: &str, key: &str| text.strip_prefix(key)?.parse().ok();
    let board = Board {
        squares_x: x.parse().map_err(|_| help())?,
        squares_y: y.parse().map_err(|_| help())?,
        square_m: number(square, "square_m=").ok_or_else(help)?,
        marker_m: number(marker, "marker_m=").ok_or_else(help)?,
        dictionary: dictionary.into(),
    };
    board.check().map_err(|e| e.to_string())?;
    crate::cv::charuco::check_dictionary(&board).map_err(|e| e.to_string())?;
    Ok(board)
}

/// Refuses to replace anything but an MCAP file.
fn refuse_to_replace(path: &Path) -> anyhow::Result<()> {
    let bytes = std::fs::read(path).map_err(|why| anyhow::anyhow!("{}: {why}", path.display()))?;
    if crate::recording::scan::is_mcap(&bytes) {
        return Ok(());
    }
    Err(UsageError(format!("{} is no session; --force replaces sessions only", path.display())).into())
}

impl Import {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        let bar = Bar::new("importing");
        let name = self.name.clone().or_else(|| Some(self.folder.file_name()?.to_str()?.to_owned()));
        // The same folder gives the same session: its id is a hash of what it is called.
        let session_id = sha256(name.clone().unwrap_or_default().as_bytes())[..16].to_owned();
        let options = ImportOptions { name, board: self.board, session_id };
        let probe = |bytes: &[u8]| {
            let image = codec::decode_gray(bytes).map_err(|e| e.to_string())?;
            Ok((image.width as u32, image.height as u32))
        };
        let mut progress = |done, total| bar.show(done, total);
        let replacing = self.force && self.output.exists();
        // An existing session stays until the new one is complete; nothing but a session is ever replaced.
        let target = if replacing { self.output.with_extension("new.mcap") } else { self.output.clone() };
        if replacing {
            refuse_to_replace(&self.output)?;
            if target.exists() {
                std::fs::remove_file(&target)?;
            }
        }
        let mut report = import::import(&self.folder, &target, &options, &probe, &mut progress)?;
        if replacing {
            std::fs::rename(&target, &self.output)?;
            report.path.clone_from(&self.output);
        }
        for notice in &report.notices {
            say(&format!("note: {notice}"));
        }
        if self.json {
            let made = serde_json::json!({
                "session": report.path.display().to_string(), "layout": report.layout, "poses": report.poses,
                "images": report.images, "event_bytes": report.event_bytes, "notices": report.notices,
            });
            print(&format!("{}\n", serde_json::to_string_pretty(&made)?))?;
        } else {
            let (layout, poses, images) = (&report.layout, report.poses, report.images);
            print(&format!("{}: {layout}, {poses} poses, {images} images\n", report.path.display()))?;
        }
        Ok(Exit::Ok)
    }
}
