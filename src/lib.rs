//! cellcal keeps robot cells calibrated. This page is the map of the code.
pub mod board;
pub mod calibration;
pub mod cli;
pub mod config;
pub mod cv;
pub mod devices;
pub mod events;
pub mod geometry;
pub mod image;
pub mod plan;
pub mod recording;
pub mod report;
pub mod runner;
pub mod session;
pub mod vision;
