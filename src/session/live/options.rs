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
}

impl Default for Options {
    fn default() -> Self {
        Self { confirm_each: false, patience_s: 5.0, watch: Watch::Never }
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
