//! Digital and analog outputs and the bit registers, and how RTDE inputs set them.

use super::body::Body;
use crate::devices::rtde::Value;

/// Bit registers of each direction: 0 to 63 for fieldbuses, 64 to 127 for RTDE clients.
pub(super) const BIT_REGISTERS: usize = 128;

/// Voltage and current at 1, V and A.
const FULL_V: f64 = 10.0;
const FULL_A: f64 = 0.02;
/// Smallest current of the current domain, A.
const ZERO_A: f64 = 0.004;

/// Outputs other than the digital ones.
#[derive(Debug, Default)]
pub(super) struct Io {
    bits: u128,
    analog: [f64; 2],
    volts: [bool; 2],
}

impl Io {
    pub(super) fn bit(&self, index: usize) -> bool {
        index < BIT_REGISTERS && self.bits >> index & 1 != 0
    }

    pub(super) fn set_bit(&mut self, index: usize, on: bool) {
        if index < BIT_REGISTERS {
            self.bits = self.bits & !(1 << index) | u128::from(on) << index;
        }
    }

    /// Bit registers 0 to 31 or 32 to 63.
    pub(super) fn word(&self, second: bool) -> u32 {
        (self.bits >> if second { 32 } else { 0 }) as u32
    }

    /// Output as a fraction of its range.
    pub(super) fn analog_fraction(&self, index: usize) -> f64 {
        self.analog.get(index).copied().unwrap_or(0.0)
    }

    /// Output in V, or in A.
    pub(super) fn analog(&self, index: usize) -> f64 {
        let fraction = self.analog_fraction(index);
        if self.volts.get(index) == Some(&true) { fraction * FULL_V } else { ZERO_A + fraction * (FULL_A - ZERO_A) }
    }

    /// Domains of the analog outputs: a bit is set for V, not set for A.
    pub(super) fn analog_types(&self) -> u32 {
        // The lower two bits are those of the inputs, which are in V.
        0b11 | u32::from(self.volts[0]) << 2 | u32::from(self.volts[1]) << 3
    }

    pub(super) fn set_analog_fraction(&mut self, index: usize, fraction: f64) {
        if let Some(output) = self.analog.get_mut(index) {
            *output = fraction.clamp(0.0, 1.0);
        }
    }

    pub(super) fn set_analog_domain(&mut self, index: usize, volts: bool) {
        if let Some(output) = self.volts.get_mut(index) {
            *output = volts;
        }
    }
}

/// Masks and values of digital outputs, and the first bit of the group.
const DIGITAL: [(&str, &str, u32); 3] = [
    ("standard_digital_output_mask", "standard_digital_output", 0),
    ("configurable_digital_output_mask", "configurable_digital_output", 8),
    ("tool_digital_output_mask", "tool_digital_output", 16),
];

/// Does what an input package asks for that has just been taken; `slots` are those it brought.
pub(super) fn apply(body: &mut Body, slots: &[usize]) {
    let brought = |body: &Body, name: &str| {
        let slot = body.inputs.find(name).filter(|slot| slots.contains(slot))?;
        body.inputs.value(slot)
    };
    for (mask, value, first) in DIGITAL {
        if let (Some(Value::Uint8(mask)), Some(Value::Uint8(value))) = (brought(body, mask), brought(body, value)) {
            let (mask, value) = (u64::from(mask) << first, u64::from(value) << first);
            body.digital_outputs = body.digital_outputs & !mask | value & mask;
        }
    }
    let slider = (brought(body, "speed_slider_mask"), brought(body, "speed_slider_fraction"));
    if let (Some(Value::Uint32(1)), Some(Value::Double(fraction))) = slider
        && (0.0..=1.0).contains(&fraction)
    {
        body.config.speed_fraction = fraction;
    }
    let analog = (brought(body, "standard_analog_output_mask"), brought(body, "standard_analog_output_type"));
    let (Some(Value::Uint8(mask)), Some(Value::Uint8(types))) = analog else { return };
    for index in 0..2 {
        let fraction = brought(body, &format!("standard_analog_output_{index}"));
        if let Some(Value::Double(fraction)) = fraction.filter(|_| mask >> index & 1 != 0) {
            body.io.set_analog_fraction(index, fraction);
            body.io.set_analog_domain(index, types >> index & 1 != 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::devices::sim::ur::config::{Individual, SimUrConfig};

    #[test]
    fn masks_choose_which_outputs_change() {
        let config = SimUrConfig::default();
        let mut body = Body::new(&config, &Individual::draw(&config, 1), 1);
        body.digital_outputs = 0b11;
        let mut bring = |names: [&str; 2], values: [Value; 2]| {
            let slots: Vec<_> = names.iter().map(|name| body.inputs.find(name).unwrap()).collect();
            slots.iter().zip(values).for_each(|(slot, value)| body.inputs.set(*slot, value, 1));
            apply(&mut body, &slots);
            (body.digital_outputs, body.config.speed_fraction)
        };
        let digital = |mask, value| [Value::Uint8(mask), Value::Uint8(value)];
        let standard = ["standard_digital_output_mask", "standard_digital_output"];
        assert_eq!(bring(standard, digital(0b110, 0b100)).0, 0b101);
        // A package that does not bring them leaves them alone.
        assert_eq!(bring(["tool_digital_output_mask", "tool_digital_output"], digital(2, 2)).0, 1 << 17 | 0b101);
        let slider = ["speed_slider_mask", "speed_slider_fraction"];
        assert_eq!(bring(slider, [Value::Uint32(1), Value::Double(0.4)]).1, 0.4);
        assert_eq!(bring(slider, [Value::Uint32(0), Value::Double(0.9)]).1, 0.4);
        assert_eq!(bring(slider, [Value::Uint32(1), Value::Double(1.9)]).1, 0.4);
        let analog = ["standard_analog_output_mask", "standard_analog_output_type"];
        let names: Vec<_> = analog.iter().chain(&["standard_analog_output_1"]).collect();
        let slots: Vec<_> = names.iter().map(|name| body.inputs.find(name).unwrap()).collect();
        let values = [Value::Uint8(2), Value::Uint8(2), Value::Double(0.25)];
        slots.iter().zip(values).for_each(|(slot, value)| body.inputs.set(*slot, value, 1));
        apply(&mut body, &slots);
        assert_eq!((body.io.analog(0), body.io.analog(1)), (ZERO_A, 2.5));
        body.io.set_bit(127, true);
        body.io.set_bit(33, true);
        body.io.set_bit(127, false);
        assert_eq!((body.io.word(false), body.io.word(true), body.io.bit(127)), (0, 2, false));
    }
}
