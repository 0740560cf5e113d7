//! Packages out of a byte stream that may be split or joined anywhere.

use bytes::{Buf as _, BufMut as _, Bytes, BytesMut};

use super::CodecError;

/// Largest package that the u16 size field can describe, bytes.
pub const MAX_PACKAGE_BYTES: usize = u16::MAX as usize;

const HEADER_BYTES: usize = 3;

/// Bytes that may wait undecoded: a few of the largest packages.
const MAX_WAITING_BYTES: usize = 8 * MAX_PACKAGE_BYTES;

/// One package: its kind and what follows the header.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Package {
    /// The kind byte, an ASCII letter.
    pub kind: u8,
    /// The payload, without the header.
    pub payload: Bytes,
}

impl Package {
    /// The bytes on the wire; fails where the payload does not fit the u16 size.
    pub fn to_bytes(&self) -> Result<Bytes, CodecError> {
        let size = self.payload.len() + HEADER_BYTES;
        let Ok(size_field) = u16::try_from(size) else {
            let why = format!("{size} bytes, at most {MAX_PACKAGE_BYTES} fit");
            return Err(CodecError::Encode { what: "RTDE", why });
        };
        let mut bytes = BytesMut::with_capacity(size);
        bytes.put_u16(size_field);
        bytes.put_u8(self.kind);
        bytes.put_slice(&self.payload);
        Ok(bytes.freeze())
    }
}

/// Cuts a byte stream into packages.
///
/// After an error the stream cannot be resynchronised: every later call fails the same way.
#[derive(Debug, Default)]
pub struct Framer {
    waiting: BytesMut,
    broken: Option<CodecError>,
}

impl Framer {
    /// Appends what was read from the socket; take the packages out before pushing more.
    pub fn push(&mut self, bytes: &[u8]) -> Result<(), CodecError> {
        self.check()?;
        let waiting = self.waiting.len() + bytes.len();
        if waiting > MAX_WAITING_BYTES {
            return Err(self.fail(CodecError::Flood { bytes: waiting, allowed: MAX_WAITING_BYTES }));
        }
        self.waiting.extend_from_slice(bytes);
        Ok(())
    }

    /// The next whole package; `None` until its last byte has come.
    pub fn next_package(&mut self) -> Result<Option<Package>, CodecError> {
        self.check()?;
        let Some((&[high, low], _)) = self.waiting.split_first_chunk::<2>() else { return Ok(None) };
        let size = u16::from_be_bytes([high, low]);
        if usize::from(size) < HEADER_BYTES {
            return Err(self.fail(CodecError::Size { size }));
        }
        // Every kind is a letter; garbage must not hold up the stream until its size has come.
        if let Some(kind) = self.waiting.get(2).filter(|kind| !kind.is_ascii_alphabetic()) {
            let kind = *kind;
            return Err(self.fail(CodecError::Kind { kind }));
        }
        if self.waiting.len() < usize::from(size) {
            return Ok(None);
        }
        let mut payload = self.waiting.split_to(usize::from(size)).freeze();
        payload.advance(2);
        let kind = payload.get_u8();
        Ok(Some(Package { kind, payload }))
    }

    fn check(&self) -> Result<(), CodecError> {
        self.broken.clone().map_or(Ok(()), Err)
    }

    fn fail(&mut self, error: CodecError) -> CodecError {
        self.waiting = BytesMut::new();
        self.broken = Some(error.clone());
        error
    }
}
