//! cellcal keeps robot cells calibrated. This page is the map of the code.
//!
//! From a cell file and its trajectories (YAML) it moves a UR5e through declared poses, waits until the arm
//! really stands still, captures with a frame camera and an event camera that look at a blinking ChArUco
//! display, logs everything to one MCAP file, and computes cameras, stereo, hand-eye and consistency checks
//! with a verdict. Any logged session is repeated offline with identical results.
//!
//! # Layers
//!
//! A module uses only modules above it; `tests/it/architecture.rs` holds this table as data.
//!
//! | module | its job in one line |
//! |---|---|
//! | `image` | a gray image, the currency between the modules below |
//! | `geometry` | frames, typed transforms, points, rotations, pinhole camera; kinematic chain from URDF and DH |
//! | `board` | the ChArUco board: corner positions in `target`, the two blink images, corners seen (`View`) |
//! | `events` | Prophesee RAW EVT2, EVT2.1, EVT3 in and out; windows by triggers; accumulation into images |
//! | `cv` | the only module that names OpenCV; plain functions, our types in and out |
//! | `vision` | from images and event windows to views, for both cameras |
//! | `calibration` | from views and robot poses to numbers: cameras, stereo, hand-eye, checks, gates, verdict |
//! | `config` | YAML text to checked values: cell, trajectory; diagnostics with line and column; JSON Schemas |
//! | `plan` | before any motion: patterns, reach, limits, keep-out, field of view, duration |
//! | `session` | what to do next, given what has happened: sans-IO state machines; stillness lives here |
//! | `devices` | traits of robot and cameras; one folder per driver, and `sim/`, which has all of them |
//! | `recording` | a session as an MCAP file: writer, reader, damage; import of foreign data sets |
//! | `runner` | the one loop and its two worlds, live and replay; then vision and calibration on what was seen |
//! | `report` | a finished calibration for people: terminal and HTML |
//! | `daemon` | pages over HTTP: the display for any screen, live views of the cameras |
//! | `study` | experiments on the simulator, judged by the truth that only it knows |
//! | `cli` | one file per subcommand |
//!
//! # Three rules
//!
//! 1. Everything above `devices` is pure: no files, no sockets, no clock; time arrives with each input.
//! 2. Replay is not a second program: [`runner::run`] is the only loop. What is recorded is exactly the inputs
//!    and commands, images and raw events, the cell and trajectory texts. `run` closes the recording and solves
//!    by reading it back, so a replay gives the same bytes.
//! 3. Same file, same binary, same CPU type: byte-identical `result.json`, with any number of threads.
//!
//! # Where this differs from the first design, and why
//!
//! - `image` stands above `board`: blink images, event images and camera images are one type, and `events`
//!   must not know OpenCV's.
//! - A session that is resumed is one recording: the past is copied into a new file, `Resumed` marks the break, and
//!   one machine walks both parts, in the replay too.
//! - Pre-flight is judged by the session, from what the driver found out; the driver starts nothing by itself.
//! - A world has no tick of its own: the heartbeat that keeps the arm moving leaves when the loop comes back
//!   for its next input, so a hung loop stops the arm.

pub mod board;
pub mod calibration;
pub mod cli;
pub mod config;
pub mod cv;
pub mod daemon;
pub mod devices;
pub mod events;
pub mod geometry;
pub mod image;
pub mod plan;
pub mod recording;
pub mod report;
pub mod runner;
pub mod session;
pub mod study;
pub mod vision;
