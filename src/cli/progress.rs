//! Progress and talk, on stderr; bars only on a terminal.

use std::io::{IsTerminal as _, Write as _};
use std::sync::Mutex;

use indicatif::{ProgressBar, ProgressStyle};

/// Says a line on stderr.
pub(super) fn say(line: &str) {
    // Nothing can be done where stderr is closed.
    let _ = writeln!(std::io::stderr().lock(), "{line}");
}

/// A bar for work whose amount becomes known with its first step.
pub(super) struct Bar {
    bar: Mutex<Option<ProgressBar>>,
    what: &'static str,
}

impl Bar {
    /// A bar that says what is going on; silent where stderr is no terminal.
    pub(super) fn new(what: &'static str) -> Self {
        Self { bar: Mutex::new(None), what }
    }

    /// Shows `done` of `total`.
    pub(super) fn show(&self, done: usize, total: usize) {
        if !std::io::stderr().is_terminal() {
            return;
        }
        let Ok(mut slot) = self.bar.lock() else { return };
        let bar = slot.get_or_insert_with(|| {
            let style = ProgressStyle::with_template("{msg:<24} [{bar:40}] {pos}/{len} {elapsed}");
            let bar = ProgressBar::new(total as u64).with_message(self.what);
            if let Ok(style) = style { bar.with_style(style) } else { bar }
        });
        bar.set_position(done as u64);
        if done >= total {
            bar.finish_and_clear();
        }
    }
}
