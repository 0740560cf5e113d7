//! A subset of URScript, enough for motion executors: lexer, parser, and an evaluator that runs as a
//! coroutine, one slice per controller cycle.
//!
//! Understood: `def`, `if`/`elif`/`else`, `while`, `return`, `break`, `continue`, `pass`, `halt`,
//! `global`, `local`, numbers, strings, lists, poses, indexing, arithmetic, comparison, logic, user
//! functions, named arguments, and the functions in `builtins.rs`. Not understood: threads, `sec`,
//! structs. Start at [`Program`].

mod ast;
mod builtins;
mod lexer;
mod parser;
mod program;
mod upload;
mod value;

pub(super) use program::{Program, Slice};
pub(super) use upload::Upload;
