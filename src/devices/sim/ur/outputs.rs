//! The output fields of the simulated controller.

use super::body::{Body, Runtime};
use super::inputs::REGISTERS;
use super::io::BIT_REGISTERS;
use super::noise::{self, Stream};
use crate::devices::rtde::{DataType, Value};
use crate::geometry::kinematics::Joints;

pub(super) const ROBOT_MODE_BOOTING: i32 = 2;
pub(super) const ROBOT_MODE_POWER_OFF: i32 = 3;
pub(super) const ROBOT_MODE_IDLE: i32 = 5;
const ROBOT_MODE_RUNNING: i32 = 7;
const JOINT_MODE_POWER_OFF: i32 = 239;
const JOINT_MODE_IDLE: i32 = 255;
const JOINT_MODE_RUNNING: i32 = 253;

/// Temperature of every joint, degrees Celsius.
pub(super) const JOINT_TEMPERATURE_C: f64 = 30.0;

/// What is measured and reported in one tick.
#[derive(Debug)]
pub(super) struct Snapshot {
    pub(super) actual_q: Joints,
    pub(super) actual_qd: Joints,
    pub(super) tcp_speed: [f64; 6],
}

impl Snapshot {
    pub(super) fn take(body: &Body) -> Self {
        let flaws = &body.config.flaws;
        let mut rng = noise::generator(body.seed, Stream::Measured, body.tick);
        let (q, qd) = (body.motion.encoded(), body.motion.encoded_speed());
        let q_noise = noise::normal::<6>(&mut rng, flaws.encoder_noise_rad);
        let qd_noise = noise::normal::<6>(&mut rng, flaws.speed_noise_rad_s);
        let linear = noise::normal::<3>(&mut rng, flaws.tcp_speed_noise_m_s);
        let angular = noise::normal::<3>(&mut rng, flaws.tcp_speed_noise_rad_s);
        let tcp_speed = body.motion.tcp_speed(&q, &qd);
        Self {
            actual_q: std::array::from_fn(|i| q[i] + q_noise[i]),
            actual_qd: std::array::from_fn(|i| qd[i] + qd_noise[i]),
            tcp_speed: std::array::from_fn(|i| tcp_speed[i] + if i < 3 { linear[i] } else { angular[i - 3] }),
        }
    }
}

type Getter = fn(&Body, &Snapshot) -> Value;

/// Where the value of an output field comes from.
#[derive(Debug, Clone, Copy)]
pub(super) enum Source {
    Getter(Getter),
    IntRegister(usize),
    DoubleRegister(usize),
    BitRegister(usize),
    Input(usize),
    Constant(Value),
}

impl Source {
    pub(super) fn value(self, body: &Body, snapshot: &Snapshot) -> Value {
        match self {
            Self::Getter(get) => get(body, snapshot),
            Self::IntRegister(i) => Value::Int32(body.output_int.get(i).copied().unwrap_or(0)),
            Self::DoubleRegister(i) => Value::Double(body.output_double.get(i).copied().unwrap_or(0.0)),
            Self::BitRegister(i) => Value::Bool(body.io.bit(i)),
            Self::Input(slot) => body.inputs.value(slot).unwrap_or(Value::Int32(0)),
            Self::Constant(value) => value,
        }
    }
}

/// Finds an output field by its name.
pub(super) fn find(name: &str, body: &Body) -> Option<(DataType, Source)> {
    if let Some(i) = register(name, "output_int_register_") {
        return Some((DataType::Int32, Source::IntRegister(i)));
    }
    if let Some(i) = register(name, "output_double_register_") {
        return Some((DataType::Double, Source::DoubleRegister(i)));
    }
    if let Some((_, data_type, get)) = SIMULATED.iter().find(|(n, ..)| *n == name) {
        return Some((*data_type, Source::Getter(*get)));
    }
    if let Some((_, value)) = CONSTANT.iter().find(|(n, _)| *n == name) {
        return Some((value.data_type(), Source::Constant(*value)));
    }
    let bit = name.strip_prefix("output_bit_register_").and_then(|n| n.parse().ok());
    if let Some(bit) = bit.filter(|bit| (64..BIT_REGISTERS).contains(bit)) {
        return Some((DataType::Bool, Source::BitRegister(bit)));
    }
    let slot = body.inputs.find(name).filter(|_| name.starts_with("input_"))?;
    Some((body.inputs.data_type(slot)?, Source::Input(slot)))
}

fn register(name: &str, prefix: &str) -> Option<usize> {
    name.strip_prefix(prefix)?.parse().ok().filter(|i| *i < REGISTERS)
}

/// Fields that follow the simulation.
const SIMULATED: [(&str, DataType, Getter); 30] = [
    ("timestamp", DataType::Double, |b, _| Value::Double(b.config.boot_time_s + b.now_s())),
    ("target_q", DataType::Vector6d, |b, _| Value::Vector6d(b.motion.target())),
    ("target_qd", DataType::Vector6d, |b, _| Value::Vector6d(b.motion.target_speed())),
    ("actual_q", DataType::Vector6d, |_, s| Value::Vector6d(s.actual_q)),
    ("actual_qd", DataType::Vector6d, |_, s| Value::Vector6d(s.actual_qd)),
    ("actual_TCP_pose", DataType::Vector6d, |b, s| Value::Vector6d(b.motion.base_from_tcp(&s.actual_q).pose_vector())),
    ("target_TCP_pose", DataType::Vector6d, |b, _| {
        Value::Vector6d(b.motion.base_from_tcp(&b.motion.target()).pose_vector())
    }),
    ("actual_TCP_speed", DataType::Vector6d, |_, s| Value::Vector6d(s.tcp_speed)),
    ("target_TCP_speed", DataType::Vector6d, |b, _| {
        Value::Vector6d(b.motion.tcp_speed(&b.motion.target(), &b.motion.target_speed()))
    }),
    ("tcp_offset", DataType::Vector6d, |b, _| Value::Vector6d(b.config.tcp_offset)),
    ("payload", DataType::Double, |b, _| Value::Double(b.config.payload_kg)),
    ("payload_cog", DataType::Vector3d, |b, _| Value::Vector3d(b.config.payload_cog_m)),
    ("robot_mode", DataType::Int32, |b, _| Value::Int32(robot_mode(b))),
    ("joint_mode", DataType::Vector6Int32, |b, _| Value::Vector6Int32([joint_mode(b); 6])),
    ("safety_mode", DataType::Int32, |b, _| Value::Int32(safety_mode(b))),
    ("safety_status", DataType::Int32, |b, _| Value::Int32(safety_mode(b))),
    ("safety_status_bits", DataType::Uint32, |b, _| Value::Uint32(safety_status_bits(b))),
    ("robot_status_bits", DataType::Uint32, |b, _| Value::Uint32(robot_status_bits(b))),
    ("runtime_state", DataType::Uint32, |b, _| Value::Uint32(b.runtime as u32)),
    ("speed_scaling", DataType::Double, |b, _| Value::Double(b.speed_fraction())),
    ("target_speed_fraction", DataType::Double, |b, _| Value::Double(b.speed_fraction())),
    ("actual_digital_input_bits", DataType::Uint64, |b, _| Value::Uint64(b.digital_inputs)),
    ("actual_digital_output_bits", DataType::Uint64, |b, _| Value::Uint64(b.digital_outputs)),
    ("script_control_line", DataType::Uint32, |b, _| Value::Uint32(b.script_line)),
    ("payload_inertia", DataType::Vector6d, |b, _| Value::Vector6d(b.payload_inertia_kg_m2)),
    ("standard_analog_output0", DataType::Double, |b, _| Value::Double(b.io.analog(0))),
    ("standard_analog_output1", DataType::Double, |b, _| Value::Double(b.io.analog(1))),
    ("analog_io_types", DataType::Uint32, |b, _| Value::Uint32(b.io.analog_types())),
    ("output_bit_registers0_to_31", DataType::Uint32, |b, _| Value::Uint32(b.io.word(false))),
    ("output_bit_registers32_to_63", DataType::Uint32, |b, _| Value::Uint32(b.io.word(true))),
];

const ZERO_6: Value = Value::Vector6d([0.0; 6]);

/// Fields that clients ask for and that stand still here.
const CONSTANT: [(&str, Value); 38] = [
    ("target_qdd", ZERO_6),
    ("target_current", ZERO_6),
    ("target_moment", ZERO_6),
    ("actual_current", ZERO_6),
    ("joint_control_output", ZERO_6),
    ("actual_TCP_force", ZERO_6),
    ("ft_raw_wrench", ZERO_6),
    ("actual_current_as_torque", ZERO_6),
    ("joint_temperatures", Value::Vector6d([JOINT_TEMPERATURE_C; 6])),
    ("actual_joint_voltage", Value::Vector6d([48.0; 6])),
    ("actual_tool_accelerometer", Value::Vector3d([0.0; 3])),
    ("elbow_position", Value::Vector3d([0.0; 3])),
    ("elbow_velocity", Value::Vector3d([0.0; 3])),
    ("tcp_force_scalar", Value::Double(0.0)),
    ("actual_execution_time", Value::Double(0.0)),
    ("actual_momentum", Value::Double(0.0)),
    ("actual_main_voltage", Value::Double(48.0)),
    ("actual_robot_voltage", Value::Double(48.0)),
    ("actual_robot_current", Value::Double(0.5)),
    ("standard_analog_input0", Value::Double(0.0)),
    ("standard_analog_input1", Value::Double(0.0)),
    ("io_current", Value::Double(0.0)),
    ("euromap67_input_bits", Value::Uint32(0)),
    ("euromap67_output_bits", Value::Uint32(0)),
    ("euromap67_24V_voltage", Value::Double(0.0)),
    ("euromap67_24V_current", Value::Double(0.0)),
    ("tool_mode", Value::Uint32(JOINT_MODE_RUNNING as u32)),
    ("tool_analog_input_types", Value::Uint32(0)),
    ("tool_analog_input0", Value::Double(0.0)),
    ("tool_analog_input1", Value::Double(0.0)),
    ("tool_output_voltage", Value::Int32(0)),
    ("tool_output_current", Value::Double(0.0)),
    ("tool_temperature", Value::Double(JOINT_TEMPERATURE_C)),
    ("tool_output_mode", Value::Uint8(0)),
    ("tool_digital_output0_mode", Value::Uint8(0)),
    ("tool_digital_output1_mode", Value::Uint8(0)),
    ("collision_detection_ratio", Value::Double(1.0)),
    ("joint_position_deviation_ratio", Value::Double(0.0)),
];

pub(super) fn robot_mode(body: &Body) -> i32 {
    match (body.is_booting(), body.powered, body.panel.brakes_released) {
        (true, ..) => ROBOT_MODE_BOOTING,
        (false, true, true) => ROBOT_MODE_RUNNING,
        (false, true, false) => ROBOT_MODE_IDLE,
        (false, false, _) => ROBOT_MODE_POWER_OFF,
    }
}

pub(super) fn joint_mode(body: &Body) -> i32 {
    match (body.powered, body.panel.brakes_released) {
        (true, true) => JOINT_MODE_RUNNING,
        (true, false) => JOINT_MODE_IDLE,
        (false, _) => JOINT_MODE_POWER_OFF,
    }
}

fn safety_mode(body: &Body) -> i32 {
    body.safety.mode()
}

fn safety_status_bits(body: &Body) -> u32 {
    body.safety.status_bits()
}

fn robot_status_bits(body: &Body) -> u32 {
    let playing = body.runtime == Runtime::Playing;
    u32::from(body.powered) | u32::from(playing) << 1 | u32::from(body.teach_button) << 2
}
