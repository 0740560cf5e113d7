//! One client of the primary, secondary or realtime interface: programs in, states out.

use bytes::Bytes;

use super::link::Link;
use super::urscript::Upload;

#[derive(Debug)]
pub(super) struct ScriptClient {
    pub(super) link: Link,
    upload: Upload,
    /// Whether it gets robot states; the realtime interface sends none here.
    streams: bool,
}

impl ScriptClient {
    pub(super) fn new(mut link: Link, greeting: Option<&Bytes>) -> Self {
        if let Some(greeting) = greeting {
            link.send(greeting);
        }
        Self { link, upload: Upload::default(), streams: greeting.is_some() }
    }

    /// Programs that have become complete.
    pub(super) fn serve(&mut self) -> Vec<String> {
        let mut bytes = Vec::new();
        self.link.read(&mut bytes);
        self.upload.push(&bytes)
    }

    /// Sends a state, unless older ones are still unsent.
    pub(super) fn send_state(&mut self, state: &Bytes) {
        if self.streams && !self.link.is_congested() {
            self.link.send(state);
        }
    }
}
