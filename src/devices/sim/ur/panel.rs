//! The state behind the operator's panel, as far as the dashboard shows and changes it.

use super::body::{Body, Runtime, Safety};
use super::motion::TICK_S;

/// How long a protective stop cannot be unlocked, s.
const LOCKED_S: f64 = 5.0;

/// What is loaded and shown.
#[derive(Debug)]
pub(super) struct Panel {
    /// Path of the loaded program.
    pub(super) loaded: Option<String>,
    pub(super) popup: Option<String>,
    pub(super) mode: OperationalMode,
    /// Not after power on, until the brakes are released.
    pub(super) brakes_released: bool,
    /// When the last protective stop began.
    pub(super) stopped_since_tick: u64,
}

impl Default for Panel {
    fn default() -> Self {
        Self { loaded: None, popup: None, mode: OperationalMode::None, brakes_released: true, stopped_since_tick: 0 }
    }
}

/// Who may do what; without a password it is nobody's business.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum OperationalMode {
    None,
    Manual,
    Automatic,
}

impl OperationalMode {
    pub(super) fn word(self) -> &'static str {
        match self {
            Self::None => "NONE",
            Self::Manual => "MANUAL",
            Self::Automatic => "AUTOMATIC",
        }
    }
}

/// Loads a program the controller has; false where it has none of this name.
pub(super) fn load(body: &mut Body, name: &str) -> bool {
    let known = body.config.programs.iter().any(|p| p == name);
    if known {
        body.panel.loaded = Some(name.to_owned());
    }
    known
}

/// Name of the loaded program, as the panel shows it.
pub(super) fn program_name(body: &Body) -> &str {
    body.panel.loaded.as_deref().unwrap_or("<unnamed>")
}

/// Power on: the arm is ready but its brakes are still closed.
pub(super) fn power_on(body: &mut Body) {
    if !body.powered && body.safety == Safety::Normal {
        (body.powered, body.panel.brakes_released) = (true, false);
    }
}

/// Releases the brakes, and switches on before where that is needed.
pub(super) fn release_brakes(body: &mut Body) {
    power_on(body);
    body.panel.brakes_released |= body.powered;
}

pub(super) fn power_off(body: &mut Body) {
    (body.powered, body.panel.brakes_released) = (false, true);
}

/// Unlocks a protective stop; false while it is too fresh.
pub(super) fn unlock(body: &mut Body) -> bool {
    if body.safety != Safety::ProtectiveStop {
        return true;
    }
    let since_s = body.tick.saturating_sub(body.panel.stopped_since_tick) as f64 * TICK_S;
    let allowed = since_s >= LOCKED_S;
    if allowed {
        body.safety = Safety::Normal;
    }
    allowed
}

/// Lets a paused program go on; false where none may.
pub(super) fn go_on(body: &mut Body) -> bool {
    body.resume_program();
    body.runtime == Runtime::Playing
}
