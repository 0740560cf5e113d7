//! Universal Robots controllers: RTDE for state and commands, one small script for motion.
//!
//! The script `motion.script` is uploaded once per connection; after that every command is one RTDE
//! input package, so that a command is never torn. The controller stops the arm by itself when
//! heartbeats stay away (`rtde_set_watchdog`, 10 Hz). This is not a rated safety function.
//! Uses `devices::rtde`, `geometry` and `session`. Start at [`UrRobot::connect`].

mod config;
mod connection;
mod dashboard;
mod external;
mod fields;
mod lines;
mod monitor;
mod primary;
mod robot;
mod samples;
mod script;
mod supervisor;

pub use crate::devices::rtde::{ControllerVersion, TextMessage};
pub use config::{MotionCaps, UrConfig};
pub use dashboard::RobotInfo;
pub use monitor::UrMonitor;
pub use primary::read_kinematics;
pub use robot::UrRobot;
pub use script::{MOTION_SCRIPT, script_sha256};
