//! `cellcal target serve`: the blinking display as a web page.

use std::net::{SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};

use clap::Args;

use super::options::BoardOptions;
use crate::cli::progress::say;
use crate::cli::{Exit, print};
use crate::daemon::target_page::{Certificate, Measured, PageConfig, TargetPage};

/// Days that browsers accept a certificate for.
const CERTIFICATE_DAYS: i64 = 397;

/// A page that blinks, until Ctrl-C.
#[derive(Debug, Args)]
pub(in crate::cli) struct Serve {
    /// The cell whose board, opacity and rhythm to show; without it the board of the paper.
    cell: Option<PathBuf>,
    #[command(flatten)]
    board: BoardOptions,
    /// Address and port; 0.0.0.0:8765 is reached from other devices.
    #[arg(long, default_value = "127.0.0.1:8765")]
    listen: SocketAddr,
    /// Serves https with a certificate of its own: without it phones have no wake lock and perhaps no full screen.
    #[arg(long)]
    https: bool,
    /// A name by which this machine is asked, besides its addresses and its host name; may be repeated.
    #[arg(long = "name")]
    names: Vec<String>,
    /// File for the measured size of a square. Default: beside the cell file, `NAME.display.json`.
    #[arg(short, long)]
    output: Option<PathBuf>,
}

impl Serve {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        let shown = self.board.shown(self.cell.as_deref())?;
        let names = self.all_names();
        let certificate = if self.https { Some(self.certificate(&names)?) } else { None };
        if let Some(certificate) = &certificate {
            say(&format!("certificate of our own, SHA-256 {}", certificate.fingerprint));
        }
        let output = match (&self.output, &self.cell) {
            (Some(output), _) => output.clone(),
            (None, Some(cell)) => cell.with_extension("display.json"),
            (None, None) => PathBuf::from("display.json"),
        };
        let config = PageConfig {
            cell: shown.cell,
            board: shown.board,
            display: shown.display,
            names,
            certificate,
            on_measured: Box::new(move |measured| keep(measured, &output)),
        };
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
        runtime.block_on(self.serve(config))
    }

    async fn serve(&self, config: PageConfig) -> anyhow::Result<Exit> {
        let failed = |e| anyhow::anyhow!("--listen {}: {e}", self.listen);
        let page = TargetPage::bind(self.listen, config).await.map_err(failed)?;
        let (scheme, address) = (if self.https { "https" } else { "http" }, page.address().map_err(failed)?);
        let reached = if address.ip().is_unspecified() { own_address().unwrap_or(address) } else { address };
        print(&format!("{scheme}://{}\n", SocketAddr::new(reached.ip(), address.port())))?;
        if !self.https && !address.ip().is_loopback() {
            say(
                "note: other devices keep full screen and wake lock from a page without https: use --https, or `target video`",
            );
        }
        let mut terminate = tokio::signal::unix::signal(tokio::signal::unix::SignalKind::terminate())?;
        tokio::select! {
            () = page.serve() => {}
            ended = tokio::signal::ctrl_c() => ended?,
            _ = terminate.recv() => {}
        }
        Ok(Exit::Ok)
    }

    /// The names given, and that of the machine.
    fn all_names(&self) -> Vec<String> {
        let mut names = self.names.clone();
        // Elsewhere than on Linux there is no such file, and --name is needed.
        if let Ok(host) = std::fs::read_to_string("/proc/sys/kernel/hostname") {
            names.extend([host.trim().to_owned(), format!("{}.local", host.trim())]);
        }
        names
    }

    fn certificate(&self, names: &[String]) -> anyhow::Result<Certificate> {
        let mut subjects = names.to_vec();
        subjects.extend(["localhost".into(), "127.0.0.1".into(), "::1".into()]);
        let own = own_address().filter(|_| self.listen.ip().is_unspecified()).unwrap_or(self.listen);
        subjects.push(own.ip().to_string());
        let today = jiff::Zoned::now().date();
        let day =
            |date: jiff::civil::Date| (i32::from(date.year()), date.month().unsigned_abs(), date.day().unsigned_abs());
        // The clock of a phone may be a day behind.
        let first = today.yesterday()?;
        let last = first.checked_add(jiff::Span::new().days(CERTIFICATE_DAYS))?;
        Ok(Certificate::new(subjects, day(first), day(last))?)
    }
}

/// The address that other devices see; nothing is sent.
fn own_address() -> Option<SocketAddr> {
    let socket = UdpSocket::bind("0.0.0.0:0").ok()?;
    // An address of the documentation range: only the route is looked up.
    socket.connect("192.0.2.1:9").ok()?;
    socket.local_addr().ok()
}

/// Writes what was measured and says what to put into the cell file.
fn keep(measured: &Measured, output: &Path) -> Result<(), String> {
    let wrong = |e: &dyn std::fmt::Display| format!("{}: {e}", output.display());
    let text = serde_json::to_string_pretty(measured).map_err(|e| wrong(&e))?;
    let unfinished = output.with_extension("unfinished");
    std::fs::write(&unfinished, text + "\n").map_err(|e| wrong(&e))?;
    std::fs::rename(&unfinished, output).map_err(|e| wrong(&e))?;
    for note in &measured.notes {
        say(&format!("note: {note}"));
    }
    say(&format!("measured: {}; lines for the cell file:", output.display()));
    print(&measured.yaml).map_err(|e| wrong(&e))
}
