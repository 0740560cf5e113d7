//! Recipes: the agreed order and types of the fields of a data package.

use bytes::{BufMut as _, Bytes, BytesMut};

use super::{CodecError, DataType, Package, Value, message::DATA_PACKAGE};

/// What the controller answers for one requested field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FieldAnswer {
    /// The field exists and has this type.
    Typed(DataType),
    /// The controller does not know the name.
    NotFound,
    /// Another client or a fieldbus owns the input.
    InUse,
}

impl FieldAnswer {
    /// The word on the wire.
    pub fn name(self) -> &'static str {
        match self {
            Self::Typed(data_type) => data_type.name(),
            Self::NotFound => "NOT_FOUND",
            Self::InUse => "IN_USE",
        }
    }

    pub(super) fn from_name(name: &str) -> Option<Self> {
        match name {
            "NOT_FOUND" => Some(Self::NotFound),
            "IN_USE" => Some(Self::InUse),
            typed => DataType::from_name(typed).map(Self::Typed),
        }
    }
}

/// An agreed recipe.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recipe {
    /// Number that opens every data package of this recipe.
    pub id: u8,
    /// Types in order.
    pub types: Vec<DataType>,
}

impl Recipe {
    /// Payload bytes of a data package, with the recipe number.
    pub fn payload_bytes(&self) -> usize {
        1 + self.types.iter().map(|t| t.size_bytes()).sum::<usize>()
    }

    /// A data package with these values; they must match the types one by one.
    pub fn encode(&self, values: &[Value]) -> Result<Bytes, CodecError> {
        let fits = self.types.len() == values.len() && self.types.iter().zip(values).all(|(t, v)| *t == v.data_type());
        if !fits {
            let found: Vec<_> = values.iter().map(|v| v.data_type().name()).collect();
            let asked: Vec<_> = self.types.iter().map(|t| t.name()).collect();
            let why = format!("values are {}, the recipe says {}", found.join(","), asked.join(","));
            return Err(CodecError::Encode { what: "data", why });
        }
        let mut payload = BytesMut::with_capacity(self.payload_bytes());
        payload.put_u8(self.id);
        values.iter().for_each(|v| v.encode(&mut payload));
        Package { kind: DATA_PACKAGE, payload: payload.freeze() }.to_bytes()
    }

    /// The values of a data package; `body` is what follows the recipe number and must fit exactly.
    pub fn decode(&self, body: &[u8]) -> Result<Vec<Value>, CodecError> {
        let expected = self.payload_bytes() - 1;
        if body.len() != expected {
            let why = format!("{} bytes of values, recipe {} has {expected}", body.len(), self.id);
            return Err(CodecError::Payload { what: "data", why });
        }
        let mut rest = body;
        Ok(self.types.iter().filter_map(|t| Value::decode(*t, &mut rest)).collect())
    }
}
