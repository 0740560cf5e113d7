//! Motion JPEG: one response whose parts replace each other.

use std::convert::Infallible;

use axum::body::{Body, Bytes};
use futures_util::stream;
use tokio::sync::{OwnedSemaphorePermit, watch};

use super::Latest;

/// Ends a part. Browsers show a part when they have seen the boundary behind it, so it is sent with the part.
const BOUNDARY: &str = "image";

/// The media type of [`body`].
pub(super) const TYPE: &str = "multipart/x-mixed-replace; boundary=image";

struct Viewer {
    latest: watch::Receiver<Latest>,
    /// Number of the last image that was sent; none before the first boundary.
    sent: Option<u64>,
    _place: OwnedSemaphorePermit,
}

/// Every image from now on that the viewer is fast enough for; the latest at once.
pub(super) fn body(latest: watch::Receiver<Latest>, place: OwnedSemaphorePermit) -> Body {
    let viewer = Viewer { latest, sent: None, _place: place };
    Body::from_stream(stream::unfold(viewer, |mut viewer| async move {
        let part = viewer.next().await?;
        Some((Ok::<_, Infallible>(part), viewer))
    }))
}

impl Viewer {
    /// Polled only when the connection has taken what it got before.
    async fn next(&mut self) -> Option<Bytes> {
        let Some(sent) = self.sent else {
            self.sent = Some(0);
            return Some(format!("--{BOUNDARY}\r\n").into());
        };
        loop {
            let latest = self.latest.borrow_and_update().clone();
            if latest.number > sent {
                self.sent = Some(latest.number);
                return Some(part(&latest));
            }
            if latest.ended {
                return None;
            }
            self.latest.changed().await.ok()?;
        }
    }
}

fn part(latest: &Latest) -> Bytes {
    let head = format!("Content-Type: image/jpeg\r\nContent-Length: {}\r\n\r\n", latest.jpeg.len());
    let tail = format!("\r\n--{BOUNDARY}{}\r\n", if latest.ended { "--" } else { "" });
    [head.as_bytes(), &latest.jpeg, tail.as_bytes()].concat().into()
}
