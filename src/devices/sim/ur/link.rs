//! One TCP connection that is read and written without ever waiting.

use std::pin::Pin;
use std::task::{Context, Poll, Waker};

use bytes::{Buf as _, BytesMut};
use tokio::io::AsyncWrite as _;
use tokio::net::TcpStream;

/// Bytes that may wait for a client that does not read; it is disconnected above that.
const MAX_UNSENT_BYTES: usize = 1 << 18;

/// Bytes that a stalled connection takes up before it counts as congested, as the system's buffers do.
const STALLED_BYTES: usize = 1 << 16;

/// Bytes taken from one client before the others have their turn.
const MAX_READ_BYTES: usize = 1 << 16;

#[derive(Debug)]
pub(super) struct Link {
    stream: TcpStream,
    unsent: BytesMut,
    open: bool,
    /// Nothing comes through, in neither direction.
    stalled: bool,
}

impl Link {
    pub(super) fn new(stream: TcpStream) -> Self {
        // Without it small packages wait for each other; a socket that refuses the option still works.
        let _ = stream.set_nodelay(true);
        Self { stream, unsent: BytesMut::new(), open: true, stalled: false }
    }

    pub(super) fn is_open(&self) -> bool {
        self.open
    }

    /// Whether earlier bytes still wait for the client.
    pub(super) fn is_congested(&self) -> bool {
        if self.stalled { self.unsent.len() > STALLED_BYTES } else { !self.unsent.is_empty() }
    }

    pub(super) fn close(&mut self) {
        self.open = false;
    }

    /// Says goodbye before it closes: the client reads everything, then the end.
    pub(super) fn close_in_order(&mut self) {
        // Closing a socket with unread bytes would reset it.
        self.read(&mut Vec::new());
        let _ = Pin::new(&mut self.stream).poll_shutdown(&mut Context::from_waker(Waker::noop()));
        self.open = false;
    }

    /// Closes it so that the client sees a reset.
    pub(super) fn reset(&mut self) {
        // A socket that refuses the option is closed in order.
        let _ = self.stream.set_zero_linger();
        self.open = false;
    }

    /// Lets nothing through any more, or again.
    pub(super) fn stall(&mut self, stalled: bool) {
        self.stalled = stalled;
        self.flush();
    }

    /// Whether there is something to do; otherwise the task is woken when there is.
    pub(super) fn poll_ready(&self, context: &mut Context<'_>) -> bool {
        if self.stalled {
            return false;
        }
        let readable = matches!(self.stream.poll_read_ready(context), Poll::Ready(_));
        readable || (!self.unsent.is_empty() && matches!(self.stream.poll_write_ready(context), Poll::Ready(_)))
    }

    /// Sends what waits and takes what has come.
    pub(super) fn read(&mut self, into: &mut Vec<u8>) {
        self.flush();
        let mut chunk = [0; 4096];
        while self.open && !self.stalled && into.len() < MAX_READ_BYTES {
            match self.stream.try_read(&mut chunk) {
                Ok(0) => self.open = false,
                Ok(count) => into.extend_from_slice(&chunk[..count]),
                Err(e) if e.kind() == std::io::ErrorKind::WouldBlock => break,
                Err(_) => self.open = false,
            }
        }
    }

    /// Sends now what the socket takes, the rest later.
    pub(super) fn send(&mut self, bytes: &[u8]) {
        if !self.open {
            return;
        }
        self.unsent.extend_from_slice(bytes);
        self.flush();
        if self.unsent.len() > MAX_UNSENT_BYTES {
            self.open = false;
        }
    }

    fn flush(&mut self) {
        while self.open && !self.stalled && !self.unsent.is_empty() {
            match self.stream.try_write(&self.unsent) {
                Ok(count) => self.unsent.advance(count),
                Err(e) if e.kind() == std::io::ErrorKind::WouldBlock => break,
                Err(_) => self.open = false,
            }
        }
    }
}
