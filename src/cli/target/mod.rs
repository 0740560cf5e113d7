//! `cellcal target`: what the display shows, on a panel, in a browser, as a video, on paper.

mod options;
mod pdf;
mod png;
mod serve;
mod video;

use clap::Subcommand;

use super::Exit;

/// Makes what the display shows.
#[derive(Debug, Subcommand)]
pub(super) enum Target {
    /// Two PNGs at the panel's own resolution: the pattern and the blended state.
    Png(png::Png),
    /// A page that blinks, for the browser of any phone, tablet or monitor.
    Serve(serve::Serve),
    /// A video that blinks, for everything that has no such browser.
    Video(video::Video),
    /// The board on paper in true scale, for cameras that are carried; it does not blink.
    Pdf(pdf::Pdf),
}

impl Target {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        match self {
            Self::Png(png) => png.execute(),
            Self::Serve(serve) => serve.execute(),
            Self::Video(video) => video.execute(),
            Self::Pdf(pdf) => pdf.execute(),
        }
    }
}
