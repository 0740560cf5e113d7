//! `cellcal target video`: the blinking display as an H.264 video.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use clap::{Args, ValueEnum};

use super::options::{BoardOptions, size};
use super::png::centred;
use crate::board;
use crate::cli::exit::UsageError;
use crate::cli::progress::{Bar, say};
use crate::cli::{Exit, print};
use crate::cv::{charuco, video_file};
use crate::image::GrayImage;

/// Encoded once and repeated, s.
const PIECE_S: u32 = 10;

/// A video that blinks at 15 Hz.
#[derive(Debug, Args)]
pub(in crate::cli) struct Video {
    /// The file to write, MP4.
    output: PathBuf,
    /// The cell whose board and opacity to draw; without it the board of the paper.
    #[arg(long)]
    cell: Option<PathBuf>,
    #[command(flatten)]
    board: BoardOptions,
    /// Images per second: 30 has one image a state, 60 has two.
    #[arg(long, default_value = "30", value_parser = rate)]
    fps: u32,
    /// Length in minutes, 0.01 to 240. Players hesitate where they begin again: make it longer than a session.
    #[arg(long, default_value = "10")]
    minutes: f64,
    /// Size in pixels, even numbers: that of the panel, so that nothing is scaled.
    #[arg(long, default_value = "1920x1080", value_parser = size)]
    size: [u32; 2],
    /// Who encodes.
    #[arg(long, value_enum, default_value = "auto")]
    encoder: Encoder,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Encoder {
    /// The program ffmpeg where it is installed, else OpenCV.
    Auto,
    /// The program ffmpeg: encodes 10 s and repeats them.
    Ffmpeg,
    /// OpenCV: encodes every image, at a quality that cannot be chosen.
    Opencv,
}

fn rate(text: &str) -> Result<u32, String> {
    match text {
        "30" => Ok(30),
        "60" => Ok(60),
        other => Err(format!("`{other}` images per second; 30 or 60 show 15 Hz in whole images")),
    }
}

/// What is encoded.
struct Plan {
    /// Pattern and blended state.
    states: [GrayImage; 2],
    fps: u32,
    /// Images in all: whole cycles.
    images: usize,
}

impl Plan {
    /// The image at `index`: whole states, the pattern first.
    fn image(&self, index: usize) -> &GrayImage {
        &self.states[index / self.images_per_state() % 2]
    }

    fn images_per_state(&self) -> usize {
        self.fps as usize / 30
    }
}

impl Video {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        let plan = self.plan()?;
        if self.minutes < 10.0 {
            say("note: shorter than 10 minutes: where the video begins again the display stops blinking for a moment");
        }
        let unfinished = self.output.with_extension("unfinished.mp4");
        let made = self.encode(&plan, &unfinished);
        let finished = made.and_then(|by| std::fs::rename(&unfinished, &self.output).map(|()| by).map_err(Into::into));
        if finished.is_err() {
            // Nothing more can be done about it.
            let _ = std::fs::remove_file(&unfinished);
        }
        let by = finished?;
        let [w, h] = self.size;
        say(&format!("{} images of {w}x{h} at {} a second, encoded by {by}", plan.images, plan.fps));
        print(&format!("{}\n", self.output.display()))?;
        Ok(Exit::Ok)
    }

    fn plan(&self) -> anyhow::Result<Plan> {
        let shown = self.board.shown(self.cell.as_deref())?;
        let [w, h] = self.size;
        if w % 2 != 0 || h % 2 != 0 {
            return Err(UsageError(format!("--size {w}x{h}: H.264 for players needs even numbers")).into());
        }
        if !(0.01..=240.0).contains(&self.minutes) {
            return Err(UsageError(format!("--minutes {} is outside 0.01 to 240", self.minutes)).into());
        }
        let board = &shown.board;
        let markers = charuco::markers(board)?;
        let step = markers.first().and_then(|m| board.whole_px_step(m.width as u32)).unwrap_or(1);
        let fits = (w / (board.squares_x + 1)).min(h / (board.squares_y + 1));
        // Markers of whole pixels a module where there is room for them.
        let px = if fits >= step { fits / step * step } else { fits };
        if px < 8 {
            let (x, y) = (board.squares_x, board.squares_y);
            return Err(UsageError(format!(
                "--size {w}x{h} has {px} px a square of a {x}x{y} board, at least 8 are needed: use a larger size"
            ))
            .into());
        }
        let pattern = centred(&board::raster(board, &markers, px), self.size);
        let blended = board::blend_with_white(&pattern, shown.display.alpha);
        let per_cycle = self.fps as usize / 15;
        let images = (self.minutes * 60.0 * f64::from(self.fps)).ceil() as usize;
        Ok(Plan { states: [pattern, blended], fps: self.fps, images: images.next_multiple_of(per_cycle) })
    }

    /// Says who did it.
    fn encode(&self, plan: &Plan, output: &Path) -> anyhow::Result<&'static str> {
        let has_ffmpeg = || Command::new("ffmpeg").arg("-version").stdout(Stdio::null()).status().is_ok();
        if self.encoder == Encoder::Ffmpeg || (self.encoder == Encoder::Auto && has_ffmpeg()) {
            return by_ffmpeg(plan, output).map(|()| "ffmpeg");
        }
        let bar = Bar::new("encoding");
        let image = |index| {
            bar.show(index + 1, plan.images);
            plan.image(index)
        };
        if video_file::encode_h264(output, plan.fps, plan.images, image)? {
            say(
                "note: OpenCV encodes slowly and blurs edges a little; with ffmpeg both are better: apt-get install ffmpeg",
            );
            return Ok("OpenCV");
        }
        anyhow::bail!("this OpenCV has no encoder for H.264; install ffmpeg: apt-get install ffmpeg")
    }
}

/// Encodes a piece of whole cycles, then repeats it without encoding again.
fn by_ffmpeg(plan: &Plan, output: &Path) -> anyhow::Result<()> {
    let piece_images = plan.images.min((PIECE_S * plan.fps) as usize);
    let more = plan.images.div_ceil(piece_images) - 1;
    let piece = output.with_extension("piece.mp4");
    let made = encode_piece(plan, piece_images, &piece).and_then(|()| {
        let mut repeat = quiet_ffmpeg();
        repeat.args(["-stream_loop", &more.to_string(), "-i"]).arg(&piece);
        repeat.args(["-c", "copy", "-frames:v", &plan.images.to_string(), "-movflags", "+faststart"]).arg(output);
        finished(repeat.spawn().map_err(not_installed)?)
    });
    // The piece is ours; where it cannot be removed the video is good all the same.
    let _ = std::fs::remove_file(&piece);
    made
}

fn encode_piece(plan: &Plan, count: usize, piece: &Path) -> anyhow::Result<()> {
    let (width, height) = (plan.states[0].width, plan.states[0].height);
    let mut encode = quiet_ffmpeg();
    encode.args(["-f", "rawvideo", "-pix_fmt", "yuv420p", "-s", &format!("{width}x{height}")]);
    encode.args(["-r", &plan.fps.to_string(), "-i", "-"]);
    // A key image each second makes seeking exact; no image waits for a later one.
    encode.args(["-c:v", "libx264", "-preset", "medium", "-crf", "8", "-bf", "0", "-g", &plan.fps.to_string()]);
    encode.args(["-color_range", "tv", "-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709"]);
    let mut child = encode.arg(piece).stdin(Stdio::piped()).spawn().map_err(not_installed)?;
    let frames = plan.states.each_ref().map(yuv420);
    let written = child.stdin.take().map_or(Ok(()), |mut pipe| {
        (0..count).try_for_each(|i| pipe.write_all(&frames[i / plan.images_per_state() % 2]))
    });
    // Where ffmpeg gave up, its own message says why, not the broken pipe.
    finished(child)?;
    Ok(written?)
}

fn quiet_ffmpeg() -> Command {
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-hide_banner", "-loglevel", "error", "-nostdin", "-y"]);
    ffmpeg.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    ffmpeg
}

fn not_installed(error: std::io::Error) -> anyhow::Error {
    match error.kind() {
        std::io::ErrorKind::NotFound => anyhow::anyhow!("ffmpeg is not installed: apt-get install ffmpeg"),
        _ => anyhow::anyhow!("ffmpeg: {error}"),
    }
}

fn finished(child: Child) -> anyhow::Result<()> {
    let output = child.wait_with_output()?;
    let said = String::from_utf8_lossy(&output.stderr);
    anyhow::ensure!(output.status.success(), "ffmpeg failed: {}", said.trim());
    Ok(())
}

/// Gray as players expect it: luma 16 to 235, no colour.
fn yuv420(image: &GrayImage) -> Vec<u8> {
    let luma = |v: &u8| (16.0 + f64::from(*v) * 219.0 / 255.0).round() as u8;
    let mut frame: Vec<u8> = image.pixels.iter().map(luma).collect();
    frame.resize(image.pixels.len() * 3 / 2, 128);
    frame
}
