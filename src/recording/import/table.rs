//! A CSV table by column name; every complaint has the line and the column.

use super::error::{ImportError, Place};
use super::source::Source;

/// A table, read and checked for shape.
#[derive(Debug)]
pub(super) struct Table {
    file: &'static str,
    header_line: u64,
    header: Vec<String>,
    rows: Vec<(u64, Vec<String>)>,
}

/// One row of a table.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row<'a> {
    table: &'a Table,
    line: u64,
    cells: &'a [String],
}

impl Table {
    /// Reads a table that must have the `required` columns, may have the `optional` ones and ignores others.
    pub(super) fn read(
        source: &mut Source,
        file: &'static str,
        required: &[&str],
        optional: &[&str],
    ) -> Result<Self, ImportError> {
        let text = source.text(file)?;
        let mut rows = split(file, &text)?.into_iter();
        let Some((header_line, header)) = rows.next() else {
            let what = format!("is empty; the first line must name the columns {}", required.join(", "));
            return Err(Place::file(file).wrong(what));
        };
        let table = Self { file, header_line, header, rows: rows.collect() };
        table.check_header(required)?;
        table.check_shape()?;
        let known = |column: &&String| required.contains(&column.as_str()) || optional.contains(&column.as_str());
        let unknown: Vec<String> = table.header.iter().filter(|column| !known(column)).cloned().collect();
        source.note_columns(file, &unknown);
        Ok(table)
    }

    /// Where the names of the columns are.
    pub(super) fn header_place(&self) -> Place {
        Place::line(self.file, self.header_line)
    }

    fn check_header(&self, required: &[&str]) -> Result<(), ImportError> {
        let place = self.header_place();
        for (index, column) in self.header.iter().enumerate() {
            if self.header.iter().take(index).any(|earlier| earlier == column) {
                return Err(place.wrong(format!("column {column} is there twice; remove one")));
            }
        }
        let missing: Vec<&str> = required.iter().filter(|column| self.column(column).is_none()).copied().collect();
        if missing.is_empty() {
            return Ok(());
        }
        let (missing, found) = (missing.join(", "), self.header.join(", "));
        Err(place.wrong(format!("column {missing} is missing; the columns are {found}")))
    }

    /// Every row has as many cells as the header.
    fn check_shape(&self) -> Result<(), ImportError> {
        let columns = self.header.len();
        let ragged = self.rows.iter().find(|(_, cells)| cells.len() != columns);
        let Some((line, cells)) = ragged else { return Ok(()) };
        let place = Place::line(self.file, *line);
        let what = match self.header.get(cells.len()) {
            Some(first) => format!("{} cells, the header has {columns}; there is none for {first}", cells.len()),
            None => format!("{} cells, the header has {columns}; is there a comma too many?", cells.len()),
        };
        Err(place.wrong(what))
    }

    fn column(&self, column: &str) -> Option<usize> {
        self.header.iter().position(|found| found == column)
    }

    /// Whether the table has a column.
    pub(super) fn has(&self, column: &str) -> bool {
        self.column(column).is_some()
    }

    /// The rows in order.
    pub(super) fn rows(&self) -> impl Iterator<Item = Row<'_>> {
        self.rows.iter().map(|(line, cells)| Row { table: self, line: *line, cells })
    }
}

impl<'a> Row<'a> {
    /// Where the row is.
    pub(super) fn place(&self) -> Place {
        Place::line(self.table.file, self.line)
    }

    /// A cell that may be empty; empty too where the table has no such column.
    pub(super) fn text_or_empty(&self, column: &str) -> &'a str {
        self.table.column(column).and_then(|index| self.cells.get(index)).map_or("", String::as_str)
    }

    /// A cell that must not be empty.
    pub(super) fn text(&self, column: &str) -> Result<&'a str, ImportError> {
        let text = self.text_or_empty(column);
        if text.is_empty() { Err(self.place().wrong(format!("{column} is empty"))) } else { Ok(text) }
    }

    /// A finite number with |number| <= `limit`; `hint` says what a larger one may come from.
    pub(super) fn number(&self, column: &str, limit: f64, hint: &str) -> Result<f64, ImportError> {
        let text = self.text(column)?;
        let wrong = |what: String| Err(self.place().wrong(format!("{column} is `{text}`, {what}")));
        match text.parse::<f64>() {
            Err(_) => wrong("not a number".into()),
            Ok(number) if !number.is_finite() => wrong("not a finite number".into()),
            Ok(number) if number.abs() <= limit => Ok(number),
            Ok(_) => wrong(format!("outside -{limit} to {limit}; {hint}")),
        }
    }

    /// A whole number from 0 on.
    pub(super) fn count(&self, column: &str) -> Result<usize, ImportError> {
        let text = self.text(column)?;
        text.parse().map_err(|_| self.place().wrong(format!("{column} is `{text}`, not a whole number from 0 on")))
    }

    /// Whether all cells of these columns are empty or absent.
    pub(super) fn all_empty(&self, columns: &[&str]) -> bool {
        columns.iter().all(|column| self.text_or_empty(column).is_empty())
    }
}

/// Rows of cells with their line numbers; empty lines are passed over.
fn split(file: &str, text: &str) -> Result<Vec<(u64, Vec<String>)>, ImportError> {
    let mut reader =
        csv::ReaderBuilder::new().has_headers(false).flexible(true).trim(csv::Trim::All).from_reader(text.as_bytes());
    let mut lines = Lines { text: text.as_bytes(), at: 0, line: 1 };
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|error| Place::file(file).wrong(format!("cannot be read: {error}")))?;
        let start = record.position().map_or(0, csv::Position::byte);
        rows.push((lines.of_row(start as usize), record.iter().map(str::to_owned).collect()));
    }
    Ok(rows)
}

/// Counts lines; the reader's own count is one too small after `\r\n` and after empty lines.
struct Lines<'a> {
    text: &'a [u8],
    at: usize,
    line: u64,
}

impl Lines<'_> {
    /// The line of the row whose record begins at byte `start` or, past line ends, behind it.
    fn of_row(&mut self, start: usize) -> u64 {
        while let Some(byte) = self.text.get(self.at).filter(|b| self.at < start || matches!(b, b'\r' | b'\n')) {
            self.line += u64::from(*byte == b'\n');
            self.at += 1;
        }
        self.line
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_counted_through_all_line_ends_and_empty_lines() {
        for end in ["\n", "\r\n"] {
            let text = ["a,b", "", "1, 2", "\"x", "y\",3", "", "", "4,5"].join(end);
            let rows = split("t.csv", &text).unwrap();
            let lines: Vec<u64> = rows.iter().map(|(line, _)| *line).collect();
            assert_eq!(lines, [1, 3, 4, 8], "{end:?}");
            assert_eq!(rows[1].1, ["1", "2"]);
        }
    }
}
