//! The packages of the primary and secondary interface: version, texts, and a state with the parts
//! that are simulated.

use bytes::{BufMut as _, Bytes, BytesMut};
use sha2::{Digest as _, Sha256};

use super::body::{Body, Runtime, Safety};
use super::motion::Motion;
use super::outputs::{self, JOINT_TEMPERATURE_C};
use crate::geometry::kinematics::Dh;

const ROBOT_STATE: u8 = 16;
const ROBOT_MESSAGE: u8 = 20;

const TEXT_MESSAGE: u8 = 0;
const VERSION_MESSAGE: u8 = 3;

const ROBOT_MODE_DATA: u8 = 0;
const JOINT_DATA: u8 = 1;
const TOOL_DATA: u8 = 2;
const MASTERBOARD_DATA: u8 = 3;
const CARTESIAN_INFO: u8 = 4;
const KINEMATICS_INFO: u8 = 5;
const CONFIGURATION_DATA: u8 = 6;
/// A part that no document knows: real controllers send such, and clients must pass over it.
const UNKNOWN_PART: u8 = 14;

/// Longest text of a message, bytes.
const MAX_TEXT_BYTES: usize = 1000;

/// What greets a new client: the version, then a first state.
pub(super) fn greeting(body: &Body, believed: &Dh) -> Bytes {
    let mut data = BytesMut::new();
    let name = b"URControl";
    data.put_u8(name.len() as u8);
    data.put_slice(name);
    let [major, minor, bugfix, build] = body.config.version;
    data.put_u8(major as u8);
    data.put_u8(minor as u8);
    data.put_i32(bugfix as i32);
    data.put_i32(build as i32);
    data.put_slice(b"2022-10-26, 10:07:12");
    let mut both = BytesMut::from(&message(body.now_s(), VERSION_MESSAGE, &data)[..]);
    both.put_slice(&state(body, believed));
    both.freeze()
}

/// What a program says, as a message.
pub(super) fn text_message(now_s: f64, text: &str) -> Bytes {
    message(now_s, TEXT_MESSAGE, &text.as_bytes()[..text.len().min(MAX_TEXT_BYTES)])
}

fn message(now_s: f64, kind: u8, data: &[u8]) -> Bytes {
    let mut inside = BytesMut::new();
    inside.put_u64((now_s * 1e6) as u64);
    inside.put_i8(-2);
    inside.put_u8(kind);
    inside.put_slice(data);
    package(ROBOT_MESSAGE, &inside)
}

/// One robot state.
pub(super) fn state(body: &Body, believed: &Dh) -> Bytes {
    let mut inside = BytesMut::new();
    put_part(&mut inside, ROBOT_MODE_DATA, &mode_data(body));
    put_part(&mut inside, JOINT_DATA, &joint_data(body));
    put_part(&mut inside, TOOL_DATA, &tool_data());
    put_part(&mut inside, MASTERBOARD_DATA, &masterboard_data(body));
    put_part(&mut inside, CARTESIAN_INFO, &cartesian_info(body));
    put_part(&mut inside, KINEMATICS_INFO, &kinematics(believed));
    put_part(&mut inside, CONFIGURATION_DATA, &configuration(&body.motion));
    put_part(&mut inside, UNKNOWN_PART, &[0; 7]);
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

fn joint_data(body: &Body) -> BytesMut {
    let (actual, target, speed) = (body.motion.encoded(), body.motion.target(), body.motion.encoded_speed());
    let mut data = BytesMut::new();
    for i in 0..6 {
        [actual[i], target[i], speed[i]].iter().for_each(|v| data.put_f64(*v));
        [0.0, 48.0, JOINT_TEMPERATURE_C as f32, 0.0].iter().for_each(|v| data.put_f32(*v));
        data.put_u8(outputs::joint_mode(body) as u8);
    }
    data
}

fn tool_data() -> BytesMut {
    let mut data = BytesMut::new();
    data.put_bytes(0, 2);
    [0.0, 0.0].iter().for_each(|v| data.put_f64(*v));
    data.put_f32(48.0);
    data.put_u8(0);
    data.put_f32(0.0);
    data.put_f32(JOINT_TEMPERATURE_C as f32);
    data.put_u8(253);
    data
}

fn masterboard_data(body: &Body) -> BytesMut {
    let mut data = BytesMut::new();
    data.put_u32(body.digital_inputs as u32);
    data.put_u32(body.digital_outputs as u32);
    data.put_bytes(0, 2);
    [0.0, 0.0].iter().for_each(|v| data.put_f64(*v));
    data.put_bytes(0, 2);
    [body.io.analog(0), body.io.analog(1)].iter().for_each(|v| data.put_f64(*v));
    [JOINT_TEMPERATURE_C as f32, 48.0, 0.5, 0.0].iter().for_each(|v| data.put_f32(*v));
    data.put_u8(body.safety.mode() as u8);
    // Not in reduced mode; no Euromap 67; two unused words; no mode switch, no enabling device.
    data.put_u8(u8::from(body.safety == Safety::Reduced));
    data.put_u8(0);
    data.put_bytes(0, 4);
    data.put_bytes(0, 2);
    data
}

fn cartesian_info(body: &Body) -> BytesMut {
    let mut data = BytesMut::new();
    let pose = body.motion.base_from_tcp(&body.motion.encoded()).pose_vector();
    pose.iter().chain(&body.config.tcp_offset).for_each(|v| data.put_f64(*v));
    data
}

fn kinematics(dh: &Dh) -> BytesMut {
    let columns = [dh.theta_rad, dh.a_m, dh.d_m, dh.alpha_rad];
    let mut data = BytesMut::new();
    checksums(&columns).iter().for_each(|sum| data.put_u32(*sum));
    columns.iter().flatten().for_each(|v| data.put_f64(*v));
    data.put_u32(1);
    data
}

/// One per joint, of its row; never 0.
fn checksums(columns: &[[f64; 6]; 4]) -> [u32; 6] {
    std::array::from_fn(|joint| {
        let mut hash = Sha256::new();
        columns.iter().for_each(|column| hash.update(column[joint].to_be_bytes()));
        let digest = hash.finalize();
        u32::from_be_bytes([digest[0], digest[1], digest[2], digest[3]]).max(1)
    })
}

fn configuration(motion: &Motion) -> BytesMut {
    let mut data = BytesMut::new();
    let joints = &motion.arm().joints;
    joints.iter().flat_map(|j| j.limits_rad).for_each(|v| data.put_f64(v));
    joints.iter().for_each(|_| [std::f64::consts::PI, 40.0].iter().for_each(|v| data.put_f64(*v)));
    // Default speeds and accelerations of joints and tool, equivalent radius.
    [1.05, 1.4, 0.25, 1.2, 0.2].iter().for_each(|v| data.put_f64(*v));
    let nominal = Dh::UR5E;
    let columns = [nominal.a_m, nominal.d_m, nominal.alpha_rad, nominal.theta_rad];
    columns.iter().flatten().for_each(|v| data.put_f64(*v));
    // Masterboard, controller box, robot type UR5, e-Series.
    [0, 0, 1, 2].iter().for_each(|v| data.put_i32(*v));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::devices::sim::ur::config::{Individual, SimUrConfig};

    #[test]
    fn every_part_has_its_published_size() {
        let config = SimUrConfig::default();
        let (drawn, other) = (Individual::draw(&config, 1), Individual::draw(&config, 2));
        let body = Body::new(&config, &drawn, 1);
        let state = state(&body, &drawn.believed);
        assert_eq!((state[..4].try_into().map(u32::from_be_bytes).unwrap() as usize, state[4]), (state.len(), 16));
        let (mut rest, mut sizes) = (&state[5..], Vec::new());
        while !rest.is_empty() {
            let size = u32::from_be_bytes(rest[..4].try_into().unwrap()) as usize;
            sizes.push((rest[4], size));
            rest = &rest[size..];
        }
        let known = [(0, 47), (1, 251), (2, 37), (3, 74), (4, 101), (5, 225), (6, 445), (14, 12)];
        assert_eq!(sizes, known);
        let sums = |individual: &Individual| kinematics(&individual.believed)[..24].to_vec();
        assert!(sums(&drawn) == sums(&drawn) && sums(&drawn) != sums(&other));
        assert!(sums(&drawn).chunks(4).all(|sum| sum != [0; 4]));
    }
}
