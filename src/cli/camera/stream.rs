//! `cellcal camera stream`: what the cameras see, live, on the terminal or in a browser.

use std::io::IsTerminal as _;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::{Args, ValueEnum};

use super::Which;
use super::shown::{Shown, judge, readings_json};
use super::source::Source;
use super::terminal::{Asked, Protocol, Screen, compose};
use crate::cli::exit::UsageError;
use crate::cli::progress::say;
use crate::cli::session::interrupts;
use crate::cli::{Exit, print};
use crate::cv::codec;
use crate::daemon::live_view::LiveView;
use crate::vision::aids::Aids;

/// Of the images in the browser.
const JPEG_QUALITY: u8 = 85;

/// Shows what the cameras see, live, with corners and what to turn, until Ctrl-C. Nothing moves.
#[derive(Debug, Args)]
pub(in crate::cli) struct Stream {
    /// The cell whose cameras to open.
    cell: PathBuf,
    /// Which camera.
    #[arg(long, value_enum, default_value = "both")]
    camera: Which,
    /// Where to show it.
    #[arg(long = "in", value_enum, default_value = "terminal")]
    place: Place,
    /// Address and port of the page; 0.0.0.0:8766 is reached from other devices, without a password.
    #[arg(long, default_value = "127.0.0.1:8766")]
    listen: SocketAddr,
    /// How pictures get to the terminal.
    #[arg(long, value_enum, default_value = "auto")]
    protocol: Asked,
    /// Ends after so many images; in a browser they are counted while a page is open. Default: until Ctrl-C.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    images: Option<u64>,
}

/// Where the images are shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Place {
    Terminal,
    Browser,
    Both,
}

/// What the terminal takes.
enum Output {
    /// Live pictures, over what was there.
    Live(Screen),
    /// One picture, printed as it is.
    Once,
}

impl Stream {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        let protocol = Protocol::detect(self.protocol, |name| std::env::var(name).ok());
        let mut output = self.output(protocol)?;
        let stop = interrupts()?;
        let mut source = Source::open(&self.cell, self.camera)?;
        let aids = Aids::new(&source.cell.board)?;
        let page = self.page(&source)?;
        let mut number = 0;
        while self.images.is_none_or(|images| number < images) {
            // Nobody looks: the cameras rest.
            if output.is_none() && !await_viewer(page.as_ref(), &mut source, stop) {
                break;
            }
            let Some(looked) = source.looking.look(stop)? else { break };
            let shown = judge(&source.cell.board, &aids, &looked);
            number += 1;
            if let Some(page) = &page {
                publish(page, &shown, number)?;
            }
            match &mut output {
                Some(Output::Live(screen)) => {
                    let size = Screen::size();
                    screen.draw(&compose(&shown, protocol, size, &footer(number, page.as_ref())), size)?;
                }
                Some(Output::Once) => print(&compose(&shown, protocol, Screen::size(), "").printed())?,
                None => {}
            }
        }
        drop(output);
        page.into_iter().for_each(LiveView::finish);
        Ok(Exit::Ok)
    }

    /// The terminal, if it is to be used and is one.
    fn output(&self, protocol: Protocol) -> Result<Option<Output>, UsageError> {
        match (self.place, self.images, std::io::stdout().is_terminal()) {
            (Place::Browser, _, _) => Ok(None),
            (Place::Terminal | Place::Both, Some(1), _) => Ok(Some(Output::Once)),
            (Place::Terminal | Place::Both, _, true) => Ok(Some(Output::Live(Screen::new(protocol)))),
            (Place::Terminal | Place::Both, _, false) => {
                let why = "stdout is no terminal, and live pictures would be garbage in it";
                Err(UsageError(format!("{why}; use `--in browser`, or `--images 1` for one picture of characters")))
            }
        }
    }

    fn page(&self, source: &Source) -> anyhow::Result<Option<LiveView>> {
        if self.place == Place::Terminal {
            return Ok(None);
        }
        let view = LiveView::start(self.listen, &source.cell.name, &source.cameras());
        let view = view.map_err(|why| anyhow::anyhow!("--listen {}: {why}", self.listen))?;
        if !view.address().ip().is_loopback() {
            say("note: everybody in this network can look; leave --listen out to be the only one");
        }
        let url = format!("http://{}\n", view.address());
        // Beside pictures stdout is for pictures.
        if self.place == Place::Browser {
            print(&url)?
        } else {
            say(url.trim_end())
        }
        Ok(Some(view))
    }
}

/// Waits for somebody to look; false when the program is to end.
fn await_viewer(page: Option<&LiveView>, source: &mut Source, stop: &AtomicBool) -> bool {
    while page.is_some_and(|page| page.viewers() == 0) {
        if stop.load(Ordering::Relaxed) {
            return false;
        }
        source.looking.rest();
    }
    true
}

fn publish(page: &LiveView, shown: &[Shown], number: u64) -> anyhow::Result<()> {
    // Whoever has seen an image finds its aids.
    page.tell(readings_json(shown, number));
    for shown in shown {
        page.publish(shown.camera, codec::encode_jpeg(&shown.picture(shown.image.width), JPEG_QUALITY)?);
    }
    Ok(())
}

fn footer(number: u64, page: Option<&LiveView>) -> String {
    let page = page.map(|page| format!(" | http://{}", page.address())).unwrap_or_default();
    format!("image {number}{page} | Ctrl-C ends")
}
