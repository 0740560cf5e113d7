//! The functions of the controller that programs may call, by topic.
//!
//! What is known but not simulated raises an exception when it is called, not when it is read.

mod maths;
mod moves;
mod poses;
mod robot;
mod signals;
mod texts;

use std::collections::HashMap;
use std::sync::LazyLock;

use super::value::{Step, Value};
use crate::devices::sim::ur::body::Body;

/// What a call leaves to do.
pub(super) enum Call {
    /// Nothing: here is the value.
    Done(Value),
    /// Waiting for so many cycles.
    Ticks(u64),
    /// Waiting until the arm stands.
    UntilAtRest,
    /// Waiting until the arm moves as fast as it was told to.
    UntilSpeedReached,
}

/// Values of the arguments in the order of the parameters.
pub(super) type Bound = Vec<Option<Value>>;

type Function = fn(&mut Body, &Arguments<'_>) -> Result<Call, String>;
type Getter = fn(&mut Body, &Arguments<'_>) -> Result<Value, String>;

enum Does {
    Call(Function),
    Value(Getter),
}

/// One function.
pub(super) struct Builtin {
    name: &'static str,
    /// Names of its parameters, in order.
    pub(super) parameters: &'static [&'static str],
    /// Whether it commands the arm: one thread at a time may.
    pub(super) moves: bool,
    /// Whether what the arm does before must have ended.
    pub(super) begins_at_rest: bool,
    does: Does,
}

const fn value(name: &'static str, parameters: &'static [&'static str], get: Getter) -> Builtin {
    Builtin { name, parameters, moves: false, begins_at_rest: false, does: Does::Value(get) }
}

const fn waits(name: &'static str, parameters: &'static [&'static str], function: Function) -> Builtin {
    Builtin { name, parameters, moves: false, begins_at_rest: false, does: Does::Call(function) }
}

const fn moves(name: &'static str, parameters: &'static [&'static str], function: Function) -> Builtin {
    Builtin { name, parameters, moves: true, begins_at_rest: false, does: Does::Call(function) }
}

const TABLES: [&[Builtin]; 6] = [maths::TABLE, moves::TABLE, poses::TABLE, robot::TABLE, signals::TABLE, texts::TABLE];

static BY_NAME: LazyLock<HashMap<&'static str, &'static Builtin>> =
    LazyLock::new(|| TABLES.iter().flat_map(|table| table.iter()).map(|builtin| (builtin.name, builtin)).collect());

/// Functions of real controllers that are not simulated; the list only makes the message better.
const REFUSED: [&str; 27] = [
    "conveyor_pulse_decode",
    "direct_torque",
    "enable_external_ft_sensor",
    "force_mode",
    "freedrive_mode",
    "ft_rtde_input_enable",
    "get_coriolis_and_centrifugal_torques",
    "get_jacobian",
    "get_jacobian_time_derivative",
    "get_mass_matrix",
    "get_target_joint_accelerations",
    "modbus_add_signal",
    "movec",
    "movep",
    "path_offset_enable",
    "rpc_factory",
    "screw_driving",
    "servoc",
    "set_conveyor_tick_count",
    "socket_get_var",
    "socket_read_ascii_float",
    "socket_read_line",
    "socket_read_string",
    "socket_send_line",
    "socket_send_string",
    "teach_mode",
    "track_conveyor_linear",
];

/// The function of this name; the error says why there is none.
pub(super) fn find(name: &str) -> Result<&'static Builtin, String> {
    BY_NAME.get(name).copied().ok_or_else(|| {
        let why = if REFUSED.contains(&name) { "is not simulated" } else { "is not known" };
        format!("function `{name}` {why}")
    })
}

/// Calls a function; `bound` follows its parameters.
pub(super) fn call(builtin: &Builtin, body: &mut Body, bound: &Bound) -> Result<Call, String> {
    let arguments = Arguments { name: builtin.name, bound };
    match builtin.does {
        Does::Call(function) => function(body, &arguments),
        Does::Value(get) => get(body, &arguments).map(Call::Done),
    }
}

struct Arguments<'a> {
    name: &'a str,
    bound: &'a [Option<Value>],
}

impl Arguments<'_> {
    fn get(&self, index: usize) -> Option<&Value> {
        self.bound.get(index)?.as_ref()
    }

    fn need(&self, index: usize) -> Result<&Value, String> {
        self.get(index).ok_or_else(|| format!("`{}` misses argument {}", self.name, index + 1))
    }

    fn number(&self, index: usize) -> Result<f64, String> {
        self.need(index)?.number()
    }

    fn number_or(&self, index: usize, default: f64) -> Result<f64, String> {
        self.get(index).map_or(Ok(default), Value::number)
    }

    /// A positive number, or the default.
    fn positive(&self, index: usize, default: f64) -> Result<f64, String> {
        let value = self.number_or(index, default)?;
        let good = value > 0.0 && value.is_finite();
        if good { Ok(value) } else { Err(format!("`{}`: argument {} is {value}, not positive", self.name, index + 1)) }
    }

    /// A whole number from 0 up to, not including, `end`.
    fn below(&self, index: usize, end: usize) -> Result<usize, String> {
        let number = self.need(index)?.index()?;
        let fine = number < end;
        if fine {
            Ok(number)
        } else {
            Err(format!("`{}`: there is no number {number}, only 0 to {}", self.name, end - 1))
        }
    }

    fn text(&self, index: usize) -> Result<String, String> {
        self.need(index).map(Value::text)
    }

    /// Three numbers: of a list, or of the position in a pose.
    fn three(&self, index: usize) -> Result<[f64; 3], String> {
        let value = self.need(index)?;
        let item = |i| value.part(&Step::Index(i))?.number();
        Ok([item(0)?, item(1)?, item(2)?])
    }
}

fn numbers(values: &[f64]) -> Value {
    Value::List(values.iter().copied().map(Value::Float).collect())
}

fn nothing() -> Result<Value, String> {
    Ok(Value::Nothing)
}
