//! Values of variables and what operators do with them.

use super::ast::{Binary, Unary};

/// Numbers, texts and the like in one value; a larger one is refused, so that memory stays bounded.
const MAX_WEIGHT: usize = 2000;

/// Lists and structs inside each other.
const MAX_NESTING: usize = 8;

/// Longest text, bytes.
const MAX_TEXT_BYTES: usize = 4096;

/// Bytes of a text that weigh as much as a number.
const TEXT_BYTES_PER_WEIGHT: usize = 32;

/// Number of a thread.
pub(super) type ThreadId = u64;

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Value {
    Nothing,
    Bool(bool),
    Int(i32),
    Float(f64),
    Text(String),
    List(Vec<Value>),
    Pose([f64; 6]),
    Struct(Vec<(String, Value)>),
    Thread(ThreadId),
}

/// One step into a value.
#[derive(Debug)]
pub(super) enum Step {
    Index(usize),
    Member(String),
}

impl Value {
    /// Refuses a value that is too large or too deep.
    pub(super) fn checked(self) -> Result<Self, String> {
        if let Self::Text(text) = &self
            && text.len() > MAX_TEXT_BYTES
        {
            return Err(format!("a string of {} bytes, at most {MAX_TEXT_BYTES} are simulated", text.len()));
        }
        check_weight(self.weight())?;
        if self.nesting() > MAX_NESTING {
            return Err(format!("lists nested deeper than {MAX_NESTING}"));
        }
        Ok(self)
    }

    /// How much memory it takes, in values.
    pub(super) fn weight(&self) -> usize {
        match self {
            Self::List(items) => 1 + items.iter().map(Self::weight).sum::<usize>(),
            Self::Struct(members) => 1 + members.iter().map(|(_, value)| 1 + value.weight()).sum::<usize>(),
            Self::Text(text) => 1 + text.len() / TEXT_BYTES_PER_WEIGHT,
            Self::Nothing | Self::Bool(_) | Self::Int(_) | Self::Float(_) | Self::Pose(_) | Self::Thread(_) => 1,
        }
    }

    fn nesting(&self) -> usize {
        match self {
            Self::List(items) => 1 + items.iter().map(Self::nesting).max().unwrap_or(0),
            Self::Struct(members) => 1 + members.iter().map(|(_, value)| value.nesting()).max().unwrap_or(0),
            _ => 0,
        }
    }

    fn kind(&self) -> &'static str {
        match self {
            Self::Nothing => "nothing",
            Self::Bool(_) => "a bool",
            Self::Int(_) => "an integer",
            Self::Float(_) => "a float",
            Self::Text(_) => "a string",
            Self::List(_) => "a list",
            Self::Pose(_) => "a pose",
            Self::Struct(_) => "a struct",
            Self::Thread(_) => "a thread",
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

    pub(super) fn integer(&self) -> Result<i32, String> {
        match self {
            Self::Int(v) => Ok(*v),
            // A register takes what is whole.
            Self::Float(v) if v.fract() == 0.0 && v.abs() <= f64::from(i32::MAX) => Ok(*v as i32),
            other => Err(format!("{} where an integer is needed", other.kind())),
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
            Self::Struct(members) => {
                let members: Vec<_> = members.iter().map(|(name, value)| format!("{name}: {}", value.text())).collect();
                format!("{{{}}}", members.join(", "))
            }
            Self::Thread(id) => format!("thread {id}"),
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

    /// A copy of what is one step inside.
    pub(super) fn part(&self, step: &Step) -> Result<Self, String> {
        match (self, step) {
            (Self::List(items), Step::Index(i)) => items.get(*i).cloned().ok_or_else(|| out_of_range(*i)),
            (Self::Pose(v), Step::Index(i)) => v.get(*i).map(|n| Self::Float(*n)).ok_or_else(|| out_of_range(*i)),
            (Self::Struct(members), Step::Member(name)) => {
                let found = members.iter().find(|(n, _)| n == name);
                found.map(|(_, value)| value.clone()).ok_or_else(|| format!("the struct has no `{name}`"))
            }
            (other, Step::Index(_)) => Err(format!("{} has no items", other.kind())),
            (other, Step::Member(_)) => Err(format!("{} has no members", other.kind())),
        }
    }

    /// A copy of what is so many steps inside.
    pub(super) fn at(&self, path: &[Step]) -> Result<Self, String> {
        let Some((first, rest)) = path.split_first() else { return Ok(self.clone()) };
        match (self, first) {
            // Only the innermost part is copied.
            (Self::List(items), Step::Index(i)) => items.get(*i).ok_or_else(|| out_of_range(*i))?.at(rest),
            _ => self.part(first)?.at(rest),
        }
    }

    /// Replaces what is so many steps inside; `value` where there is no step.
    pub(super) fn set(&mut self, path: &[Step], value: Self) -> Result<(), String> {
        let Some((first, rest)) = path.split_first() else {
            *self = value;
            return Ok(());
        };
        match (self, first) {
            (Self::List(items), Step::Index(i)) => items.get_mut(*i).ok_or_else(|| out_of_range(*i))?.set(rest, value),
            (Self::Pose(v), Step::Index(i)) if rest.is_empty() => {
                *v.get_mut(*i).ok_or_else(|| out_of_range(*i))? = value.number()?;
                Ok(())
            }
            (Self::Struct(members), Step::Member(name)) => {
                let found = members.iter_mut().find(|(n, _)| n == name);
                found.ok_or_else(|| format!("the struct has no `{name}`"))?.1.set(rest, value)
            }
            (other, Step::Index(_)) => Err(format!("{} has no items", other.kind())),
            (other, Step::Member(_)) => Err(format!("{} has no members", other.kind())),
        }
    }
}

/// Refuses more values in one than are kept.
pub(super) fn check_weight(weight: usize) -> Result<(), String> {
    if weight > MAX_WEIGHT {
        return Err(format!("a list with {weight} values, at most {MAX_WEIGHT} are simulated"));
    }
    Ok(())
}

fn out_of_range(index: usize) -> String {
    format!("index {index} is out of range")
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
