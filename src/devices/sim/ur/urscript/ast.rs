//! What a program is made of.

use std::rc::Rc;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unary {
    Minus,
    Not,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Binary {
    Or,
    And,
    Xor,
    Equal,
    Unequal,
    Less,
    LessEqual,
    Greater,
    GreaterEqual,
    Plus,
    Minus,
    Times,
    Over,
    Modulo,
}

#[derive(Debug)]
pub(super) struct Argument {
    pub(super) name: Option<String>,
    pub(super) value: Expr,
}

#[derive(Debug)]
pub(super) enum Expr {
    Int(i32),
    Float(f64),
    Bool(bool),
    Text(String),
    Name(String),
    List(Vec<Expr>),
    Pose(Vec<Expr>),
    Struct(Vec<(String, Expr)>),
    Unary(Unary, Box<Expr>),
    Binary(Binary, Box<Expr>, Box<Expr>),
    Part(Box<Expr>, Box<Access>),
    Call { name: String, arguments: Vec<Argument> },
    Run { name: String, arguments: Vec<Argument> },
}

/// One step into a list, pose or struct.
#[derive(Debug)]
pub(super) enum Access {
    Index(Expr),
    Member(String),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Place {
    Nearest,
    Global,
    Local,
}

pub(super) type Block = Vec<Statement>;

#[derive(Debug)]
pub(super) struct Statement {
    pub(super) line: usize,
    pub(super) kind: Kind,
}

#[derive(Debug)]
pub(super) enum Kind {
    Assign { place: Place, name: String, path: Vec<Access>, value: Expr },
    Expr(Expr),
    If { branches: Vec<(Expr, Block)>, otherwise: Block },
    While { condition: Expr, body: Block },
    Return(Option<Expr>),
    Break,
    Continue,
    Pass,
    Halt,
    Def(Rc<Function>),
    Thread(Rc<Function>),
    Join(Expr),
    Kill(Expr),
    EnterCritical,
    ExitCritical,
}

#[derive(Debug)]
pub(super) struct Function {
    pub(super) name: String,
    pub(super) parameters: Vec<String>,
    pub(super) body: Block,
}

/// An uploaded text.
#[derive(Debug)]
pub(super) struct Upload {
    pub(super) main: Function,
    /// Whether it is a `sec`: it takes no time and leaves the running program alone.
    pub(super) secondary: bool,
}
