//! Whatever a camera or a file holds: no panic, and the same events however the bytes are cut.
#![no_main]

#[path = "../decode_anything.rs"]
mod decode_anything;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| decode_anything::decode_anything(bytes));
