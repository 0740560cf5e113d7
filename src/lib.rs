//! cellcal keeps robot cells calibrated. This page is the map of the code.
pub mod board;
pub mod calibration;
pub mod cv;
pub mod devices;
pub mod events;
pub mod geometry;
pub mod image;
pub mod recording;
pub mod session;
