//! The one integration-test binary: every process start loads OpenCV, so one is enough.

mod architecture;
