//! Pictures of characters: the upper half of a block in one colour on a ground of another, two pixels a character.

use std::fmt::Write as _;

use super::Colors;
use crate::image::ColorImage;

/// Upper half block.
const HALF: char = '▀';
/// Dark to light, where there are no colours.
const SHADES: [char; 10] = [' ', '.', ':', '-', '=', '+', '*', '#', '%', '@'];
/// The gray ramp of the palette: 8, 18, ... 238.
const RAMP_FIRST: u8 = 232;
/// The levels of the palette's cube.
const CUBE: [u8; 6] = [0, 95, 135, 175, 215, 255];

/// Lines of characters, each ending with the colours reset.
pub(super) fn encode(picture: &ColorImage, colors: Colors) -> String {
    let rows = (0..picture.height).step_by(2);
    let lines: Vec<String> = rows.map(|y| line(picture, y, colors)).collect();
    lines.join("\n")
}

fn line(picture: &ColorImage, y: usize, colors: Colors) -> String {
    let below = |x: usize| if y + 1 < picture.height { picture.at(x, y + 1) } else { [0; 3] };
    let pairs = (0..picture.width).map(|x| (picture.at(x, y), below(x)));
    if colors == Colors::None {
        return pairs.map(|(upper, lower)| shade(upper, lower)).collect();
    }
    let (mut text, mut last) = (String::new(), None);
    for pair in pairs {
        if last != Some(pair) {
            // Writing to a string cannot fail.
            let _ = match colors {
                Colors::True => {
                    let ([r, g, b], [s, h, c]) = pair;
                    write!(text, "\x1b[38;2;{r};{g};{b};48;2;{s};{h};{c}m")
                }
                Colors::Palette | Colors::None => {
                    write!(text, "\x1b[38;5;{};48;5;{}m", palette(pair.0), palette(pair.1))
                }
            };
            last = Some(pair);
        }
        text.push(HALF);
    }
    text + "\x1b[0m"
}

/// Grays on the ramp, or black and white of the cube; colours in the cube.
fn palette([r, g, b]: [u8; 3]) -> u8 {
    if r == g && g == b {
        return match r {
            0..=3 => 16,
            247..=255 => 231,
            v => RAMP_FIRST + (u16::from(v).saturating_sub(3) / 10).min(23) as u8,
        };
    }
    let level = |v: u8| (0..6).min_by_key(|i| CUBE[usize::from(*i)].abs_diff(v)).unwrap_or(0);
    16 + 36 * level(r) + 6 * level(g) + level(b)
}

/// A corner is an `O`.
fn shade(upper: [u8; 3], lower: [u8; 3]) -> char {
    let is_gray = |[r, g, b]: [u8; 3]| r == g && g == b;
    if !(is_gray(upper) && is_gray(lower)) {
        return 'O';
    }
    let mean = (usize::from(upper[0]) + usize::from(lower[0])) / 2;
    SHADES[mean * (SHADES.len() - 1) / 255]
}
