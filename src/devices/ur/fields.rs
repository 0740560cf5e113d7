//! The two recipes: what is asked of the controller, and what is sent to it.

use crate::devices::rtde::{DataType, Value};
use crate::session::{ExecutorState, MoveTarget, RobotSample};

/// Outputs in the order of [`sample_from`].
pub(super) const OUTPUTS: [(&str, DataType); 23] = [
    ("timestamp", DataType::Double),
    ("actual_q", DataType::Vector6d),
    ("actual_qd", DataType::Vector6d),
    ("target_q", DataType::Vector6d),
    ("target_qd", DataType::Vector6d),
    ("actual_TCP_pose", DataType::Vector6d),
    ("actual_TCP_speed", DataType::Vector6d),
    ("tcp_offset", DataType::Vector6d),
    ("payload", DataType::Double),
    ("payload_cog", DataType::Vector3d),
    ("robot_mode", DataType::Int32),
    ("safety_mode", DataType::Int32),
    ("safety_status_bits", DataType::Uint32),
    ("robot_status_bits", DataType::Uint32),
    ("runtime_state", DataType::Uint32),
    ("speed_scaling", DataType::Double),
    ("target_speed_fraction", DataType::Double),
    ("actual_digital_input_bits", DataType::Uint64),
    ("actual_digital_output_bits", DataType::Uint64),
    ("joint_temperatures", DataType::Vector6d),
    ("output_int_register_24", DataType::Int32),
    ("output_int_register_25", DataType::Int32),
    ("output_int_register_26", DataType::Int32),
];

/// Inputs in the order of [`Order::values`].
pub(super) const INPUTS: [(&str, DataType); 11] = [
    ("input_int_register_24", DataType::Int32),
    ("input_int_register_25", DataType::Int32),
    ("input_int_register_26", DataType::Int32),
    ("input_double_register_24", DataType::Double),
    ("input_double_register_25", DataType::Double),
    ("input_double_register_26", DataType::Double),
    ("input_double_register_27", DataType::Double),
    ("input_double_register_28", DataType::Double),
    ("input_double_register_29", DataType::Double),
    ("input_double_register_30", DataType::Double),
    ("input_double_register_31", DataType::Double),
];

const COMMAND_NONE: i32 = 0;
const COMMAND_MOVEJ: i32 = 1;
const COMMAND_MOVEL: i32 = 2;
const COMMAND_END: i32 = 255;

/// What the script is asked to do; one input package carries all of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Order {
    pub(super) sequence: i32,
    command: i32,
    target: [f64; 6],
    speed: f64,
    acceleration: f64,
}

impl Order {
    pub(super) fn none(sequence: i32) -> Self {
        Self { sequence, command: COMMAND_NONE, target: [0.0; 6], speed: 0.0, acceleration: 0.0 }
    }

    pub(super) fn end(sequence: i32) -> Self {
        Self { command: COMMAND_END, ..Self::none(sequence) }
    }

    pub(super) fn move_to(sequence: i32, target: &MoveTarget) -> Self {
        match *target {
            MoveTarget::Joint { joints_rad, speed_rad_s, acceleration_rad_s2 } => Self {
                sequence,
                command: COMMAND_MOVEJ,
                target: joints_rad,
                speed: speed_rad_s,
                acceleration: acceleration_rad_s2,
            },
            MoveTarget::Linear { tcp_pose, speed_m_s, acceleration_m_s2 } => Self {
                sequence,
                command: COMMAND_MOVEL,
                target: tcp_pose,
                speed: speed_m_s,
                acceleration: acceleration_m_s2,
            },
        }
    }

    pub(super) fn values(&self, heartbeat: i32) -> Vec<Value> {
        let numbers = self.target.iter().chain([&self.speed, &self.acceleration]);
        [heartbeat, self.sequence, self.command]
            .map(Value::Int32)
            .into_iter()
            .chain(numbers.map(|v| Value::Double(*v)))
            .collect()
    }
}

/// The sample in the values of one data package, and the heartbeat that our script has read last; the error says
/// what does not fit.
pub(super) fn sample_from(values: &[Value]) -> Result<(RobotSample, i32), String> {
    if let Some(bad) = values.iter().position(|v| !v.is_finite()) {
        let name = OUTPUTS.get(bad).map_or("?", |(name, _)| name);
        return Err(format!("{name} is not finite"));
    }
    let &[
        Value::Double(controller_time_s),
        Value::Vector6d(joints_rad),
        Value::Vector6d(joint_speeds_rad_s),
        Value::Vector6d(target_joints_rad),
        Value::Vector6d(target_joint_speeds_rad_s),
        Value::Vector6d(tcp_pose),
        Value::Vector6d(tcp_speed),
        Value::Vector6d(tcp_offset),
        Value::Double(payload_kg),
        Value::Vector3d(payload_cog_m),
        Value::Int32(robot_mode),
        Value::Int32(safety_mode),
        Value::Uint32(safety_status_bits),
        Value::Uint32(robot_status_bits),
        Value::Uint32(runtime_state),
        Value::Double(speed_scaling),
        Value::Double(target_speed_fraction),
        Value::Uint64(digital_inputs),
        Value::Uint64(digital_outputs),
        Value::Vector6d(joint_temperatures_c),
        Value::Int32(executor_sequence),
        Value::Int32(state),
        Value::Int32(echo),
    ] = values
    else {
        return Err("the values are not those of the output recipe".into());
    };
    let sample = RobotSample {
        controller_time_s,
        joints_rad,
        joint_speeds_rad_s,
        target_joints_rad,
        target_joint_speeds_rad_s,
        tcp_pose,
        tcp_speed,
        tcp_offset,
        payload_kg,
        payload_cog_m,
        robot_mode,
        safety_mode,
        safety_status_bits,
        robot_status_bits,
        runtime_state,
        speed_scaling,
        target_speed_fraction,
        digital_inputs,
        digital_outputs,
        joint_temperatures_c,
        executor_sequence,
        executor_state: executor_state(state),
    };
    Ok((sample, echo))
}

/// Meaning of the state register; another program may have left any number there.
fn executor_state(register: i32) -> ExecutorState {
    match register {
        1 => ExecutorState::Idle,
        2 => ExecutorState::Moving,
        3 => ExecutorState::Steady,
        -1 => ExecutorState::Refused,
        _ => ExecutorState::Absent,
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::devices::rtde::Value;

    /// A sample of an arm that stands at zero.
    pub(in super::super) fn sample() -> RobotSample {
        let zero = |data_type: DataType| match data_type {
            DataType::Double => Value::Double(0.0),
            DataType::Vector6d => Value::Vector6d([0.0; 6]),
            DataType::Vector3d => Value::Vector3d([0.0; 3]),
            DataType::Uint32 => Value::Uint32(0),
            DataType::Uint64 => Value::Uint64(0),
            _ => Value::Int32(0),
        };
        let values: Vec<_> = OUTPUTS.iter().map(|(_, t)| zero(*t)).collect();
        sample_from(&values).unwrap().0
    }

    #[test]
    fn a_number_that_is_not_finite_is_named() {
        let mut values: Vec<_> = OUTPUTS.iter().map(|_| Value::Int32(0)).collect();
        values[5] = Value::Vector6d([0.0, 0.0, f64::NAN, 0.0, 0.0, 0.0]);
        assert_eq!(sample_from(&values).unwrap_err(), "actual_TCP_pose is not finite");
        values[5] = Value::Int32(0);
        assert!(sample_from(&values).unwrap_err().contains("not those of the output recipe"));
    }
}
