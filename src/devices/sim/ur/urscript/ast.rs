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
    Unary(Unary, Box<Expr>),
    Binary(Binary, Box<Expr>, Box<Expr>),
    Index(Box<Expr>, Box<Expr>),
    Call { name: String, arguments: Vec<Argument> },
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
    Assign { place: Place, name: String, index: Option<Expr>, value: Expr },
    Expr(Expr),
    If { branches: Vec<(Expr, Block)>, otherwise: Block },
    While { condition: Expr, body: Block },
    Return(Option<Expr>),
    Break,
    Continue,
    Pass,
    Halt,
    Def(Rc<Function>),
}

#[derive(Debug)]
pub(super) struct Function {
    pub(super) name: String,
    pub(super) parameters: Vec<String>,
    pub(super) body: Block,
}
