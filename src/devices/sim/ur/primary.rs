//! The packages of the primary and secondary interface that are simulated: version, kinematics, mode.

use bytes::{BufMut as _, Bytes, BytesMut};

use super::body::{Body, Runtime, Safety};
use super::outputs;
use crate::geometry::kinematics::Dh;

const ROBOT_STATE: u8 = 16;
const ROBOT_MESSAGE: u8 = 20;
const VERSION_MESSAGE: u8 = 3;
const ROBOT_MODE_DATA: u8 = 0;
const KINEMATICS_INFO: u8 = 5;

/// What greets a new client: the version, then a first state.
pub(super) fn greeting(body: &Body, believed: &Dh) -> Bytes {
    let mut message = BytesMut::new();
    message.put_u64((body.now_s() * 1e6) as u64);
    message.put_i8(-2);
    message.put_u8(VERSION_MESSAGE);
    let name = b"URControl";
    message.put_u8(name.len() as u8);
    message.put_slice(name);
    let [major, minor, bugfix, build] = body.config.version;
    message.put_u8(major as u8);
    message.put_u8(minor as u8);
    message.put_i32(bugfix as i32);
    message.put_i32(build as i32);
    message.put_slice(b"2022-10-26, 10:07:12");
    let mut both = BytesMut::from(&package(ROBOT_MESSAGE, &message)[..]);
    both.put_slice(&state(body, believed));
    both.freeze()
}

/// One robot state.
pub(super) fn state(body: &Body, believed: &Dh) -> Bytes {
    let mut inside = BytesMut::new();
    put_part(&mut inside, ROBOT_MODE_DATA, &mode_data(body));
    put_part(&mut inside, KINEMATICS_INFO, &kinematics(believed));
    package(ROBOT_STATE, &inside)
}

fn mode_data(body: &Body) -> BytesMut {
    let mut data = BytesMut::new();
    data.put_u64((body.now_s() * 1e6) as u64);
    let flags = [
        true,
        true,
        body.powered,
        body.safety == Safety::EmergencyStop,
        body.safety == Safety::ProtectiveStop,
        body.runtime == Runtime::Playing,
        body.runtime == Runtime::Paused,
    ];
    flags.iter().for_each(|f| data.put_u8(u8::from(*f)));
    data.put_u8(outputs::robot_mode(body) as u8);
    data.put_u8(0);
    [body.speed_fraction(), body.speed_fraction(), 1.0].iter().for_each(|f| data.put_f64(*f));
    data.put_u8(0);
    data
}

fn kinematics(dh: &Dh) -> BytesMut {
    let mut data = BytesMut::new();
    data.put_bytes(0, 24);
    for column in [dh.theta_rad, dh.a_m, dh.d_m, dh.alpha_rad] {
        column.iter().for_each(|v| data.put_f64(*v));
    }
    data.put_u32(1);
    data
}

fn put_part(into: &mut BytesMut, kind: u8, data: &[u8]) {
    into.put_u32(data.len() as u32 + 5);
    into.put_u8(kind);
    into.put_slice(data);
}

fn package(kind: u8, inside: &[u8]) -> Bytes {
    let mut bytes = BytesMut::new();
    put_part(&mut bytes, kind, inside);
    bytes.freeze()
}
