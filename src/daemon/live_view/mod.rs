//! What the cameras see, as a web page: motion JPEG and the aids under it.
//!
//! Whoever has the cameras publishes and never waits: every viewer gets the latest image when it is ready for one,
//! and misses what came in between. Start at [`LiveView`]; `routes` has the addresses.

mod routes;
mod stream;
#[cfg(test)]
mod tests;

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use serde_json::Value;
use tokio::net::TcpListener;
use tokio::runtime::Runtime;
use tokio::sync::{Semaphore, watch};
use tokio::task::JoinHandle;

use crate::daemon::connections::{self, PATIENCE, Terms};
use crate::geometry::Camera;

/// Streams at one time; a page takes one a camera.
const STREAMS: usize = 16;
/// Viewers get this long to take the last image.
const FAREWELL: Duration = Duration::from_secs(2);

/// The latest image of a camera.
#[derive(Debug, Clone, Default)]
struct Latest {
    /// Counts images; 0 before the first.
    number: u64,
    jpeg: bytes::Bytes,
    /// No image will follow.
    ended: bool,
}

/// What is served.
struct Shared {
    cell: String,
    cameras: Vec<(Camera, watch::Sender<Latest>)>,
    /// What the page shows beside the images.
    aids: watch::Sender<Value>,
    room: Arc<Semaphore>,
}

impl Shared {
    fn of(&self, camera: Camera) -> Option<&watch::Sender<Latest>> {
        self.cameras.iter().find(|(shown, _)| *shown == camera).map(|(_, sender)| sender)
    }

    fn new(cell: &str, cameras: &[Camera]) -> Self {
        let sender = |camera: &Camera| (*camera, watch::Sender::new(Latest::default()));
        Self {
            cell: cell.to_owned(),
            cameras: cameras.iter().map(sender).collect(),
            aids: watch::Sender::new(Value::Null),
            room: Arc::new(Semaphore::new(STREAMS)),
        }
    }
}

/// The page on its socket, served by threads of its own.
pub struct LiveView {
    shared: Arc<Shared>,
    runtime: Runtime,
    server: JoinHandle<()>,
    stop: watch::Sender<bool>,
    address: SocketAddr,
}

impl LiveView {
    /// Listens at `address` and serves at once; port 0 lets the system choose.
    pub fn start(address: SocketAddr, cell: &str, cameras: &[Camera]) -> std::io::Result<Self> {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
        let listener = runtime.block_on(TcpListener::bind(address))?;
        let address = listener.local_addr()?;
        let shared = Arc::new(Shared::new(cell, cameras));
        let (stop, stopped) = watch::channel(false);
        // A stream lives as long as somebody looks.
        let terms = Terms { tls: None, patience: PATIENCE, life: None, stop: Some(stopped) };
        let server = runtime.spawn(connections::serve(listener, terms, routes::router(Arc::clone(&shared))));
        Ok(Self { shared, runtime, server, stop, address })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// How many streams are open.
    pub fn viewers(&self) -> usize {
        self.shared.cameras.iter().map(|(_, sender)| sender.receiver_count()).sum()
    }

    /// Shows a new image of a camera that was named at the start.
    pub fn publish(&self, camera: Camera, jpeg: Vec<u8>) {
        if let Some(sender) = self.shared.of(camera) {
            sender.send_modify(|latest| (latest.number, latest.jpeg) = (latest.number + 1, jpeg.into()));
        }
    }

    /// Shows new aids.
    pub fn tell(&self, aids: Value) {
        self.shared.aids.send_replace(aids);
    }

    /// Ends every stream after its last image; whoever does not take it in time is cut off.
    pub fn finish(self) {
        let Self { shared, runtime, server, stop, .. } = self;
        shared.cameras.iter().for_each(|(_, sender)| sender.send_modify(|latest| latest.ended = true));
        stop.send_replace(true);
        // Time is up or everything is told: over either way.
        let _ = runtime.block_on(async { tokio::time::timeout(FAREWELL, server).await });
        runtime.shutdown_background();
    }
}
