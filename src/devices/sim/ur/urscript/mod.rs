//! A subset of URScript: lexer, parser, and an evaluator that runs as coroutines, one slice per thread
//! and controller cycle.
//!
//! Understood: `def`, `sec`, `thread` with `run`, `join`, `kill`, `enter_critical`, `exit_critical`,
//! `if`/`elif`/`else`, `while`, `return`, `break`, `continue`, `pass`, `halt`, `global`, `local`,
//! numbers, strings, lists, poses, structs, indexing, arithmetic, comparison, logic, user functions,
//! named arguments, and the functions in `builtins/`. Words may stand on lines as they like.
//!
//! A thread runs until it waits for time, then the next one; the arm obeys one thread at a time; a
//! program ends with its first thread. Memory, threads, depth and work per cycle are bounded.
//!
//! Not understood: methods of lists, matrices other than lists of lists, interpreter mode; blend radii
//! are ignored. What a function's own nested functions see of its variables are the global ones and
//! those of the program. Start at [`Program`].

mod ast;
mod builtins;
mod lexer;
mod machine;
mod parser;
mod program;
mod scope;
mod shared;
#[cfg(test)]
mod tests;
mod upload;
mod value;

pub(super) use program::{Program, Slice};
pub(super) use upload::Upload;
