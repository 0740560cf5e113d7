//! The calibrated kinematics, out of the primary interface.

use bytes::{Buf as _, BytesMut};
use tokio::io::AsyncReadExt as _;
use tokio::time::timeout;

use super::config::UrConfig;
use super::connection::{broken, event_loop, open};
use crate::devices::RobotError;
use crate::geometry::kinematics::Dh;
use crate::session::Kinematics;

const ROBOT_STATE: u8 = 16;
const KINEMATICS_INFO: u8 = 5;
const KINEMATICS_BYTES: usize = 220;
const CHECKSUM_BYTES: usize = 24;

/// Header of packages and of their parts: u32 length and u8 type.
const HEADER_BYTES: usize = 5;

/// Larger packages are no robot states.
const MAX_PACKAGE_BYTES: usize = 1 << 16;

/// Reads the Denavit-Hartenberg parameters that the controller itself uses.
///
/// Runs its own event loop: not from async code. Fails where the controller does not send them within
/// `answer_within`.
pub fn read_kinematics(config: &UrConfig) -> Result<Kinematics, RobotError> {
    event_loop(config)?.block_on(kinematics(config))
}

/// As [`read_kinematics`], inside an event loop.
pub(super) async fn kinematics(config: &UrConfig) -> Result<Kinematics, RobotError> {
    let address = config.address(config.primary_port);
    match timeout(config.answer_within, kinematics_from(&address, config)).await {
        Ok(found) => found,
        Err(_) => {
            let what = format!("no calibrated kinematics within {:?}", config.answer_within);
            Err(RobotError::Protocol { address, what })
        }
    }
}

async fn kinematics_from(address: &str, config: &UrConfig) -> Result<Kinematics, RobotError> {
    let mut stream = open(address, config.answer_within).await?;
    let mut waiting = BytesMut::new();
    let protocol = |what: String| RobotError::Protocol { address: address.into(), what };
    loop {
        while let Some((kind, data)) = take_part(&mut waiting).map_err(protocol)? {
            if let Some(found) = (kind == ROBOT_STATE).then(|| kinematics_in_state(data)).flatten() {
                return found.map_err(protocol);
            }
        }
        match stream.read_buf(&mut waiting).await {
            Ok(0) => return Err(protocol("the controller closed the connection".into())),
            Ok(_) => {}
            Err(error) => return Err(broken(address, &error)),
        }
    }
}

/// Takes a package, or a part of one, off the front; `None` until it is whole.
fn take_part(from: &mut BytesMut) -> Result<Option<(u8, BytesMut)>, String> {
    let Some(head) = from.first_chunk::<4>() else { return Ok(None) };
    let length = u32::from_be_bytes(*head) as usize;
    if !(HEADER_BYTES..=MAX_PACKAGE_BYTES).contains(&length) {
        return Err(format!(
            "a package of {length} bytes, between {HEADER_BYTES} and {MAX_PACKAGE_BYTES} are possible"
        ));
    }
    if from.len() < length {
        return Ok(None);
    }
    let mut part = from.split_to(length);
    part.advance(4);
    let kind = part.get_u8();
    Ok(Some((kind, part)))
}

fn kinematics_in_state(mut state: BytesMut) -> Option<Result<Kinematics, String>> {
    loop {
        match take_part(&mut state) {
            Err(why) => return Some(Err(why)),
            Ok(None) => return None,
            Ok(Some((KINEMATICS_INFO, data))) => return Some(kinematics_of(data)),
            Ok(Some(_)) => {}
        }
    }
}

fn kinematics_of(mut data: BytesMut) -> Result<Kinematics, String> {
    if data.len() < KINEMATICS_BYTES {
        return Err(format!("kinematics of {} bytes, expected {KINEMATICS_BYTES}", data.len()));
    }
    let checksum = data.split_to(CHECKSUM_BYTES).iter().map(|byte| format!("{byte:02x}")).collect();
    let mut column = || std::array::from_fn(|_| data.get_f64());
    let dh = Dh { theta_rad: column(), a_m: column(), d_m: column(), alpha_rad: column() };
    let columns = [dh.theta_rad, dh.a_m, dh.d_m, dh.alpha_rad];
    let finite = columns.iter().flatten().all(|v| v.is_finite());
    let calibrated = data.get_u32() != 0;
    if finite { Ok(Kinematics { dh, checksum, calibrated }) } else { Err("the kinematics are not finite".into()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn garbage_never_panics(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
            let mut waiting = BytesMut::from(&bytes[..]);
            while let Ok(Some((_, data))) = take_part(&mut waiting) {
                let _ = kinematics_in_state(data);
            }
            let _ = kinematics_in_state(BytesMut::from(&bytes[..]));
        }
    }
}
