//! The functions of the controller that programs may call.

use super::value::Value;
use crate::devices::rtde::TextLevel;
use crate::devices::sim::ur::body::{Body, Watchdog, WatchdogAction};
use crate::devices::sim::ur::motion::TICK_S;
use crate::geometry::kinematics::Joints;

/// What a call leaves to do.
pub(super) enum Call {
    /// Nothing: here is the value.
    Done(Value),
    /// Waiting for so many cycles.
    Ticks(u64),
    /// Waiting until the arm stands.
    UntilAtRest,
}

/// Names of the parameters of a function, in order; `None` where there is no such function.
pub(super) fn parameters(name: &str) -> Option<&'static [&'static str]> {
    Some(match name {
        "sync" | "is_steady" | "get_actual_tcp_pose" | "get_actual_joint_positions" => &[],
        "get_target_tcp_pose" | "get_target_joint_positions" => &[],
        "sleep" => &["t"],
        "movej" => &["q", "a", "v", "t", "r"],
        "movel" => &["pose", "a", "v", "t", "r"],
        "stopj" | "stopl" => &["a"],
        "is_within_safety_limits" => &["pose"],
        "get_inverse_kin" => &["x", "qnear"],
        "get_forward_kin" => &["q"],
        "read_input_integer_register" | "read_input_float_register" => &["address"],
        "write_output_integer_register" | "write_output_float_register" => &["address", "value"],
        "rtde_set_watchdog" => &["variable_name", "min_frequency", "action"],
        "textmsg" => &["s1", "s2"],
        "norm" | "abs" | "sqrt" => &["a"],
        "set_digital_out" | "set_standard_digital_out" => &["n", "b"],
        "get_digital_in" | "get_standard_digital_in" => &["n"],
        _ => return None,
    })
}

/// Calls a function; `bound` follows its parameters.
pub(super) fn call(body: &mut Body, name: &str, bound: &[Option<Value>]) -> Result<Call, String> {
    let arguments = Arguments { name, bound };
    let done = |value| Ok(Call::Done(value));
    match name {
        "sync" => Ok(Call::Ticks(1)),
        "sleep" => Ok(Call::Ticks((arguments.number(0)? / TICK_S).round() as u64)),
        "movej" | "movel" => start_move(body, &arguments),
        "stopj" | "stopl" => stop(body, &arguments),
        "is_steady" => done(Value::Bool(body.motion.is_steady())),
        "is_within_safety_limits" => done(Value::Bool(is_within_limits(body, arguments.need(0)?))),
        "get_actual_tcp_pose" | "get_target_tcp_pose" => {
            done(Value::Pose(body.motion.base_from_tcp(&body.motion.target()).pose_vector()))
        }
        "get_actual_joint_positions" | "get_target_joint_positions" => done(list(&body.motion.target())),
        "get_inverse_kin" => inverse(body, &arguments).map(Call::Done),
        "get_forward_kin" => done(Value::Pose(body.motion.base_from_tcp(&arguments.need(0)?.six()?).pose_vector())),
        "rtde_set_watchdog" => set_watchdog(body, &arguments).map(Call::Done),
        "textmsg" => {
            let text = [0, 1].map(|i| arguments.get(i).map_or_else(String::new, Value::text)).concat();
            body.say(TextLevel::Info, text);
            done(Value::Nothing)
        }
        "norm" => norm(arguments.need(0)?).map(Call::Done),
        "abs" => done(Value::Float(arguments.number(0)?.abs())),
        "sqrt" => done(Value::Float(arguments.number(0)?.sqrt())),
        "set_digital_out" | "set_standard_digital_out" => set_digital_out(body, &arguments).map(Call::Done),
        "get_digital_in" | "get_standard_digital_in" => {
            let bit = arguments.bit(0)?;
            done(Value::Bool(body.digital_inputs & bit != 0))
        }
        _ => register(body, &arguments).map(Call::Done),
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

    /// A positive number, or the default.
    fn positive(&self, index: usize, default: f64) -> Result<f64, String> {
        let value = self.get(index).map_or(Ok(default), Value::number)?;
        let good = value > 0.0 && value.is_finite();
        if good { Ok(value) } else { Err(format!("`{}`: argument {} is {value}, not positive", self.name, index + 1)) }
    }

    fn bit(&self, index: usize) -> Result<u64, String> {
        let number = self.need(index)?.index()?;
        if number < 18 { Ok(1 << number) } else { Err(format!("there is no digital signal {number}")) }
    }
}

fn list(joints: &Joints) -> Value {
    Value::List(joints.map(Value::Float).into())
}

/// Joint positions of a target given as a pose or as joint positions.
fn joints_of(body: &Body, target: &Value) -> Result<Joints, String> {
    match target {
        Value::Pose(pose) => {
            let near = body.motion.target();
            body.motion.joints_for(*pose, &near).ok_or_else(|| "no inverse kinematics: out of reach".to_owned())
        }
        other => other.six(),
    }
}

fn is_within_limits(body: &Body, target: &Value) -> bool {
    joints_of(body, target).is_ok_and(|joints| body.is_within_limits(&joints))
}

fn start_move(body: &mut Body, arguments: &Arguments<'_>) -> Result<Call, String> {
    let timed = arguments.get(3).map_or(Ok(0.0), Value::number)?;
    if timed != 0.0 {
        return Err(format!("`{}` with a time is not simulated", arguments.name));
    }
    let joints = joints_of(body, arguments.need(0)?)?;
    if !body.is_within_limits(&joints) {
        return Err(format!("`{}`: the target is outside the safety limits", arguments.name));
    }
    if arguments.name == "movej" {
        let (acceleration, speed) = (arguments.positive(1, 1.4)?, arguments.positive(2, 1.05)?);
        body.motion.start_joint_move(joints, speed.min(std::f64::consts::PI), acceleration);
    } else {
        let (acceleration, speed) = (arguments.positive(1, 1.2)?, arguments.positive(2, 0.25)?);
        body.motion.start_line(&joints, speed, acceleration);
    }
    Ok(Call::UntilAtRest)
}

fn stop(body: &mut Body, arguments: &Arguments<'_>) -> Result<Call, String> {
    let given = arguments.positive(0, 2.0)?;
    let speeds = body.motion.target_speed();
    let deceleration_rad_s2 = if arguments.name == "stopj" {
        given
    } else {
        // In m/s2: scaled to the leading joint by the speeds of now.
        let [x, y, z, ..] = body.motion.tcp_speed(&body.motion.target(), &speeds);
        let tcp_speed_m_s = (x * x + y * y + z * z).sqrt().max(1e-3);
        given * super::super::motion::largest(&speeds) / tcp_speed_m_s
    };
    if body.motion.is_busy() {
        body.motion.stop(deceleration_rad_s2);
    }
    Ok(Call::UntilAtRest)
}

fn inverse(body: &Body, arguments: &Arguments<'_>) -> Result<Value, String> {
    let near = arguments.get(1).map_or(Ok(body.motion.target()), Value::six)?;
    let joints = body.motion.joints_for(arguments.need(0)?.six()?, &near);
    joints.as_ref().map(list).ok_or_else(|| "get_inverse_kin: out of reach".to_owned())
}

fn set_watchdog(body: &mut Body, arguments: &Arguments<'_>) -> Result<Value, String> {
    let variable = arguments.need(0)?.text();
    let slot = body.inputs.find(&variable).ok_or_else(|| format!("`{variable}` is not an RTDE input"))?;
    let frequency_hz = arguments.positive(1, 10.0)?;
    let action = match arguments.get(2).map(Value::text).as_deref() {
        Some("ignore") => WatchdogAction::Ignore,
        None | Some("pause") => WatchdogAction::Pause,
        Some("stop") => WatchdogAction::Stop,
        Some(other) => return Err(format!("`{other}` is not a watchdog action")),
    };
    let period_ticks = Body::ticks_of(1.0 / frequency_hz);
    body.watchdogs.retain(|w| w.slot != slot);
    body.watchdogs.push(Watchdog { slot, period_ticks, since_tick: body.tick, action });
    Ok(Value::Bool(true))
}

fn norm(value: &Value) -> Result<Value, String> {
    let squares: Result<f64, String> = match value {
        Value::List(items) => items.iter().map(|v| v.number().map(|n| n * n)).sum(),
        Value::Pose([x, y, z, ..]) => Ok(x * x + y * y + z * z),
        other => other.number().map(|n| n * n),
    };
    Ok(Value::Float(squares?.sqrt()))
}

fn set_digital_out(body: &mut Body, arguments: &Arguments<'_>) -> Result<Value, String> {
    let bit = arguments.bit(0)?;
    if arguments.need(1)?.truth()? {
        body.digital_outputs |= bit;
    } else {
        body.digital_outputs &= !bit;
    }
    Ok(Value::Nothing)
}

fn register(body: &mut Body, arguments: &Arguments<'_>) -> Result<Value, String> {
    let address = arguments.need(0)?.index()?;
    let out = || format!("there is no register {address}");
    match arguments.name {
        "read_input_integer_register" => Ok(Value::Int(body.inputs.int_register(address))),
        "read_input_float_register" => Ok(Value::Float(body.inputs.double_register(address))),
        "write_output_integer_register" => {
            let value = arguments.number(1)?;
            *body.output_int.get_mut(address).ok_or_else(out)? = value as i32;
            Ok(Value::Nothing)
        }
        "write_output_float_register" => {
            let value = arguments.number(1)?;
            *body.output_double.get_mut(address).ok_or_else(out)? = value;
            Ok(Value::Nothing)
        }
        other => Err(format!("function `{other}` is not known")),
    }
}
