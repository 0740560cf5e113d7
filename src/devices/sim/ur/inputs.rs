//! The input fields of the simulated controller: values, owners and the time of the last update.

use std::collections::HashMap;

use crate::devices::rtde::{DataType, FieldAnswer, Value};

/// Registers of each numeric kind.
pub(super) const REGISTERS: usize = 48;

/// Number of a client.
pub(super) type ClientId = u64;

const PLAIN: [(&str, DataType); 15] = [
    ("speed_slider_mask", DataType::Uint32),
    ("speed_slider_fraction", DataType::Double),
    ("standard_digital_output_mask", DataType::Uint8),
    ("standard_digital_output", DataType::Uint8),
    ("configurable_digital_output_mask", DataType::Uint8),
    ("configurable_digital_output", DataType::Uint8),
    ("tool_digital_output_mask", DataType::Uint8),
    ("tool_digital_output", DataType::Uint8),
    ("standard_analog_output_mask", DataType::Uint8),
    ("standard_analog_output_type", DataType::Uint8),
    ("standard_analog_output_0", DataType::Double),
    ("standard_analog_output_1", DataType::Double),
    ("external_force_torque", DataType::Vector6d),
    ("input_bit_registers0_to_31", DataType::Uint32),
    ("input_bit_registers32_to_63", DataType::Uint32),
];

#[derive(Debug)]
struct Slot {
    value: Value,
    owner: Option<ClientId>,
    updated_tick: u64,
}

/// All input fields; a field is named by its slot after [`Inputs::find`].
#[derive(Debug)]
pub(super) struct Inputs {
    slots: Vec<Slot>,
    by_name: HashMap<String, usize>,
}

impl Inputs {
    pub(super) fn new() -> Self {
        let mut inputs = Self { slots: Vec::new(), by_name: HashMap::new() };
        for i in 0..REGISTERS {
            inputs.add(format!("input_int_register_{i}"), DataType::Int32);
        }
        for i in 0..REGISTERS {
            inputs.add(format!("input_double_register_{i}"), DataType::Double);
        }
        for i in 64..128 {
            inputs.add(format!("input_bit_register_{i}"), DataType::Bool);
        }
        PLAIN.iter().for_each(|(name, data_type)| inputs.add((*name).into(), *data_type));
        inputs
    }

    fn add(&mut self, name: String, data_type: DataType) {
        self.by_name.insert(name, self.slots.len());
        self.slots.push(Slot { value: zero(data_type), owner: None, updated_tick: 0 });
    }

    pub(super) fn find(&self, name: &str) -> Option<usize> {
        self.by_name.get(name).copied()
    }

    pub(super) fn data_type(&self, slot: usize) -> Option<DataType> {
        self.slots.get(slot).map(|s| s.value.data_type())
    }

    /// What a client that asks for this input is told.
    pub(super) fn offer(&self, name: &str, client: ClientId) -> FieldAnswer {
        let Some(slot) = self.find(name).and_then(|i| self.slots.get(i)) else { return FieldAnswer::NotFound };
        let free = slot.owner.is_none_or(|owner| owner == client);
        if free { FieldAnswer::Typed(slot.value.data_type()) } else { FieldAnswer::InUse }
    }

    pub(super) fn claim(&mut self, slots: &[usize], client: ClientId) {
        for slot in slots {
            if let Some(slot) = self.slots.get_mut(*slot) {
                slot.owner = Some(client);
            }
        }
    }

    /// Frees what a client owned; the values stay.
    pub(super) fn release(&mut self, client: ClientId) {
        self.slots.iter_mut().filter(|s| s.owner == Some(client)).for_each(|s| s.owner = None);
    }

    pub(super) fn set(&mut self, slot: usize, value: Value, tick: u64) {
        if let Some(slot) = self.slots.get_mut(slot) {
            (slot.value, slot.updated_tick) = (value, tick);
        }
    }

    pub(super) fn value(&self, slot: usize) -> Option<Value> {
        self.slots.get(slot).map(|s| s.value)
    }

    pub(super) fn updated_tick(&self, slot: usize) -> u64 {
        self.slots.get(slot).map_or(0, |s| s.updated_tick)
    }

    /// Value of `input_int_register_` and this index; 0 where there is none.
    pub(super) fn int_register(&self, index: usize) -> i32 {
        match self.value(index) {
            Some(Value::Int32(v)) => v,
            _ => 0,
        }
    }

    /// Value of `input_double_register_` and this index; 0 where there is none.
    pub(super) fn double_register(&self, index: usize) -> f64 {
        // They were added right behind the integer registers.
        match self.value(REGISTERS.saturating_add(index)) {
            Some(Value::Double(v)) => v,
            _ => 0.0,
        }
    }
}

/// The value of a field that nobody has set.
pub(super) fn zero(data_type: DataType) -> Value {
    match data_type {
        DataType::Bool => Value::Bool(false),
        DataType::Uint8 => Value::Uint8(0),
        DataType::Uint32 => Value::Uint32(0),
        DataType::Uint64 => Value::Uint64(0),
        DataType::Int32 => Value::Int32(0),
        DataType::Double => Value::Double(0.0),
        DataType::Vector3d => Value::Vector3d([0.0; 3]),
        DataType::Vector6d => Value::Vector6d([0.0; 6]),
        DataType::Vector6Int32 => Value::Vector6Int32([0; 6]),
        DataType::Vector6Uint32 => Value::Vector6Uint32([0; 6]),
    }
}
