//! Whatever comes over the socket: no panic, no unbounded memory.
#![no_main]

#[path = "../read_anything.rs"]
mod read_anything;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| read_anything::read_anything(bytes));
