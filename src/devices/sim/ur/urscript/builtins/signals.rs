//! Digital and analog signals, and the registers.

use super::{Arguments, Builtin, nothing, value};
use crate::devices::rtde::Value as Rtde;
use crate::devices::sim::ur::body::Body;
use crate::devices::sim::ur::inputs::REGISTERS;
use crate::devices::sim::ur::io::BIT_REGISTERS;
use crate::devices::sim::ur::urscript::value::Value;

/// Standard, configurable and tool signals: how many, and the first bit.
const ALL: (usize, usize) = (18, 0);
const STANDARD: (usize, usize) = (8, 0);
const CONFIGURABLE: (usize, usize) = (8, 8);
const TOOL: (usize, usize) = (2, 16);

const N_B: &[&str] = &["n", "b"];
const N: &[&str] = &["n"];

pub(super) const TABLE: &[Builtin] = &[
    value("set_digital_out", N_B, |b, a| set_digital(b, a, ALL)),
    value("set_standard_digital_out", N_B, |b, a| set_digital(b, a, STANDARD)),
    value("set_configurable_digital_out", N_B, |b, a| set_digital(b, a, CONFIGURABLE)),
    value("set_tool_digital_out", N_B, |b, a| set_digital(b, a, TOOL)),
    value("get_digital_out", N, |b, a| bit(b.digital_outputs, a, ALL)),
    value("get_standard_digital_out", N, |b, a| bit(b.digital_outputs, a, STANDARD)),
    value("get_configurable_digital_out", N, |b, a| bit(b.digital_outputs, a, CONFIGURABLE)),
    value("get_tool_digital_out", N, |b, a| bit(b.digital_outputs, a, TOOL)),
    value("get_digital_in", N, |b, a| bit(b.digital_inputs, a, ALL)),
    value("get_standard_digital_in", N, |b, a| bit(b.digital_inputs, a, STANDARD)),
    value("get_configurable_digital_in", N, |b, a| bit(b.digital_inputs, a, CONFIGURABLE)),
    value("get_tool_digital_in", N, |b, a| bit(b.digital_inputs, a, TOOL)),
    value("set_analog_out", &["n", "f"], set_analog),
    value("set_standard_analog_out", &["n", "f"], set_analog),
    value("set_analog_outputdomain", &["port", "domain"], |b, a| {
        b.io.set_analog_domain(a.below(0, 2)?, a.below(1, 2)? == 1);
        nothing()
    }),
    value("get_analog_in", N, |_, a| a.below(0, 4).map(|_| Value::Float(0.0))),
    value("get_standard_analog_in", N, |_, a| a.below(0, 2).map(|_| Value::Float(0.0))),
    value("get_standard_analog_out", N, |b, a| Ok(Value::Float(b.io.analog_fraction(a.below(0, 2)?)))),
    value("read_input_integer_register", ADDRESS, |b, a| Ok(Value::Int(b.inputs.int_register(address(a)?)))),
    value("read_input_float_register", ADDRESS, |b, a| Ok(Value::Float(b.inputs.double_register(address(a)?)))),
    value("read_input_boolean_register", ADDRESS, input_bit),
    value("read_output_integer_register", ADDRESS, |b, a| Ok(Value::Int(b.output_int[address(a)?]))),
    value("read_output_float_register", ADDRESS, |b, a| Ok(Value::Float(b.output_double[address(a)?]))),
    value("read_output_boolean_register", ADDRESS, |b, a| Ok(Value::Bool(b.io.bit(a.below(0, BIT_REGISTERS)?)))),
    value("write_output_integer_register", ADDRESS_VALUE, |b, a| {
        b.output_int[address(a)?] = a.need(1)?.integer()?;
        nothing()
    }),
    value("write_output_float_register", ADDRESS_VALUE, |b, a| {
        b.output_double[address(a)?] = a.number(1)?;
        nothing()
    }),
    value("write_output_boolean_register", ADDRESS_VALUE, |b, a| {
        b.io.set_bit(a.below(0, BIT_REGISTERS)?, a.need(1)?.truth()?);
        nothing()
    }),
];

const ADDRESS: &[&str] = &["address"];
const ADDRESS_VALUE: &[&str] = &["address", "value"];

fn address(arguments: &Arguments<'_>) -> Result<usize, String> {
    arguments.below(0, REGISTERS)
}

fn mask(arguments: &Arguments<'_>, (count, first): (usize, usize)) -> Result<u64, String> {
    Ok(1 << (arguments.below(0, count)? + first))
}

fn bit(bits: u64, arguments: &Arguments<'_>, signals: (usize, usize)) -> Result<Value, String> {
    Ok(Value::Bool(bits & mask(arguments, signals)? != 0))
}

fn set_digital(body: &mut Body, arguments: &Arguments<'_>, signals: (usize, usize)) -> Result<Value, String> {
    let bit = mask(arguments, signals)?;
    if arguments.need(1)?.truth()? {
        body.digital_outputs |= bit;
    } else {
        body.digital_outputs &= !bit;
    }
    nothing()
}

fn set_analog(body: &mut Body, arguments: &Arguments<'_>) -> Result<Value, String> {
    let fraction = arguments.number(1)?;
    let fine = (0.0..=1.0).contains(&fraction);
    if !fine {
        return Err(format!("`{}`: {fraction} is not from 0 to 1", arguments.name));
    }
    body.io.set_analog_fraction(arguments.below(0, 2)?, fraction);
    nothing()
}

fn input_bit(body: &mut Body, arguments: &Arguments<'_>) -> Result<Value, String> {
    let address = arguments.below(0, BIT_REGISTERS)?;
    let word = |name: &str| match body.inputs.find(name).and_then(|slot| body.inputs.value(slot)) {
        Some(Rtde::Uint32(word)) => word >> (address % 32) & 1 != 0,
        Some(Rtde::Bool(bit)) => bit,
        _ => false,
    };
    Ok(Value::Bool(match address {
        0..32 => word("input_bit_registers0_to_31"),
        32..64 => word("input_bit_registers32_to_63"),
        _ => word(&format!("input_bit_register_{address}")),
    }))
}
