//! Live pictures on a terminal: what it can show, and what is written to it. Pure but for [`Screen`].

mod half_blocks;
mod kitty;
mod layout;
mod screen;
mod sixel;
#[cfg(test)]
mod tests;

use clap::ValueEnum;

pub(super) use layout::{Page, compose};
pub(super) use screen::Screen;

use crate::image::ColorImage;

/// How pictures get to the terminal, as an option.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Asked {
    /// What the terminal says it can.
    Auto,
    /// Two pixels a character; every terminal with colours.
    HalfBlocks,
    /// The graphics protocol of kitty.
    Kitty,
    /// Sixel graphics.
    Sixel,
}

/// How pictures get to the terminal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Protocol {
    HalfBlocks(Colors),
    Kitty,
    Sixel,
}

/// Colours of a terminal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Colors {
    /// 24 bits.
    True,
    /// The palette of 256.
    Palette,
    /// None: NO_COLOR is set, or the terminal is dumb.
    None,
}

impl Protocol {
    /// By the environment; never more than a terminal is known to have.
    pub(super) fn detect(asked: Asked, variable: impl Fn(&str) -> Option<String>) -> Self {
        let is = |name: &str, values: &[&str]| variable(name).is_some_and(|v| values.contains(&v.as_str()));
        let term = variable("TERM").unwrap_or_default();
        let set = |name: &str| variable(name).is_some_and(|v| !v.is_empty());
        let kitty = set("KITTY_WINDOW_ID") || ["xterm-kitty", "xterm-ghostty"].contains(&term.as_str());
        let kitty = kitty || is("TERM_PROGRAM", &["ghostty"]);
        let sixel = ["foot", "foot-extra", "mlterm"].contains(&term.as_str());
        let sixel = sixel || is("TERM_PROGRAM", &["mintty", "WezTerm"]);
        // A multiplexer keeps the variables of the terminal around it and passes no pictures.
        let wrapped = set("TMUX") || set("STY") || term.starts_with("screen") || term.starts_with("tmux");
        let plain = set("NO_COLOR") || term == "dumb" || term.is_empty();
        let colors = match () {
            () if plain => Colors::None,
            () if is("COLORTERM", &["truecolor", "24bit"]) || term.ends_with("-direct") => Colors::True,
            () => Colors::Palette,
        };
        match asked {
            Asked::HalfBlocks => Self::HalfBlocks(colors),
            Asked::Kitty => Self::Kitty,
            Asked::Sixel => Self::Sixel,
            Asked::Auto if wrapped || plain => Self::HalfBlocks(colors),
            Asked::Auto if kitty => Self::Kitty,
            Asked::Auto if sixel => Self::Sixel,
            Asked::Auto => Self::HalfBlocks(colors),
        }
    }

    /// Pixels of a picture in one character, across and down.
    ///
    /// Of kitty, which scales by itself, and of sixel as few as no usual font is smaller than.
    pub(super) fn cell_px(self) -> [usize; 2] {
        match self {
            Self::HalfBlocks(_) => [1, 2],
            Self::Kitty => [10, 20],
            Self::Sixel => [7, 14],
        }
    }

    /// The bytes that draw a picture at the cursor, `rows` lines high; the cursor is somewhere below or behind.
    fn draw(self, picture: &ColorImage) -> String {
        match self {
            Self::HalfBlocks(colors) => half_blocks::encode(picture, colors),
            Self::Kitty => kitty::encode(picture, self.cell_px()),
            Self::Sixel => sixel::encode(picture),
        }
    }

    /// Whether bad values can be told by colour.
    fn has_colors(self) -> bool {
        self != Self::HalfBlocks(Colors::None)
    }
}
