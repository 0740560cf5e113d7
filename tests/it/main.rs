//! The one integration-test binary: every process start loads OpenCV, so one is enough.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may stop where something is not as it must be")]

mod always;
mod architecture;
mod bad_input;
mod bag;
mod bench;
mod camera;
mod cell_around;
mod chromium;
mod corners;
mod display_proof;
mod faults;
mod fuzz_corpus;
#[cfg(feature = "genicam")]
mod genicam;
mod handheld;
mod killed;
mod pictures;
mod precise_corners;
mod real_data;
mod resume;
mod simulated_cell;
mod simulator;
mod soak;
mod stillness;
mod support;
mod target_files;
mod target_page;
mod triggers;
mod ur_rtde;
