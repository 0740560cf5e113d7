//! Numbers and lists.

use super::{Arguments, Builtin, value};
use crate::devices::sim::ur::body::Body;
use crate::devices::sim::ur::noise::{self, Stream};
use crate::devices::sim::ur::urscript::value::Value;

pub(super) const TABLE: &[Builtin] = &[
    value("norm", &["a"], norm),
    value("abs", &["a"], |_, a| match a.need(0)? {
        Value::Int(v) => Ok(Value::Int(v.wrapping_abs())),
        other => other.number().map(|v| Value::Float(v.abs())),
    }),
    value("sqrt", &["a"], |_, a| function(a, f64::sqrt)),
    value("sin", &["f"], |_, a| function(a, f64::sin)),
    value("cos", &["f"], |_, a| function(a, f64::cos)),
    value("tan", &["f"], |_, a| function(a, f64::tan)),
    value("asin", &["f"], |_, a| function(a, f64::asin)),
    value("acos", &["f"], |_, a| function(a, f64::acos)),
    value("atan", &["f"], |_, a| function(a, f64::atan)),
    value("atan2", &["x", "y"], |_, a| Ok(Value::Float(a.number(0)?.atan2(a.number(1)?)))),
    value("d2r", &["d"], |_, a| function(a, f64::to_radians)),
    value("r2d", &["r"], |_, a| function(a, f64::to_degrees)),
    value("pow", &["base", "exponent"], |_, a| finite(a, a.number(0)?.powf(a.number(1)?))),
    value("log", &["b", "f"], |_, a| finite(a, a.number(1)?.log(a.number(0)?))),
    value("floor", &["f"], |_, a| whole(a, f64::floor)),
    value("ceil", &["f"], |_, a| whole(a, f64::ceil)),
    value("random", &[], random),
    value("get_list_length", &["v"], length),
    value("length", &["v"], length),
    value("make_list", &["length", "initial_value"], |_, a| {
        let length = a.need(0)?.index()?;
        // Refused before memory is asked for.
        super::super::value::check_weight(length.saturating_mul(a.need(1)?.weight()))?;
        Ok(Value::List(vec![a.need(1)?.clone(); length]))
    }),
    value("integer_to_binary_list", &["x"], |_, a| {
        let number = a.need(0)?.integer()?;
        Ok(Value::List((0..32).map(|bit| Value::Bool(number >> bit & 1 != 0)).collect()))
    }),
];

fn finite(arguments: &Arguments<'_>, value: f64) -> Result<Value, String> {
    if value.is_finite() { Ok(Value::Float(value)) } else { Err(format!("`{}` has no value there", arguments.name)) }
}

fn function(arguments: &Arguments<'_>, function: fn(f64) -> f64) -> Result<Value, String> {
    finite(arguments, function(arguments.number(0)?))
}

fn whole(arguments: &Arguments<'_>, round: fn(f64) -> f64) -> Result<Value, String> {
    let rounded = round(arguments.number(0)?);
    let fits = rounded >= f64::from(i32::MIN) && rounded <= f64::from(i32::MAX);
    if fits { Ok(Value::Int(rounded as i32)) } else { Err(format!("`{}` of {rounded} is too large", arguments.name)) }
}

fn norm(_: &mut Body, arguments: &Arguments<'_>) -> Result<Value, String> {
    let squares: Result<f64, String> = match arguments.need(0)? {
        Value::List(items) => items.iter().map(|v| v.number().map(|n| n * n)).sum(),
        Value::Pose([x, y, z, ..]) => Ok(x * x + y * y + z * z),
        other => other.number().map(|n| n * n),
    };
    Ok(Value::Float(squares?.sqrt()))
}

fn length(_: &mut Body, arguments: &Arguments<'_>) -> Result<Value, String> {
    match arguments.need(0)? {
        Value::List(items) => Ok(Value::Int(items.len() as i32)),
        Value::Pose(_) => Ok(Value::Int(6)),
        _ => Err(format!("`{}` takes a list", arguments.name)),
    }
}

fn random(body: &mut Body, _: &Arguments<'_>) -> Result<Value, String> {
    let mut rng = noise::generator(body.seed, Stream::Script, body.tick);
    Ok(Value::Float(noise::between(&mut rng, [0.0, 1.0])))
}
