//! The script that moves the arm, and the socket that takes scripts.

use sha2::{Digest as _, Sha256};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::tcp::OwnedWriteHalf;
use tokio::time::timeout;

use super::config::UrConfig;
use super::connection::{broken, open};
use crate::devices::RobotError;

/// The program that runs on the controller.
pub const MOTION_SCRIPT: &str = include_str!("motion.script");

/// Replaces whatever runs, our own program too, and brings the arm to rest. 4 rad/s2 is 0.26 s from the
/// largest speed that is allowed by default.
pub(super) const STOP_SCRIPT: &str = "def cellcal_stop():\n  stopj(4.0)\nend\n";

/// SHA-256 of [`MOTION_SCRIPT`], lower-case hexadecimal.
pub fn script_sha256() -> String {
    Sha256::digest(MOTION_SCRIPT).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A connection that takes scripts; the state stream that comes with it is read and dropped.
#[derive(Debug)]
pub(super) struct ScriptPort {
    address: String,
    out: OwnedWriteHalf,
}

impl ScriptPort {
    /// Connects and waits for the first bytes, which show that the controller serves this connection.
    pub(super) async fn open(config: &UrConfig) -> Result<Self, RobotError> {
        let address = config.address(config.script_port);
        let stream = open(&address, config.answer_within).await?;
        let (mut from, out) = stream.into_split();
        let mut first = [0; 1];
        match timeout(config.answer_within, from.read(&mut first)).await {
            Ok(Ok(count)) if count > 0 => {}
            Ok(Err(error)) => return Err(broken(&address, &error)),
            Ok(Ok(_)) | Err(_) => {
                let what = "the script port greets nobody; is the secondary interface enabled?".into();
                return Err(RobotError::Protocol { address, what });
            }
        }
        // Unread states would fill the controller's buffers. Ends with the connection or the runtime.
        tokio::spawn(async move {
            let mut ignored = vec![0; 4096];
            while matches!(from.read(&mut ignored).await, Ok(count) if count > 0) {}
        });
        Ok(Self { address, out })
    }

    /// Sends a whole program.
    pub(super) async fn upload(&mut self, text: &str, config: &UrConfig) -> Result<(), RobotError> {
        match timeout(config.answer_within, self.out.write_all(text.as_bytes())).await {
            Ok(Ok(())) => Ok(()),
            Ok(Err(error)) => Err(broken(&self.address, &error)),
            Err(_) => Err(broken(&self.address, &std::io::ErrorKind::TimedOut.into())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_that_of_the_text() {
        let hash = script_sha256();
        assert_eq!(hash.len(), 64);
        assert!(MOTION_SCRIPT.ends_with("end\n"), "the controller waits for the last line end");
        assert!(!MOTION_SCRIPT.contains("set_tcp") && !MOTION_SCRIPT.contains("set_payload("));
    }
}
