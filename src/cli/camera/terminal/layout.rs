//! Pictures side by side, with the aids of each below.

use super::Protocol;
use crate::cli::camera::shown::Shown;
use crate::image::ColorImage;
use crate::vision::aids::Reading;

/// Between the columns of two cameras, characters.
const GAP: usize = 2;
/// Columns narrower than this hold nothing legible.
const COLUMN_MIN: usize = 20;
const BAD: &str = "\x1b[33m";
const PLAIN: &str = "\x1b[0m";

/// What is on the screen: a picture, and lines of text below it.
pub(in crate::cli::camera) struct Page {
    pub(super) picture: String,
    /// Lines of characters that the picture takes.
    pub(super) picture_rows: usize,
    pub(super) lines: Vec<String>,
}

/// Lays out what the cameras saw on a terminal of `size` columns and rows.
pub(in crate::cli::camera) fn compose(
    shown: &[Shown],
    protocol: Protocol,
    [columns, rows]: [usize; 2],
    footer: &str,
) -> Page {
    let count = shown.len().max(1);
    let width = (columns.saturating_sub(GAP * (count - 1)) / count).max(COLUMN_MIN);
    let texts: Vec<Vec<Line>> = shown.iter().map(|s| column(s, width)).collect();
    let mut lines = beside(&texts, width, protocol.has_colors());
    lines.push(clipped(footer, columns));
    // The text may take half of the screen, the picture the rest.
    lines.truncate((rows / 2).max(1));
    let picture_rows = rows.saturating_sub(lines.len()).max(1);
    let picture = side_by_side(shown, protocol.cell_px(), width, picture_rows);
    let picture_rows = picture.height.div_ceil(protocol.cell_px()[1]);
    Page { picture: protocol.draw(&picture), picture_rows, lines }
}

impl Page {
    /// Everything as text that is printed once.
    pub(in crate::cli::camera) fn printed(&self) -> String {
        format!("{}\n{}\n", self.picture, self.lines.join("\n"))
    }
}

/// All pictures on one canvas, as large as the room allows.
fn side_by_side(shown: &[Shown], [cell_x, cell_y]: [usize; 2], width: usize, rows: usize) -> ColorImage {
    let room = [width * cell_x, rows * cell_y];
    let scaled = |s: &Shown| {
        let fits = room[1] * s.image.width / s.image.height.max(1);
        s.picture(room[0].min(fits).max(1))
    };
    let pictures: Vec<ColorImage> = shown.iter().map(scaled).collect();
    let height = pictures.iter().map(|p| p.height).max().unwrap_or(1);
    let step = (width + GAP) * cell_x;
    let total = pictures.last().map_or(1, |last| step * (pictures.len() - 1) + last.width);
    let mut canvas = ColorImage::filled(total, height, [0; 3]);
    for (i, picture) in pictures.iter().enumerate() {
        for (y, row) in picture.pixels.chunks(picture.width).enumerate() {
            canvas.pixels[y * total + i * step..][..picture.width].copy_from_slice(row);
        }
    }
    canvas
}

/// A line of text, and whether it is about something bad.
type Line = (String, bool);

/// The readings of one camera and its advice, wrapped.
fn column(shown: &Shown, width: usize) -> Vec<Line> {
    let readings = shown.aids.readings();
    let said = |r: &Reading| format!("{} {}{}", r.name, r.value, if r.advice.is_some() { " !" } else { "" });
    let title = format!("{}: {}", shown.camera, readings.iter().map(said).collect::<Vec<_>>().join(" | "));
    let mut lines: Vec<Line> = wrapped(&title, width).into_iter().map(|line| (line, false)).collect();
    for advice in readings.iter().filter_map(|r| r.advice.as_ref()) {
        lines.extend(wrapped(&format!("-> {advice}"), width).into_iter().map(|line| (line, true)));
    }
    lines
}

/// Breaks between words; a word that is too long is cut.
fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let word = clipped(word, width);
        if let Some(line) = lines.last_mut()
            && (line.is_empty() || line.chars().count() + 1 + word.chars().count() <= width)
        {
            line.push_str(if line.is_empty() { "" } else { " " });
            line.push_str(&word);
        } else {
            lines.push(word);
        }
    }
    lines
}

fn clipped(text: &str, width: usize) -> String {
    text.chars().take(width).collect()
}

fn beside(texts: &[Vec<Line>], width: usize, colored: bool) -> Vec<String> {
    let rows = texts.iter().map(Vec::len).max().unwrap_or(0);
    let cell = |text: &[Line], row: usize, last: bool| {
        let (line, bad) = text.get(row).cloned().unwrap_or_default();
        let space = if last { 0 } else { (width + GAP).saturating_sub(line.chars().count()) };
        let line = if bad && colored { format!("{BAD}{line}{PLAIN}") } else { line };
        line + &" ".repeat(space)
    };
    let joined = |row: usize| {
        let cells = texts.iter().enumerate().map(|(i, text)| cell(text, row, i + 1 == texts.len()));
        cells.collect::<String>()
    };
    (0..rows).map(joined).collect()
}
