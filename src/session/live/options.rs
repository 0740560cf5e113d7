//! How a session is run, besides what its cell says.

/// How a session is run, besides what the cell says.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Whether the operator confirms every move.
    pub confirm_each: bool,
    /// Longest time that a move may take beyond its own, s.
    pub patience_s: f64,
    /// Where the display is proved to blink, before the first capture.
    pub watch: Watch,
    /// Poses in a row at which the same camera may fail before the session stops.
    pub failed_poses: u32,
}

impl Default for Options {
    fn default() -> Self {
        Self { confirm_each: false, patience_s: 5.0, watch: Watch::Never, failed_poses: 3 }
    }
}

/// Where the display is watched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Watch {
    /// Nowhere: there is no event camera, or nothing is captured.
    Never,
    /// Before anything moves: the event camera sees it from there.
    AtStart,
    /// At the first pose.
    AtFirstPose,
}
