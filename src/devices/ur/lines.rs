//! Bits between the controller and others: digital outputs by mask and value, and bit registers.

use std::collections::BTreeMap;

use super::connection::Field;
use crate::config::Line;
use crate::devices::rtde::{DataType, Value};

/// The three groups of digital outputs, in the order of their bits.
const GROUPS: [(&str, u8, u8); 3] = [("standard", 0, 7), ("configurable", 8, 15), ("tool", 16, 17)];

/// The bits that we set, with what they are now.
#[derive(Debug, Clone, Default)]
pub(super) struct Lines {
    lines: Vec<(Line, bool)>,
}

impl Lines {
    pub(super) fn new(lines: impl IntoIterator<Item = Line>) -> Self {
        Self { lines: lines.into_iter().map(|line| (line, false)).collect() }
    }

    pub(super) fn set(&mut self, line: Line, on: bool) {
        self.lines.iter_mut().filter(|(l, _)| *l == line).for_each(|(_, value)| *value = on);
    }

    /// Input fields of the controller, in the order of [`Lines::values`].
    pub(super) fn fields(&self) -> Vec<Field> {
        let mut fields: Vec<Field> = Vec::new();
        for name in self.groups().keys() {
            fields.push((format!("{name}_digital_output_mask"), DataType::Uint8));
            fields.push((format!("{name}_digital_output"), DataType::Uint8));
        }
        fields.extend(self.registers().map(|(n, _)| (format!("input_bit_register_{n}"), DataType::Bool)));
        fields
    }

    pub(super) fn values(&self) -> Vec<Value> {
        let groups = self.groups();
        let masked = groups.values().flat_map(|(mask, value)| [Value::Uint8(*mask), Value::Uint8(*value)]);
        masked.chain(self.registers().map(|(_, on)| Value::Bool(on))).collect()
    }

    /// Mask and value of each group that has a line of ours.
    fn groups(&self) -> BTreeMap<&'static str, (u8, u8)> {
        let mut groups = BTreeMap::new();
        for (line, on) in &self.lines {
            let Line::DigitalOutput(number) = *line else { continue };
            let Some((name, first, _)) = GROUPS.iter().find(|(_, _, last)| number <= *last) else { continue };
            let bit = 1 << (number - first);
            let (mask, value) = groups.entry(*name).or_insert((0, 0));
            *mask |= bit;
            *value |= if *on { bit } else { 0 };
        }
        groups
    }

    fn registers(&self) -> impl Iterator<Item = (u8, bool)> {
        self.lines.iter().filter_map(|(line, on)| match line {
            Line::BitRegister(number) => Some((*number, *on)),
            Line::DigitalOutput(_) => None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outputs_of_a_group_share_mask_and_value() {
        let (a, b, c) = (Line::DigitalOutput(4), Line::DigitalOutput(1), Line::DigitalOutput(17));
        let mut lines = Lines::new([a, b, c, Line::BitRegister(70)]);
        lines.set(b, true);
        lines.set(Line::BitRegister(70), true);
        let names: Vec<_> = lines.fields().into_iter().map(|(name, _)| name).collect();
        let known = ["standard_digital_output_mask", "standard_digital_output", "tool_digital_output_mask"];
        assert_eq!(names[..3], known);
        assert_eq!(names[3..], ["tool_digital_output", "input_bit_register_70"]);
        let known = [Value::Uint8(0b1_0010), Value::Uint8(0b10), Value::Uint8(2), Value::Uint8(0), Value::Bool(true)];
        assert_eq!(lines.values(), known);
        assert!(Lines::default().fields().is_empty() && Lines::default().values().is_empty());
    }
}
