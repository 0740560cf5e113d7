//! Where a move goes and how fast: the word that plan, session and drivers share.

use serde::{Deserialize, Serialize};

use crate::geometry::kinematics::Joints;

/// Where a move goes and how fast.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "move", rename_all = "snake_case")]
pub enum MoveTarget {
    /// Joint-space move (`movej`).
    Joint {
        /// Target joint positions, rad.
        joints_rad: Joints,
        /// Speed of the leading joint, rad/s.
        speed_rad_s: f64,
        /// Acceleration of the leading joint, rad/s2.
        acceleration_rad_s2: f64,
    },
    /// Straight line of the TCP (`movel`).
    Linear {
        /// Target `base_from_tcp`: x, y, z (m) and axis-angle vector (rad).
        tcp_pose: [f64; 6],
        /// Speed, m/s.
        speed_m_s: f64,
        /// Acceleration, m/s2.
        acceleration_m_s2: f64,
    },
}
