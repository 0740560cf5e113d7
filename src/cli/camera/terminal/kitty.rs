//! The graphics protocol of kitty: raw pixels in base 64, in pieces, scaled by the terminal to whole characters.

use std::fmt::Write as _;

use crate::image::ColorImage;

/// Most characters of base 64 in a piece, by the protocol.
const PIECE: usize = 4096;
/// One image that is replaced again and again.
const ID: u32 = 7;

/// Draws at the cursor, which stays; answers of the terminal are turned off.
pub(super) fn encode(picture: &ColorImage, [cell_x, cell_y]: [usize; 2]) -> String {
    let (columns, rows) = (picture.width.div_ceil(cell_x), picture.height.div_ceil(cell_y));
    let bytes: Vec<u8> = picture.pixels.iter().flatten().copied().collect();
    let data = base64(&bytes);
    // Base 64 is ASCII: pieces are text.
    let pieces: Vec<&str> = data.as_bytes().chunks(PIECE).filter_map(|p| std::str::from_utf8(p).ok()).collect();
    let mut text = String::new();
    for (i, piece) in pieces.iter().enumerate() {
        let more = u8::from(i + 1 < pieces.len());
        // Writing to a string cannot fail.
        let _ = if i == 0 {
            let (w, h) = (picture.width, picture.height);
            write!(text, "\x1b_Ga=T,i={ID},p=1,q=2,C=1,f=24,s={w},v={h},c={columns},r={rows},m={more};{piece}\x1b\\")
        } else {
            write!(text, "\x1b_Gm={more};{piece}\x1b\\")
        };
    }
    text
}

/// Takes our image off the screen.
pub(super) fn clear() -> String {
    format!("\x1b_Ga=d,d=I,i={ID},q=2\x1b\\")
}

/// RFC 4648.
pub(super) fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let byte = |i: usize| u32::from(group.get(i).copied().unwrap_or(0));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for i in 0..4 {
            let digit = DIGITS[(bits >> (18 - 6 * i) & 63) as usize];
            text.push(if i <= group.len() { digit.into() } else { '=' });
        }
    }
    text
}
