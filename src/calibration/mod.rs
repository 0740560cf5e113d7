//! From views and robot poses to numbers: cameras, stereo, hand-eye, checks, gates and the verdict.
//!
//! Uses `geometry`, `board`, `cv`. Start at [`solve::solve`]: a [`problem::Problem`] in, a
//! [`result::CalibrationResult`] out.

pub mod adjust;
pub mod arm;
pub mod cameras;
pub mod checks;
pub mod gates;
pub mod hand_eye;
pub mod kinematics;
pub mod observability;
pub mod problem;
pub mod result;
pub mod settings;
pub mod solve;
mod verify;
