//! The board on paper, in true scale: a PDF of one page with nothing but rectangles and two rulers.
//!
//! The rulers are for the printer, which may scale x and y differently.

use std::fmt::Write as _;

use super::Board;
use crate::image::GrayImage;

/// Edge of the page that printers leave white, mm.
const MARGIN_MM: f64 = 8.0;
/// Strip for the horizontal ruler and two lines of text, mm.
const FOOTER_MM: f64 = 20.0;
/// Strip for the vertical ruler, mm.
const SIDE_MM: f64 = 10.0;
/// Length of the rulers, mm.
const RULER_MM: f64 = 100.0;
const POINTS_PER_MM: f64 = 72.0 / 25.4;

/// A sheet of paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Paper {
    /// Its name, lower case.
    pub name: &'static str,
    /// Short and long side, mm.
    pub size_mm: [f64; 2],
}

/// The sheets that are known, smallest first.
pub const PAPERS: [Paper; 3] = [
    Paper { name: "a4", size_mm: [210.0, 297.0] },
    Paper { name: "letter", size_mm: [215.9, 279.4] },
    Paper { name: "a3", size_mm: [297.0, 420.0] },
];

/// Why a board cannot be printed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PrintError {
    /// Too large for the sheet.
    #[error("the board is {width_mm:.1} x {height_mm:.1} mm, too large for {paper} with its rulers; {fix}")]
    TooLarge {
        /// Size of the board along x.
        width_mm: f64,
        /// Size of the board along y.
        height_mm: f64,
        /// The sheet.
        paper: &'static str,
        /// What to do.
        fix: String,
    },
}

impl Paper {
    /// Width and height of the page for a board; `None` where the board does not fit.
    fn page_mm(&self, board_mm: [f64; 2]) -> Option<[f64; 2]> {
        let [short, long] = self.size_mm;
        let fits = |[w, h]: &[f64; 2]| {
            board_mm[0] <= w - 2.0 * MARGIN_MM - SIDE_MM && board_mm[1] <= h - 2.0 * MARGIN_MM - FOOTER_MM
        };
        [[short, long], [long, short]].into_iter().find(fits)
    }

    /// Largest square that `board` could have on this sheet, mm.
    fn largest_square_mm(&self, board: &Board) -> f64 {
        let [short, long] = self.size_mm;
        let square = |[w, h]: [f64; 2]| {
            let across = (w - 2.0 * MARGIN_MM - SIDE_MM) / f64::from(board.squares_x);
            across.min((h - 2.0 * MARGIN_MM - FOOTER_MM) / f64::from(board.squares_y))
        };
        square([short, long]).max(square([long, short]))
    }
}

/// The board as a PDF of one page.
///
/// `markers[i]` is marker `i` with its border, one pixel a module, dark below 128.
pub fn pdf(board: &Board, markers: &[GrayImage], paper: Paper) -> Result<Vec<u8>, PrintError> {
    let board_mm = board.size_m().map(|m| m * 1e3);
    let Some(page_mm) = paper.page_mm(board_mm) else {
        let larger = PAPERS.iter().find(|p| p.page_mm(board_mm).is_some());
        let fix = match larger {
            Some(larger) => format!("it fits on {}", larger.name),
            None => {
                // A3 has more room than any other, in both directions.
                let [.., largest] = PAPERS;
                let square_mm = largest.largest_square_mm(board);
                format!("it fits on none of a4, letter, a3: squares of {square_mm:.1} mm and less fit on a3")
            }
        };
        let [width_mm, height_mm] = board_mm;
        return Err(PrintError::TooLarge { width_mm, height_mm, paper: paper.name, fix });
    };
    Ok(document(page_mm, &content(board, markers, page_mm)))
}

/// The drawing: millimetres, origin at the bottom left of the page.
fn content(board: &Board, markers: &[GrayImage], [page_w, page_h]: [f64; 2]) -> String {
    let [width, height] = board.size_m().map(|m| m * 1e3);
    let left = MARGIN_MM + (page_w - 2.0 * MARGIN_MM - SIDE_MM - width) / 2.0;
    let top = page_h - MARGIN_MM - (page_h - 2.0 * MARGIN_MM - FOOTER_MM - height) / 2.0;
    let mut text = format!("{POINTS_PER_MM:.9} 0 0 {POINTS_PER_MM:.9} 0 0 cm\n0 g\n");
    for [x, y, w, h] in dark_mm(board, markers) {
        let _ = writeln!(text, "{:.6} {:.6} {w:.6} {h:.6} re", left + x, top - y - h);
    }
    text.push_str("f\n0.2 w\n");
    for [x, y, w, h] in rulers_mm(page_w) {
        let _ = writeln!(text, "{x:.4} {y:.4} m {:.4} {:.4} l S", x + w, y + h);
    }
    let (square, marker) = (board.square_m * 1e3, board.marker_m * 1e3);
    let lines = [
        format!(
            "ChArUco board, {} x {} squares of {square} mm, markers {marker} mm, {}",
            board.squares_x, board.squares_y, board.dictionary
        ),
        format!("Print at 100 %, never fit to page. Measure both rulers: square_mm = {square} x ruler / 100 mm."),
    ];
    for (line, y) in lines.iter().zip([MARGIN_MM + 9.0, MARGIN_MM + 4.5]) {
        let escaped = line.replace('\\', "\\\\").replace('(', "\\(").replace(')', "\\)");
        let _ = writeln!(text, "BT /F 3 Tf {MARGIN_MM} {y:.3} Td ({escaped}) Tj ET");
    }
    text
}

/// Dark rectangles: x, y of the top left in `target`, width, height; mm.
fn dark_mm(board: &Board, markers: &[GrayImage]) -> Vec<[f64; 4]> {
    let (square, marker) = (board.square_m * 1e3, board.marker_m * 1e3);
    let margin = (square - marker) / 2.0;
    let mut dark = Vec::new();
    let mut next = markers.iter();
    for row in 0..board.squares_y {
        for column in 0..board.squares_x {
            let (x, y) = (f64::from(column) * square, f64::from(row) * square);
            if (row + column) % 2 == 0 {
                dark.push([x, y, square, square]);
            } else if let Some(image) = next.next() {
                let module = marker / image.width as f64;
                let runs = runs(image).into_iter().map(|[at, line, length]| {
                    let [at, line, length] = [at, line, length].map(|n| n as f64 * module);
                    [x + margin + at, y + margin + line, length, module]
                });
                dark.extend(runs);
            }
        }
    }
    dark
}

/// Dark modules side by side: column, row, how many.
fn runs(image: &GrayImage) -> Vec<[usize; 3]> {
    let mut runs: Vec<[usize; 3]> = Vec::new();
    for row in 0..image.height {
        for column in (0..image.width).filter(|column| image.at(*column, row) < 128) {
            match runs.last_mut() {
                Some([at, line, length]) if *line == row && *at + *length == column => *length += 1,
                Some(_) | None => runs.push([column, row, 1]),
            }
        }
    }
    runs
}

/// Both rulers with their end marks: x, y, and the way to the other end; mm from the bottom left.
fn rulers_mm(page_w: f64) -> [[f64; 4]; 6] {
    let (y, tick) = (MARGIN_MM + 1.5, 3.0);
    let x = page_w - MARGIN_MM - 1.5;
    let low = MARGIN_MM + FOOTER_MM;
    [
        [MARGIN_MM, y, RULER_MM, 0.0],
        [MARGIN_MM, y - tick / 2.0, 0.0, tick],
        [MARGIN_MM + RULER_MM, y - tick / 2.0, 0.0, tick],
        [x, low, 0.0, RULER_MM],
        [x - tick / 2.0, low, tick, 0.0],
        [x - tick / 2.0, low + RULER_MM, tick, 0.0],
    ]
}

/// A PDF file of one page with this content.
fn document([width_mm, height_mm]: [f64; 2], content: &str) -> Vec<u8> {
    let (width, height) = (width_mm * POINTS_PER_MM, height_mm * POINTS_PER_MM);
    let objects = [
        "<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>".to_owned(),
        "<< /Type /Pages /Kids [3 0 R] /Count 1 >>".to_owned(),
        format!(
            "<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width:.4} {height:.4}] /Contents 4 0 R \
             /Resources << /Font << /F << /Type /Font /Subtype /Type1 /BaseFont /Helvetica >> >> >> >>"
        ),
        format!("<< /Length {} >>\nstream\n{content}endstream", content.len()),
    ];
    let mut file = String::from("%PDF-1.4\n");
    let mut offsets = Vec::new();
    for (number, object) in (1..).zip(&objects) {
        offsets.push(file.len());
        let _ = write!(file, "{number} 0 obj\n{object}\nendobj\n");
    }
    let table = file.len();
    let _ = write!(file, "xref\n0 {}\n0000000000 65535 f \n", objects.len() + 1);
    for offset in offsets {
        let _ = writeln!(file, "{offset:010} 00000 n ");
    }
    let _ = write!(file, "trailer\n<< /Size {} /Root 1 0 R >>\nstartxref\n{table}\n%%EOF\n", objects.len() + 1);
    file.into_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn board(square_m: f64) -> Board {
        let marker_m = square_m * 0.8;
        Board { squares_x: 7, squares_y: 5, square_m, marker_m, dictionary: "DICT_4X4_50".into() }
    }

    fn refused(square_m: f64, paper: Paper) -> String {
        pdf(&board(square_m), &[], paper).unwrap_err().to_string()
    }

    #[test]
    fn a_board_that_does_not_fit_is_told_where_it_would() {
        let [a4, letter, a3] = PAPERS;
        // Lying on its side a4 has 210 - 36 mm for 5 rows, letter 215.9 - 36 mm.
        assert!(pdf(&board(0.0347), &[], a4).is_ok());
        assert!(refused(0.035, a4).ends_with("it fits on letter"), "{}", refused(0.035, a4));
        assert!(refused(0.037, letter).ends_with("it fits on a3"));
        let none = refused(0.08, a3);
        // (297 - 36) / 5 = 52.2 mm; the long side would have room for 56.3 mm.
        assert!(none.ends_with("squares of 52.2 mm and less fit on a3"), "{none}");
    }

    #[test]
    fn dark_modules_side_by_side_are_one_rectangle() {
        let image = GrayImage { width: 3, height: 2, pixels: vec![0, 0, 255, 0, 255, 0] };
        assert_eq!(runs(&image), [[0, 0, 2], [0, 1, 1], [2, 1, 1]]);
    }

    #[test]
    fn the_cross_reference_table_points_at_its_objects() {
        let file = String::from_utf8(pdf(&board(0.012), &[], PAPERS[0]).unwrap()).unwrap();
        let table = file.split("xref\n0 5\n").nth(1).unwrap();
        for (number, line) in (1..=4).zip(table.lines().skip(1)) {
            let offset: usize = line[..10].parse().unwrap();
            assert!(file[offset..].starts_with(&format!("{number} 0 obj\n")));
        }
    }
}
