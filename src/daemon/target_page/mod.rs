//! The blinking display as a web page, for the browser of any phone, tablet or monitor.
//!
//! The page counts refreshes and swaps two surfaces that are drawn beforehand (`page.js`, `rhythm.js`); the
//! images are drawn here, at whole device pixels a module, and so is the size of a pixel worked out from what
//! the user measures. Start at [`TargetPage`]; `routes` has the addresses.

mod measured;
mod routes;
mod tls;
mod wish;

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use tokio::net::TcpListener;

use crate::board::Board;
use crate::config::DisplayCell;
use crate::daemon::connections::{self, PATIENCE, Terms};

pub use measured::{Measured, Method};
pub use tls::{Certificate, CertificateError, Day};

/// Longest life of a connection; browsers open another.
const LIFE: Duration = Duration::from_secs(120);

/// Receives what was measured on the display; says why it could not be kept.
pub type OnMeasured = Box<dyn Fn(&Measured) -> Result<(), String> + Send + Sync>;

/// What is served.
pub struct PageConfig {
    /// Name of the cell, if there is one.
    pub cell: Option<String>,
    /// The board that is shown where the request does not say otherwise.
    pub board: Board,
    /// Opacity, rhythm and panel.
    pub display: DisplayCell,
    /// Names by which this machine may be asked, besides addresses and `localhost`.
    pub names: Vec<String>,
    /// Serves https.
    pub certificate: Option<Certificate>,
    /// Called for every measured size.
    pub on_measured: OnMeasured,
}

/// The page on its socket.
pub struct TargetPage {
    listener: TcpListener,
    config: PageConfig,
}

impl TargetPage {
    /// Listens at `address`; port 0 lets the system choose.
    pub async fn bind(address: SocketAddr, config: PageConfig) -> std::io::Result<Self> {
        Ok(Self { listener: TcpListener::bind(address).await?, config })
    }

    /// Where it listens.
    pub fn address(&self) -> std::io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Serves until it is dropped.
    pub async fn serve(self) {
        let Self { listener, config } = self;
        let tls = config.certificate.as_ref().map(Certificate::acceptor);
        let terms = Terms { tls, patience: PATIENCE, life: Some(LIFE), stop: None };
        connections::serve(listener, terms, routes::router(Arc::new(config))).await;
    }
}
