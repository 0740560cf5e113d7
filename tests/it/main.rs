//! The one integration-test binary: every process start loads OpenCV, so one is enough.

mod architecture;
mod bad_input;
mod real_data;
mod simulated_cell;
mod support;
