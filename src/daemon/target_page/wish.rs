//! The board that a page asks for, checked.

use crate::board::{Board, BoardError};
use crate::config::DisplayCell;
use crate::cv::{CvError, charuco};

/// Most pixels of an image: a panel of 8K has 33 million.
const MOST_PX: u64 = 40_000_000;
/// Fewest pixels a square that any camera could read.
const LEAST_PX: u32 = 8;

/// What is wrong with it.
#[derive(Debug, thiserror::Error)]
pub(super) enum WishError {
    #[error(
        "`{0}` is nothing that can be chosen; known: squares_x, squares_y, square_mm, marker_mm, dictionary, alpha, px, state"
    )]
    Unknown(String),
    #[error("{key} is `{found}`, not {allowed}")]
    Value { key: &'static str, found: String, allowed: &'static str },
    #[error(transparent)]
    Board(#[from] BoardError),
    #[error(transparent)]
    Dictionary(#[from] CvError),
    #[error(
        "markers of {ratio:.4} squares have no scale at which every module has whole pixels; use 0.75 or 0.8 of the square"
    )]
    NoStep { ratio: f64 },
    #[error("px is {px}: squares have whole pixels a module at multiples of {step}, at least 8")]
    Px { px: u32, step: u32 },
    #[error("{width} x {height} pixels are more than an image may have, 40 million")]
    TooLarge { width: u32, height: u32 },
}

/// A board, its blended state, and perhaps a scale.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Wish {
    pub(super) board: Board,
    pub(super) alpha: f64,
    /// Pixels a square.
    pub(super) px: Option<u32>,
    /// The second state.
    pub(super) blended: bool,
    /// Modules along a marker, its border included.
    pub(super) modules: u32,
    /// Pixels a square come in multiples of this.
    pub(super) step: u32,
}

impl Wish {
    /// What is not asked for is as in the cell.
    pub(super) fn new(board: &Board, display: &DisplayCell, asked: &[(String, String)]) -> Result<Self, WishError> {
        let mut board = board.clone();
        let (mut alpha, mut px, mut blended) = (display.alpha, None, false);
        for (key, value) in asked {
            match key.as_str() {
                "squares_x" => board.squares_x = whole("squares_x", value)?,
                "squares_y" => board.squares_y = whole("squares_y", value)?,
                "square_mm" => board.square_m = number("square_mm", value)? * 1e-3,
                "marker_mm" => board.marker_m = number("marker_mm", value)? * 1e-3,
                "dictionary" => board.dictionary.clone_from(value),
                "alpha" => alpha = number("alpha", value)?,
                "px" => px = Some(whole("px", value)?),
                "state" => blended = state(value)?,
                other => return Err(WishError::Unknown(shortened(other))),
            }
        }
        if !(0.0..=0.95).contains(&alpha) {
            return Err(WishError::Value { key: "alpha", found: alpha.to_string(), allowed: "0 to 0.95" });
        }
        board.dictionary = shortened(&board.dictionary);
        board.check()?;
        let markers = charuco::markers(&board)?;
        // A board of 3 x 3 has four markers.
        let modules = markers.first().map_or(0, |m| m.width as u32);
        let ratio = board.marker_m / board.square_m;
        let step = board.whole_px_step(modules).ok_or(WishError::NoStep { ratio })?;
        let wish = Self { board, alpha, px, blended, modules, step };
        wish.px.map_or(Ok(()), |px| wish.check_px(px))?;
        Ok(wish)
    }

    fn check_px(&self, px: u32) -> Result<(), WishError> {
        if px < LEAST_PX || !px.is_multiple_of(self.step) {
            return Err(WishError::Px { px, step: self.step });
        }
        let [width, height] = [self.board.squares_x, self.board.squares_y].map(|n| n.saturating_mul(px));
        if u64::from(width) * u64::from(height) > MOST_PX {
            return Err(WishError::TooLarge { width, height });
        }
        Ok(())
    }
}

fn whole(key: &'static str, found: &str) -> Result<u32, WishError> {
    found.parse().map_err(|_| WishError::Value { key, found: shortened(found), allowed: "a whole number" })
}

fn number(key: &'static str, found: &str) -> Result<f64, WishError> {
    let value = found.parse().ok().filter(|v: &f64| v.is_finite());
    value.ok_or_else(|| WishError::Value { key, found: shortened(found), allowed: "a number" })
}

fn state(found: &str) -> Result<bool, WishError> {
    match found {
        "pattern" => Ok(false),
        "blended" => Ok(true),
        other => Err(WishError::Value { key: "state", found: shortened(other), allowed: "`pattern` or `blended`" }),
    }
}

/// Enough of a foreign text to recognise it.
fn shortened(text: &str) -> String {
    text.chars().take(40).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wish(asked: &[(&str, &str)]) -> Result<Wish, WishError> {
        let board =
            Board { squares_x: 7, squares_y: 5, square_m: 0.012, marker_m: 0.0096, dictionary: "DICT_4X4_50".into() };
        let asked: Vec<_> = asked.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
        Wish::new(&board, &DisplayCell::default(), &asked)
    }

    #[test]
    fn what_is_not_asked_for_is_as_in_the_cell() {
        let found = wish(&[]).unwrap();
        assert_eq!((found.modules, found.step, found.alpha, found.px), (6, 15, 0.6, None));
        let found = wish(&[("dictionary", "DICT_6X6_250"), ("px", "40"), ("state", "blended")]).unwrap();
        assert_eq!((found.modules, found.step, found.px, found.blended), (8, 10, Some(40), true));
    }

    #[test]
    fn wrong_wishes_are_told_what_is_allowed() {
        for (asked, said) in [
            (("squares_x", "2"), "outside 3 x 3 to 100 x 100"),
            (("squares_x", "-1"), "not a whole number"),
            (("square_mm", "NaN"), "not a number"),
            (("marker_mm", "13"), "0.3 to 0.95 of the square"),
            (("dictionary", "DICT_9X9"), "unknown ArUco dictionary"),
            (("squares_y", "100"), "the board needs 350 markers, DICT_4X4_50 has 50"),
            (("alpha", "1"), "0 to 0.95"),
            (("px", "40"), "multiples of 15"),
            (("px", "4294967295"), "more than an image may have"),
            (("state", "c"), "`pattern` or `blended`"),
            (("colour", "red"), "nothing that can be chosen"),
            (("marker_mm", "8.611"), "no scale at which"),
        ] {
            let error = wish(&[asked]).unwrap_err().to_string();
            assert!(error.contains(said), "{asked:?}: {error}");
        }
    }
}
