//! The screen of a terminal, taken for live pictures and given back as it was.

use std::io::Write as _;

use super::{Page, Protocol, kitty};

/// Another screen, no cursor; and back.
const ENTER: &str = "\x1b[?1049h\x1b[?25l\x1b[2J";
const LEAVE: &str = "\x1b[?25h\x1b[?1049l";
/// Everything between is drawn at once, where the terminal can.
const HOLD: &str = "\x1b[?2026h";
const SHOW: &str = "\x1b[?2026l";

/// A terminal that shows live pictures; dropped, it is as before.
pub(in crate::cli::camera) struct Screen {
    protocol: Protocol,
    /// Size when it was drawn last.
    drawn: Option<[usize; 2]>,
}

impl Screen {
    /// Takes the screen with the first picture: what is said before stays readable.
    pub(in crate::cli::camera) fn new(protocol: Protocol) -> Self {
        Self { protocol, drawn: None }
    }

    /// Columns and rows.
    pub(in crate::cli::camera) fn size() -> [usize; 2] {
        let (rows, columns) = console::Term::stdout().size_checked().unwrap_or((24, 80));
        [usize::from(columns), usize::from(rows)]
    }

    /// Draws over what is there.
    pub(in crate::cli::camera) fn draw(&mut self, page: &Page, size: [usize; 2]) -> std::io::Result<()> {
        if self.drawn.is_none() {
            put(ENTER)?;
        }
        // Of another size nothing is in its place any more.
        let anew = if self.drawn == Some(size) { "" } else { "\x1b[2J" };
        self.drawn = Some(size);
        put(&format!("{HOLD}{anew}{}{SHOW}", placed(page)))
    }
}

/// The picture at the top, the text below it; what is left of longer lines is wiped.
pub(super) fn placed(page: &Page) -> String {
    let picture = page.picture.replace('\n', "\x1b[K\r\n");
    let lines: String = page.lines.iter().map(|line| format!("{line}\x1b[K\r\n")).collect();
    let lines = lines.trim_end_matches("\r\n");
    format!("\x1b[H{picture}\x1b[{};1H{lines}\x1b[J", page.picture_rows + 1)
}

impl Drop for Screen {
    fn drop(&mut self) {
        if self.drawn.is_none() {
            return;
        }
        let clear = if self.protocol == Protocol::Kitty { kitty::clear() } else { String::new() };
        // Nothing can be done where the terminal is gone.
        let _ = put(&format!("{clear}{LEAVE}"));
    }
}

fn put(text: &str) -> std::io::Result<()> {
    let mut out = std::io::stdout().lock();
    out.write_all(text.as_bytes())?;
    out.flush()
}
