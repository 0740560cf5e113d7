//! The package of the realtime interface, as of 5.10: one size, 152 doubles, no types.

use bytes::{BufMut as _, Bytes, BytesMut};

use super::body::{Body, Runtime};
use super::outputs::{self, JOINT_TEMPERATURE_C, Snapshot};

/// Size of the package with its size field.
const PACKAGE_BYTES: usize = 1220;

/// One package; what is not simulated is 0.
pub(super) fn package(body: &Body, snapshot: &Snapshot) -> Bytes {
    let mut fields: Vec<f64> = Vec::with_capacity(PACKAGE_BYTES / 8);
    let (target, speed) = (body.motion.target(), body.motion.target_speed());
    fields.push(body.config.boot_time_s + body.now_s());
    fields.extend(target);
    fields.extend(speed);
    // Target accelerations, currents, moments.
    fields.extend([0.0; 18]);
    fields.extend(snapshot.actual_q);
    fields.extend(snapshot.actual_qd);
    // Actual currents, control currents.
    fields.extend([0.0; 12]);
    fields.extend(body.motion.base_from_tcp(&snapshot.actual_q).pose_vector());
    fields.extend(snapshot.tcp_speed);
    // Force at the TCP.
    fields.extend([0.0; 6]);
    fields.extend(body.motion.base_from_tcp(&target).pose_vector());
    fields.extend(body.motion.tcp_speed(&target, &speed));
    fields.push(body.digital_inputs as f64);
    fields.extend([JOINT_TEMPERATURE_C; 6]);
    // Controller time, test value.
    fields.extend([0.0; 2]);
    fields.push(f64::from(outputs::robot_mode(body)));
    fields.extend([f64::from(outputs::joint_mode(body)); 6]);
    fields.push(f64::from(body.safety.mode()));
    // Internal, tool accelerometer, internal.
    fields.extend([0.0; 15]);
    fields.push(body.speed_fraction());
    // Momentum, internal.
    fields.extend([0.0; 3]);
    // Voltages of masterboard and robot, current of the robot, voltages of the joints.
    fields.extend([48.0, 48.0, 0.5, 48.0, 48.0, 48.0, 48.0, 48.0, 48.0]);
    fields.push(body.digital_outputs as f64);
    fields.push(program_state(body));
    // Elbow position and velocity.
    fields.extend([0.0; 6]);
    fields.push(f64::from(body.safety.mode()));
    // Internal.
    fields.extend([0.0; 3]);
    fields.push(body.config.payload_kg);
    fields.extend(body.config.payload_cog_m);
    fields.extend(body.payload_inertia_kg_m2);
    let mut bytes = BytesMut::with_capacity(PACKAGE_BYTES);
    bytes.put_i32(PACKAGE_BYTES as i32);
    fields.iter().for_each(|value| bytes.put_f64(*value));
    bytes.freeze()
}

fn program_state(body: &Body) -> f64 {
    match body.runtime {
        Runtime::Stopped => 1.0,
        Runtime::Playing => 2.0,
        Runtime::Paused => 4.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::devices::sim::ur::config::{Individual, SimUrConfig};

    #[test]
    fn the_package_has_its_size_and_its_places() {
        let config = SimUrConfig { payload_kg: 2.5, ..SimUrConfig::default() };
        let body = Body::new(&config, &Individual::draw(&config, 1), 1);
        let bytes = package(&body, &Snapshot::take(&body));
        assert_eq!(bytes.len(), PACKAGE_BYTES);
        assert_eq!(bytes[..4], 1220_i32.to_be_bytes());
        // By the published table: time, target positions, robot mode, program state, payload.
        let double = |index: usize| f64::from_be_bytes(bytes[4 + 8 * index..12 + 8 * index].try_into().unwrap());
        assert_eq!((double(0), double(2)), (100.0, -1.6));
        assert_eq!((double(94), double(101), double(117)), (7.0, 1.0, 1.0));
        assert_eq!((double(131), double(138), double(142)), (1.0, 1.0, 2.5));
    }
}
