//! The data types of RTDE fields and their values.

use bytes::{Buf, BufMut};

/// Type of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DataType {
    /// 1 byte, 0 or 1.
    Bool,
    /// 1 byte.
    Uint8,
    /// 4 bytes.
    Uint32,
    /// 8 bytes.
    Uint64,
    /// 4 bytes.
    Int32,
    /// 8 bytes.
    Double,
    /// 3 doubles.
    Vector3d,
    /// 6 doubles.
    Vector6d,
    /// 6 of 4 bytes.
    Vector6Int32,
    /// 6 of 4 bytes.
    Vector6Uint32,
}

const NAMES: [(DataType, &str, usize); 10] = [
    (DataType::Bool, "BOOL", 1),
    (DataType::Uint8, "UINT8", 1),
    (DataType::Uint32, "UINT32", 4),
    (DataType::Uint64, "UINT64", 8),
    (DataType::Int32, "INT32", 4),
    (DataType::Double, "DOUBLE", 8),
    (DataType::Vector3d, "VECTOR3D", 24),
    (DataType::Vector6d, "VECTOR6D", 48),
    (DataType::Vector6Int32, "VECTOR6INT32", 24),
    (DataType::Vector6Uint32, "VECTOR6UINT32", 24),
];

impl DataType {
    /// All types.
    pub const ALL: [Self; 10] = {
        let mut all = [Self::Bool; 10];
        let mut i = 0;
        while i < all.len() {
            all[i] = NAMES[i].0;
            i += 1;
        }
        all
    };

    /// The type of this name on the wire.
    pub fn from_name(name: &str) -> Option<Self> {
        NAMES.iter().find(|(_, n, _)| *n == name).map(|(t, ..)| *t)
    }

    /// The name on the wire.
    pub fn name(self) -> &'static str {
        NAMES.iter().find(|(t, ..)| *t == self).map_or("", |(_, n, _)| n)
    }

    /// Bytes of one value.
    pub fn size_bytes(self) -> usize {
        NAMES.iter().find(|(t, ..)| *t == self).map_or(0, |(.., s)| *s)
    }
}

/// Value of a field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value {
    /// BOOL.
    Bool(bool),
    /// UINT8.
    Uint8(u8),
    /// UINT32.
    Uint32(u32),
    /// UINT64.
    Uint64(u64),
    /// INT32.
    Int32(i32),
    /// DOUBLE.
    Double(f64),
    /// VECTOR3D.
    Vector3d([f64; 3]),
    /// VECTOR6D.
    Vector6d([f64; 6]),
    /// VECTOR6INT32.
    Vector6Int32([i32; 6]),
    /// VECTOR6UINT32.
    Vector6Uint32([u32; 6]),
}

impl Value {
    /// Type of the value.
    pub fn data_type(&self) -> DataType {
        match self {
            Self::Bool(_) => DataType::Bool,
            Self::Uint8(_) => DataType::Uint8,
            Self::Uint32(_) => DataType::Uint32,
            Self::Uint64(_) => DataType::Uint64,
            Self::Int32(_) => DataType::Int32,
            Self::Double(_) => DataType::Double,
            Self::Vector3d(_) => DataType::Vector3d,
            Self::Vector6d(_) => DataType::Vector6d,
            Self::Vector6Int32(_) => DataType::Vector6Int32,
            Self::Vector6Uint32(_) => DataType::Vector6Uint32,
        }
    }

    /// Whether every number in it is finite; integers always are.
    pub fn is_finite(&self) -> bool {
        match self {
            Self::Double(v) => v.is_finite(),
            Self::Vector3d(v) => v.iter().all(|x| x.is_finite()),
            Self::Vector6d(v) => v.iter().all(|x| x.is_finite()),
            _ => true,
        }
    }

    /// Appends the value.
    pub(super) fn encode(&self, out: &mut impl BufMut) {
        match *self {
            Self::Bool(v) => out.put_u8(u8::from(v)),
            Self::Uint8(v) => out.put_u8(v),
            Self::Uint32(v) => out.put_u32(v),
            Self::Uint64(v) => out.put_u64(v),
            Self::Int32(v) => out.put_i32(v),
            Self::Double(v) => out.put_f64(v),
            Self::Vector3d(v) => v.iter().for_each(|x| out.put_f64(*x)),
            Self::Vector6d(v) => v.iter().for_each(|x| out.put_f64(*x)),
            Self::Vector6Int32(v) => v.iter().for_each(|x| out.put_i32(*x)),
            Self::Vector6Uint32(v) => v.iter().for_each(|x| out.put_u32(*x)),
        }
    }

    /// Takes a value off the front; `None` where too few bytes are left. Any BOOL but 0 is true.
    pub(super) fn decode(data_type: DataType, from: &mut impl Buf) -> Option<Self> {
        if from.remaining() < data_type.size_bytes() {
            return None;
        }
        Some(match data_type {
            DataType::Bool => Self::Bool(from.get_u8() != 0),
            DataType::Uint8 => Self::Uint8(from.get_u8()),
            DataType::Uint32 => Self::Uint32(from.get_u32()),
            DataType::Uint64 => Self::Uint64(from.get_u64()),
            DataType::Int32 => Self::Int32(from.get_i32()),
            DataType::Double => Self::Double(from.get_f64()),
            DataType::Vector3d => Self::Vector3d(std::array::from_fn(|_| from.get_f64())),
            DataType::Vector6d => Self::Vector6d(std::array::from_fn(|_| from.get_f64())),
            DataType::Vector6Int32 => Self::Vector6Int32(std::array::from_fn(|_| from.get_i32())),
            DataType::Vector6Uint32 => Self::Vector6Uint32(std::array::from_fn(|_| from.get_u32())),
        })
    }
}
