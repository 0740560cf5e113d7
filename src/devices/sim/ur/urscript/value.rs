//! Values of variables and what operators do with them.

use super::ast::{Binary, Unary};

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Value {
    Nothing,
    Bool(bool),
    Int(i32),
    Float(f64),
    Text(String),
    List(Vec<Value>),
    Pose([f64; 6]),
}

impl Value {
    fn kind(&self) -> &'static str {
        match self {
            Self::Nothing => "nothing",
            Self::Bool(_) => "a bool",
            Self::Int(_) => "an integer",
            Self::Float(_) => "a float",
            Self::Text(_) => "a string",
            Self::List(_) => "a list",
            Self::Pose(_) => "a pose",
        }
    }

    pub(super) fn number(&self) -> Result<f64, String> {
        match self {
            Self::Int(v) => Ok(f64::from(*v)),
            Self::Float(v) => Ok(*v),
            other => Err(format!("{} where a number is needed", other.kind())),
        }
    }

    pub(super) fn truth(&self) -> Result<bool, String> {
        match self {
            Self::Bool(v) => Ok(*v),
            other => Err(format!("{} where True or False is needed", other.kind())),
        }
    }

    pub(super) fn index(&self) -> Result<usize, String> {
        match self {
            Self::Int(v) => usize::try_from(*v).map_err(|_| format!("index {v} is negative")),
            other => Err(format!("{} where an index is needed", other.kind())),
        }
    }

    pub(super) fn text(&self) -> String {
        match self {
            Self::Nothing => String::new(),
            Self::Bool(v) => if *v { "True" } else { "False" }.to_owned(),
            Self::Int(v) => v.to_string(),
            Self::Float(v) => v.to_string(),
            Self::Text(v) => v.clone(),
            Self::List(items) => format!("[{}]", items.iter().map(Self::text).collect::<Vec<_>>().join(", ")),
            Self::Pose(v) => format!("p{v:?}"),
        }
    }

    /// Six numbers: a pose, or a list of joint positions.
    pub(super) fn six(&self) -> Result<[f64; 6], String> {
        match self {
            Self::Pose(v) => Ok(*v),
            Self::List(items) => six(items),
            other => Err(format!("{} where six numbers are needed", other.kind())),
        }
    }

    pub(super) fn item(&self, index: usize) -> Result<Self, String> {
        let found = match self {
            Self::List(items) => items.get(index).cloned(),
            Self::Pose(v) => v.get(index).copied().map(Self::Float),
            other => return Err(format!("{} has no items", other.kind())),
        };
        found.ok_or_else(|| format!("index {index} is out of range"))
    }

    pub(super) fn set_item(&mut self, index: usize, value: Self) -> Result<(), String> {
        let out = || format!("index {index} is out of range");
        match self {
            Self::List(items) => *items.get_mut(index).ok_or_else(out)? = value,
            Self::Pose(v) => *v.get_mut(index).ok_or_else(out)? = value.number()?,
            other => return Err(format!("{} has no items", other.kind())),
        }
        Ok(())
    }
}

/// Exactly six numbers.
pub(super) fn six(items: &[Value]) -> Result<[f64; 6], String> {
    let numbers: Result<Vec<f64>, String> = items.iter().map(Value::number).collect();
    numbers?.try_into().map_err(|found: Vec<f64>| format!("{} numbers where six are needed", found.len()))
}

pub(super) fn unary(operator: Unary, value: &Value) -> Result<Value, String> {
    match (operator, value) {
        (Unary::Minus, Value::Int(v)) => Ok(Value::Int(v.wrapping_neg())),
        (Unary::Minus, other) => other.number().map(|v| Value::Float(-v)),
        (Unary::Not, other) => other.truth().map(|v| Value::Bool(!v)),
    }
}

pub(super) fn binary(operator: Binary, left: &Value, right: &Value) -> Result<Value, String> {
    use Binary as B;
    match operator {
        B::Or => Ok(Value::Bool(left.truth()? | right.truth()?)),
        B::And => Ok(Value::Bool(left.truth()? & right.truth()?)),
        B::Xor => Ok(Value::Bool(left.truth()? ^ right.truth()?)),
        B::Equal => Ok(Value::Bool(equal(left, right))),
        B::Unequal => Ok(Value::Bool(!equal(left, right))),
        B::Less => Ok(Value::Bool(left.number()? < right.number()?)),
        B::LessEqual => Ok(Value::Bool(left.number()? <= right.number()?)),
        B::Greater => Ok(Value::Bool(left.number()? > right.number()?)),
        B::GreaterEqual => Ok(Value::Bool(left.number()? >= right.number()?)),
        B::Plus | B::Minus | B::Times | B::Over | B::Modulo => arithmetic(operator, left, right),
    }
}

fn equal(left: &Value, right: &Value) -> bool {
    match (left.number(), right.number()) {
        (Ok(a), Ok(b)) => a == b,
        _ => left == right,
    }
}

fn arithmetic(operator: Binary, left: &Value, right: &Value) -> Result<Value, String> {
    if let (Value::Int(a), Value::Int(b)) = (left, right) {
        match operator {
            Binary::Plus => return Ok(Value::Int(a.wrapping_add(*b))),
            Binary::Minus => return Ok(Value::Int(a.wrapping_sub(*b))),
            Binary::Times => return Ok(Value::Int(a.wrapping_mul(*b))),
            Binary::Modulo if *b != 0 => return Ok(Value::Int(a.wrapping_rem(*b))),
            _ => {}
        }
    }
    let (a, b) = (left.number()?, right.number()?);
    match operator {
        Binary::Plus => Ok(Value::Float(a + b)),
        Binary::Minus => Ok(Value::Float(a - b)),
        Binary::Times => Ok(Value::Float(a * b)),
        _ if b == 0.0 => Err("division by zero".into()),
        Binary::Over => Ok(Value::Float(a / b)),
        _ => Ok(Value::Float(a % b)),
    }
}
