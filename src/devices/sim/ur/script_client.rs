//! One client of the primary, secondary or realtime interface: programs in, states out.

use super::link::Link;
use super::urscript::Upload;

/// What a client gets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stream {
    /// States and messages.
    Primary,
    /// States.
    Secondary,
    /// The packages of the realtime interface.
    Realtime,
}

#[derive(Debug)]
pub(super) struct ScriptClient {
    pub(super) link: Link,
    upload: Upload,
    stream: Stream,
}

impl ScriptClient {
    pub(super) fn new(mut link: Link, stream: Stream, greeting: &[u8]) -> Self {
        link.send(greeting);
        Self { link, upload: Upload::default(), stream }
    }

    /// Programs that have become complete.
    pub(super) fn serve(&mut self) -> Vec<String> {
        let mut bytes = Vec::new();
        self.link.read(&mut bytes);
        self.upload.push(&bytes)
    }

    pub(super) fn gets(&self, stream: Stream) -> bool {
        self.stream == stream
    }

    /// Sends a package of this stream if the client gets it, unless older ones are still unsent.
    pub(super) fn send(&mut self, stream: Stream, package: &[u8]) {
        if self.gets(stream) && !self.link.is_congested() {
            self.link.send(package);
        }
    }
}
