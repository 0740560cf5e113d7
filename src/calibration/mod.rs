//! From views and robot poses to numbers: cameras, stereo, hand-eye, checks, gates and the verdict.
//!
//! Uses `geometry`, `board`, `cv`. Start at `solve`.

pub mod cameras;
pub mod problem;
pub mod settings;
