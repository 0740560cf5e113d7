//! What was encoded, decoded again.

use super::screen::placed;
use super::*;
use crate::board::{Corner, View};
use crate::cli::camera::shown::{AidsOf, MARK, Shown};
use crate::geometry::Camera;
use crate::image::GrayImage;
use crate::vision::aids::FrameAids;

/// Grays from 0 to 255, and a corner.
fn picture(width: usize, height: usize) -> ColorImage {
    let gray = |i: usize| [(i * 255 / (width * height - 1)) as u8; 3];
    let mut picture = ColorImage { width, height, pixels: (0..width * height).map(gray).collect() };
    picture.put(3, 2, MARK);
    picture
}

fn rgb_of_palette(index: u8) -> [u8; 3] {
    match index {
        16..=231 => {
            let level = |n: u8| if n == 0 { 0 } else { 55 + 40 * n };
            [level((index - 16) / 36), level((index - 16) / 6 % 6), level((index - 16) % 6)]
        }
        232..=255 => [8 + 10 * (index - 232); 3],
        _ => panic!("colour {index} is the user's own"),
    }
}

/// What a terminal shows of half blocks: two pixels a character.
fn shown_by_terminal(text: &str) -> Vec<Vec<([u8; 3], [u8; 3])>> {
    let line = |line: &str| {
        let (mut cells, mut colors, mut rest) = (Vec::new(), ([0; 3], [0; 3]), line);
        while let Some(c) = rest.chars().next() {
            if let Some(sequence) = rest.strip_prefix("\x1b[") {
                let (codes, after) = sequence.split_once('m').unwrap();
                let codes: Vec<u8> = codes.split(';').map(|n| n.parse().unwrap()).collect();
                colors = match codes.as_slice() {
                    &[38, 2, r, g, b, 48, 2, s, h, c] => ([r, g, b], [s, h, c]),
                    &[38, 5, above, 48, 5, below] => (rgb_of_palette(above), rgb_of_palette(below)),
                    [0] => ([0; 3], [0; 3]),
                    other => panic!("{other:?}"),
                };
                rest = after;
            } else {
                assert_eq!(c, '▀');
                cells.push(colors);
                rest = &rest[c.len_utf8()..];
            }
        }
        cells
    };
    text.split('\n').map(line).collect()
}

#[test]
fn half_blocks_show_the_picture() {
    let original = picture(9, 7);
    for (colors, gray_off, color_off) in [(Colors::True, 0, 0), (Colors::Palette, 5, 20)] {
        let text = Protocol::HalfBlocks(colors).draw(&original);
        let cells = shown_by_terminal(&text);
        assert_eq!((cells.len(), cells[0].len()), (4, 9));
        for (i, pixel) in original.pixels.iter().enumerate() {
            let cell = cells[i / 9 / 2][i % 9];
            let seen = if i / 9 % 2 == 0 { cell.0 } else { cell.1 };
            let off = (0..3).map(|c| seen[c].abs_diff(pixel[c])).max().unwrap();
            // Grays of the palette are 10 apart, but between 238 and 255 it has none: the nearest is up to 8 away.
            let in_the_gap = gray_off > 0 && pixel[0] > 243;
            let allowed = if *pixel == MARK { color_off } else { gray_off + if in_the_gap { 3 } else { 0 } };
            assert!(off <= allowed, "{colors:?} {i}: {seen:?} for {pixel:?}");
        }
    }
    let text = Protocol::HalfBlocks(Colors::None).draw(&original);
    assert!(text.is_ascii() && text.contains('O') && text.lines().all(|line| line.len() == 9), "{text}");
}

#[test]
fn kitty_gets_every_pixel_in_pieces_it_accepts() {
    let original = picture(60, 40);
    let text = Protocol::Kitty.draw(&original);
    let pieces: Vec<&str> = text.split("\x1b\\").filter(|p| !p.is_empty()).collect();
    assert!(pieces.len() > 1);
    let mut data = String::new();
    for (i, piece) in pieces.iter().enumerate() {
        let (keys, payload) = piece.strip_prefix("\x1b_G").unwrap().split_once(';').unwrap();
        assert!(payload.len() <= 4096 && (payload.len() % 4 == 0));
        assert!(keys.contains(if i + 1 < pieces.len() { "m=1" } else { "m=0" }), "{keys}");
        if i == 0 {
            for key in ["a=T", "f=24", "s=60", "v=40", "c=6", "r=2", "q=2"] {
                assert!(keys.split(',').any(|k| k == key), "{keys} without {key}");
            }
        }
        data.push_str(payload);
    }
    let expected: Vec<u8> = original.pixels.iter().flatten().copied().collect();
    assert_eq!(unbase64(&data), expected);
}

fn unbase64(text: &str) -> Vec<u8> {
    let digit = |c: u8| match c {
        b'A'..=b'Z' => c - b'A',
        b'a'..=b'z' => c - b'a' + 26,
        b'0'..=b'9' => c - b'0' + 52,
        b'+' => 62,
        b'/' => 63,
        _ => panic!("{c}"),
    };
    let digits: Vec<u8> = text.trim_end_matches('=').bytes().map(digit).collect();
    let bits = |group: &[u8]| group.iter().fold(0_u32, |all, d| all << 6 | u32::from(*d)) << (6 * (4 - group.len()));
    let bytes = |group: &[u8]| bits(group).to_be_bytes()[1..group.len()].to_vec();
    digits.chunks(4).flat_map(bytes).collect()
}

#[test]
fn base64_is_that_of_the_standard() {
    // RFC 4648, section 10.
    for (plain, coded) in [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")] {
        assert_eq!(kitty::base64(plain.as_bytes()), coded);
    }
}

/// Reads a number at the start.
fn number(text: &mut &str) -> usize {
    let end = text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
    let (digits, rest) = text.split_at(end);
    *text = rest;
    digits.parse().unwrap()
}

/// What a sixel terminal shows: percent of red, green and blue.
fn sixel_decoded(text: &str, width: usize, height: usize) -> Vec<Option<[usize; 3]>> {
    let body = text.strip_prefix("\x1bP0;1q").unwrap().strip_suffix("\x1b\\").unwrap();
    let mut rest = body.strip_prefix(&format!("\"1;1;{width};{height}")).unwrap();
    let (mut registers, mut current) = (vec![[0; 3]; 256], 0);
    let (mut pixels, mut x, mut band) = (vec![None; width * height], 0, 0);
    while let Some(c) = rest.chars().next() {
        rest = &rest[1..];
        let mut count = 1;
        let mut sixel = c;
        match c {
            '#' => {
                current = number(&mut rest);
                if let Some(after) = rest.strip_prefix(";2;") {
                    rest = after;
                    let mut component = || {
                        let value = number(&mut rest);
                        rest = rest.strip_prefix(';').unwrap_or(rest);
                        value
                    };
                    registers[current] = [component(), component(), component()];
                }
                continue;
            }
            '$' => {
                x = 0;
                continue;
            }
            '-' => {
                (x, band) = (0, band + 1);
                continue;
            }
            '!' => {
                count = number(&mut rest);
                sixel = rest.chars().next().unwrap();
                rest = &rest[1..];
            }
            _ => {}
        }
        let bits = u32::from(sixel) - 63;
        for _ in 0..count {
            for row in (0..6).filter(|row| bits >> row & 1 == 1) {
                let slot = &mut pixels[(band * 6 + row) * width + x];
                assert!(slot.is_none(), "drawn twice");
                *slot = Some(registers[current]);
            }
            x += 1;
        }
    }
    pixels
}

#[test]
fn sixels_show_every_pixel_once() {
    let original = picture(37, 20);
    let decoded = sixel_decoded(&Protocol::Sixel.draw(&original), 37, 20);
    for (seen, pixel) in decoded.iter().zip(&original.pixels) {
        let seen = seen.expect("a pixel is missing");
        for c in 0..3 {
            // 48 shades are 5.4 apart, percents 2.55.
            let off = (seen[c] as f64 * 2.55 - f64::from(pixel[c])).abs();
            assert!(off <= 2.72 + 1.28, "{seen:?} for {pixel:?}");
        }
    }
}

#[test]
fn only_terminals_that_are_known_get_more_than_blocks() {
    let detect = |asked: Asked, set: &[(&str, &str)]| {
        Protocol::detect(asked, |name| set.iter().find(|(n, _)| *n == name).map(|(_, v)| (*v).to_owned()))
    };
    let blocks = Protocol::HalfBlocks;
    let xterm = ("TERM", "xterm-256color");
    assert_eq!(detect(Asked::Auto, &[xterm]), blocks(Colors::Palette));
    assert_eq!(detect(Asked::Auto, &[xterm, ("COLORTERM", "truecolor")]), blocks(Colors::True));
    assert_eq!(detect(Asked::Auto, &[("TERM", "xterm-kitty"), ("KITTY_WINDOW_ID", "1")]), Protocol::Kitty);
    assert_eq!(detect(Asked::Auto, &[("TERM", "foot")]), Protocol::Sixel);
    assert_eq!(detect(Asked::Auto, &[xterm, ("TERM_PROGRAM", "WezTerm")]), Protocol::Sixel);
    let inside = [("TERM", "tmux-256color"), ("TMUX", "/tmp/x"), ("KITTY_WINDOW_ID", "1")];
    assert_eq!(detect(Asked::Auto, &inside), blocks(Colors::Palette), "tmux passes no pictures");
    assert_eq!(detect(Asked::Auto, &[xterm, ("NO_COLOR", "1")]), blocks(Colors::None));
    assert_eq!(detect(Asked::Auto, &[]), blocks(Colors::None));
    assert_eq!(detect(Asked::Sixel, &inside), Protocol::Sixel, "whoever asks gets it");
}

fn shown(camera: Camera) -> Shown {
    let aids = FrameAids {
        corners: 3,
        expected: 24,
        coverage: Some(0.2),
        edge_width_px: Some(9.0),
        edges: 4,
        of_board: true,
        at_0: 0.0,
        at_255: 0.4,
        dark: 10.0,
        light: 250.0,
        contrast: 0.9,
    };
    let view = View::new(vec![Corner::at(0, [100.0, 50.0])]);
    Shown { camera, image: GrayImage::filled(320, 180, 77), view, aids: AidsOf::Frame(aids) }
}

/// Characters of a line that are seen.
fn visible(line: &str) -> usize {
    let mut parts = line.split("\x1b[");
    let first = parts.next().unwrap_or_default().chars().count();
    first + parts.map(|part| part.split_once(['m', 'K']).unwrap().1.chars().count()).sum::<usize>()
}

#[test]
fn pages_fit_the_terminal() {
    let both = [shown(Camera::Rgb), shown(Camera::Event)];
    for size in [[80, 24], [200, 60], [60, 12]] {
        for protocol in [Protocol::HalfBlocks(Colors::True), Protocol::HalfBlocks(Colors::None)] {
            let page = compose(&both, protocol, size, "Ctrl-C ends");
            let printed = page.printed();
            let lines: Vec<&str> = printed.trim_end_matches('\n').split('\n').collect();
            assert!(lines.len() <= size[1], "{size:?}: {} lines", lines.len());
            assert!(lines.iter().all(|line| visible(line) <= size[0]), "{size:?}:\n{printed}");
            assert!(printed.contains("corners 3 of 24"), "{printed}");
            let on_screen = placed(&page);
            assert!(on_screen.starts_with("\x1b[H") && on_screen.ends_with("\x1b[J"));
        }
    }
    let narrow = compose(&both, Protocol::Sixel, [3, 2], "x");
    assert!(!narrow.picture.is_empty());
    compose(&[], Protocol::Kitty, [0, 0], "");
}
