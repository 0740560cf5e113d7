//! Sixel graphics: bands of six rows, one pass a colour.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use crate::image::ColorImage;

/// Shades of gray; the colours of corners come on top.
const GRAYS: u16 = 48;

/// Draws at the cursor.
pub(super) fn encode(picture: &ColorImage) -> String {
    let indices: Vec<u16> = picture.pixels.iter().map(|p| index(*p)).collect();
    let used: BTreeMap<u16, [u8; 3]> = indices.iter().copied().zip(picture.pixels.iter().copied()).collect();
    let mut text = format!("\x1bP0;1q\"1;1;{};{}", picture.width, picture.height);
    for (index, color) in &used {
        let [r, g, b] = if *index < GRAYS { [percent_of_gray(*index); 3] } else { color.map(percent) };
        // Writing to a string cannot fail.
        let _ = write!(text, "#{index};2;{r};{g};{b}");
    }
    for band in indices.chunks(6 * picture.width.max(1)) {
        push_band(&mut text, band, picture.width);
        text.push('-');
    }
    text + "\x1b\\"
}

/// Gray by its shade; every other colour is that of a corner and has the next register.
fn index([r, g, b]: [u8; 3]) -> u16 {
    if r == g && g == b { (u16::from(r) * (GRAYS - 1) + 127) / 255 } else { GRAYS }
}

fn percent_of_gray(index: u16) -> u8 {
    ((index * 100 + (GRAYS - 1) / 2) / (GRAYS - 1)) as u8
}

fn percent(value: u8) -> u8 {
    ((u16::from(value) * 100 + 127) / 255) as u8
}

fn push_band(text: &mut String, band: &[u16], width: usize) {
    let mut sixels: BTreeMap<u16, Vec<u8>> = BTreeMap::new();
    for (i, index) in band.iter().enumerate() {
        let of_color = sixels.entry(*index).or_insert_with(|| vec![0; width]);
        of_color[i % width] |= 1 << (i / width);
    }
    for (pass, (index, columns)) in sixels.iter().enumerate() {
        let _ = write!(text, "{}#{index}", if pass > 0 { "$" } else { "" });
        let end = columns.iter().rposition(|bits| *bits != 0).map_or(0, |last| last + 1);
        for run in columns[..end].chunk_by(|a, b| a == b) {
            let sixel = char::from(b'?' + run[0]);
            match run.len() {
                1..=3 => text.extend(std::iter::repeat_n(sixel, run.len())),
                count => drop(write!(text, "!{count}{sixel}")),
            }
        }
    }
}
