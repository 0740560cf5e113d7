//! The RTDE protocol, version 2: bytes to packages and back, for both sides of the wire.
//!
//! No I/O: the driver (`ur`) and the simulated controller (`sim/ur`) bring the sockets. Everything is
//! big-endian; a package is a u16 size that counts its 3 header bytes, a u8 kind and the payload.
//! No input can make it panic, and what it keeps is bounded. Uses nothing of the crate.
//! Start at [`Framer`], then [`Request`] (to the controller) and [`Answer`] (from it).

mod frame;
mod message;
mod recipe;
#[cfg(test)]
mod tests;
mod value;

pub use frame::{Framer, MAX_PACKAGE_BYTES, Package};
pub use message::{Answer, ControllerVersion, Request, TextLevel, TextMessage};
pub use recipe::{FieldAnswer, Recipe};
pub use value::{DataType, Value};

/// The one version of the protocol spoken here.
pub const PROTOCOL_VERSION: u16 = 2;

/// What is wrong with bytes that claim to be RTDE.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CodecError {
    /// The size field is smaller than the header.
    #[error("a package claims a size of {size} bytes, but its header alone has 3; the stream is broken: reconnect")]
    Size {
        /// The claimed size.
        size: u16,
    },
    /// More bytes than anybody reads.
    #[error("{bytes} bytes are waiting to be decoded, at most {allowed} may; take packages out before pushing more")]
    Flood {
        /// Bytes waiting.
        bytes: usize,
        /// Bytes allowed.
        allowed: usize,
    },
    /// A package kind that is not in the protocol.
    #[error("package kind {kind} is not known in this direction; is this the RTDE port?")]
    Kind {
        /// The kind byte.
        kind: u8,
    },
    /// The payload does not fit its kind.
    #[error("a {what} package has a payload that does not fit: {why}")]
    Payload {
        /// Name of the package kind.
        what: &'static str,
        /// Found and expected.
        why: String,
    },
    /// The values do not fit the recipe, or the package would be too large.
    #[error("cannot encode a {what} package: {why}")]
    Encode {
        /// Name of the package kind.
        what: &'static str,
        /// Found and allowed.
        why: String,
    },
}
