//! `cellcal import`: turns a foreign data set into a session.

use std::path::{Path, PathBuf};

use clap::Args;

use super::exit::UsageError;
use super::progress::{Bar, say};
use super::{Exit, print};
use crate::board::Board;
use crate::cv::codec;
use crate::image::GrayImage;
use crate::recording::import::{self, BagOptions, ImportError, ImportOptions, ImportReport, Pictures};
use crate::runner::solve::sha256;

/// Turns a foreign data set into a session.
#[derive(Debug, Args)]
pub(super) struct Import {
    /// A session folder (session.json), images and poses (cal_data.yaml), corners (a JSON file), or an MCAP bag.
    source: PathBuf,
    /// The session to write.
    #[arg(short, long)]
    output: PathBuf,
    /// What the topics of a bag mean.
    #[arg(long, value_name = "YAML")]
    map: Option<PathBuf>,
    /// Columns and rows of the images that corners were found in, such as 1024x576; for corners without images.
    #[arg(long, value_parser = image_size, value_name = "WxH")]
    image_size: Option<(u32, u32)>,
    /// Name of the data set; default: the folder's or the file's.
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

fn image_size(text: &str) -> Result<(u32, u32), String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    let is_size = |&(w, h): &(u32, u32)| (1..=65_535).contains(&w) && (1..=65_535).contains(&h);
    sides.filter(is_size).ok_or_else(|| format!("`{text}` is no image size; expected columns x rows such as 1024x576"))
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
    /// Refuses options that do not go together.
    fn check_options(&self) -> Result<(), UsageError> {
        match &self.map {
            Some(_) if self.image_size.is_some() => {
                Err(UsageError("--image-size is for corners, --map for bags: leave one out".into()))
            }
            _ => Ok(()),
        }
    }

    fn import(&self, target: &Path, progress: &mut dyn FnMut(usize, usize)) -> Result<ImportReport, ImportError> {
        let named = if self.source.is_file() { self.source.file_stem() } else { self.source.file_name() };
        let name = self.name.clone().or_else(|| Some(named?.to_str()?.to_owned()));
        // The same data set gives the same session: its id is a hash of what it is called.
        let session_id = sha256(name.clone().unwrap_or_default().as_bytes())[..16].to_owned();
        let probe = |bytes: &[u8]| {
            let image = codec::decode_gray(bytes).map_err(|e| e.to_string())?;
            Ok((image.width as u32, image.height as u32))
        };
        let board = self.board.clone();
        let Some(map) = &self.map else {
            let options = ImportOptions { name, board, image_size: self.image_size, session_id };
            return import::import(&self.source, target, &options, &probe, progress);
        };
        let encode = |image: &GrayImage| codec::encode_png(image).map_err(|e| e.to_string());
        let pictures = Pictures { probe: &probe, encode: &encode };
        let options = BagOptions { map: map.clone(), name, board, session_id };
        import::import_bag(&self.source, target, &options, pictures, progress)
    }

    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        let bar = Bar::new("importing");
        self.check_options()?;
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
        let mut report = self.import(&target, &mut progress)?;
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
