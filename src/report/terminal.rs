//! Sets a report as plain text, without colours or other control codes.

use super::document::{Align, Block, Document, Row, Section, Table, Tone, visible};

/// Columns of a line.
const WIDTH: usize = 100;
/// What everything below a title is moved in by.
const INDENT: usize = 2;
/// Between two columns of a table.
const GAP: usize = 2;
/// A column of words is not made narrower than this.
const NARROWEST: usize = 10;

/// The whole report; ends with the verdict again, because a long table scrolls the first one away.
pub(super) fn render(document: &Document) -> String {
    let mut out = Lines::default();
    out.line("CELLCAL CALIBRATION REPORT");
    out.facts(&document.subject);
    out.line("");
    let verdict = &document.verdict;
    out.line(&format!("VERDICT: {}", verdict.word));
    out.wrapped(verdict.meaning, INDENT);
    out.list(&verdict.reasons);
    document.sections.iter().for_each(|s| out.section(s));
    out.line("");
    out.line(&format!("VERDICT: {}", verdict.word));
    out.text
}

#[derive(Default)]
struct Lines {
    text: String,
}

impl Lines {
    fn line(&mut self, line: &str) {
        self.text.push_str(visible(line).trim_end());
        self.text.push('\n');
    }

    fn wrapped(&mut self, text: &str, indent: usize) {
        for line in wrap(text, WIDTH - indent) {
            self.line(&format!("{:indent$}{line}", ""));
        }
    }

    fn section(&mut self, section: &Section) {
        let loud = matches!(section.tone, Tone::Bad | Tone::Alert);
        let title = if loud { section.title.to_uppercase() } else { section.title.clone() };
        self.line("");
        self.line(&title);
        self.line(&if loud { "=" } else { "-" }.repeat(title.chars().count().min(WIDTH)));
        let mut before: Option<&Block> = None;
        for block in section.blocks.iter().filter(|b| !matches!(b, Block::Plot(_))) {
            if before.is_some_and(|b| apart(b, block)) {
                self.line("");
            }
            self.block(block);
            before = Some(block);
        }
    }

    fn block(&mut self, block: &Block) {
        match block {
            Block::Heading(text) => self.wrapped(text, 0),
            Block::Text(text) | Block::Note(text) => self.wrapped(text, INDENT),
            Block::List(items) => self.list(items),
            Block::Facts(facts) => self.facts(facts),
            Block::Table(table) => self.table(table),
            Block::Absent(why) => self.wrapped(&format!("absent: {why}"), INDENT),
            Block::Plot(_) => {}
        }
    }

    fn list(&mut self, items: &[String]) {
        for item in items {
            let lines = wrap(item, WIDTH - INDENT - 2);
            for (i, line) in lines.iter().enumerate() {
                self.line(&format!("{:INDENT$}{} {line}", "", if i == 0 { "-" } else { " " }));
            }
        }
    }

    fn facts(&mut self, facts: &[(String, String)]) {
        let longest = facts.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
        let names = longest.min(WIDTH / 3);
        for (name, value) in facts {
            let (name, value) = (wrap(name, names), wrap(value, WIDTH - INDENT - names - GAP));
            for i in 0..name.len().max(value.len()) {
                let at = |lines: &[String]| lines.get(i).cloned().unwrap_or_default();
                self.line(&format!("{:INDENT$}{:names$}{:GAP$}{}", "", at(&name), "", at(&value)));
            }
        }
    }

    fn table(&mut self, table: &Table) {
        let widths = widths(table);
        let titles: Vec<String> = table.columns.iter().map(|c| c.title.clone()).collect();
        self.row(table, &widths, &Row { cells: titles, tone: Tone::Plain });
        let rules: Vec<String> = widths.iter().map(|w| "-".repeat(*w)).collect();
        self.row(table, &widths, &Row { cells: rules, tone: Tone::Plain });
        table.rows.iter().for_each(|row| self.row(table, &widths, row));
    }

    fn row(&mut self, table: &Table, widths: &[usize], row: &Row) {
        let cells: Vec<Vec<String>> = row.cells.iter().zip(widths).map(|(cell, w)| wrap(cell, *w)).collect();
        for i in 0..cells.iter().map(Vec::len).max().unwrap_or(0) {
            let mut line = " ".repeat(INDENT);
            for ((cell, column), width) in cells.iter().zip(&table.columns).zip(widths) {
                let part = cell.get(i).map_or("", String::as_str);
                let set = match column.align {
                    Align::Left => format!("{part:<width$}"),
                    Align::Right => format!("{part:>width$}"),
                };
                line.push_str(&set);
                line.push_str(&" ".repeat(GAP));
            }
            self.line(&line);
        }
    }
}

/// Whether an empty line helps between two blocks.
fn apart(before: &Block, block: &Block) -> bool {
    let follows_heading = matches!(before, Block::Heading(_));
    let both_notes = matches!((before, block), (Block::Note(_), Block::Note(_)));
    let stands_out = |b: &Block| matches!(b, Block::Heading(_) | Block::Table(_) | Block::Note(_));
    !follows_heading && !both_notes && (stands_out(before) || stands_out(block))
}

/// Width of each column: as its longest cell needs, the widest columns of words narrowed until all fit.
fn widths(table: &Table) -> Vec<usize> {
    let cell = |row: &Row, i: usize| row.cells.get(i).map_or(0, |c| visible(c).trim().chars().count());
    let natural = |(i, column): (usize, &super::document::Column)| {
        let title = column.title.chars().count();
        table.rows.iter().map(|r| cell(r, i)).fold(title, usize::max)
    };
    let mut widths: Vec<usize> = table.columns.iter().enumerate().map(natural).collect();
    let room = WIDTH.saturating_sub(INDENT + GAP * widths.len().saturating_sub(1));
    while widths.iter().sum::<usize>() > room {
        let words = table.columns.iter().zip(widths.iter_mut()).filter(|(c, _)| c.align == Align::Left).map(|(_, w)| w);
        let Some(widest) = words.max().filter(|w| **w > NARROWEST) else { break };
        *widest -= 1;
    }
    widths
}

/// Breaks text into lines of at most `width` characters, between words where it can.
fn wrap(text: &str, width: usize) -> Vec<String> {
    let width = width.max(1);
    let (mut lines, mut line, mut length) = (Vec::new(), String::new(), 0);
    for word in visible(text).split_whitespace() {
        let letters: Vec<char> = word.chars().collect();
        for (i, piece) in letters.chunks(width).enumerate() {
            let space = usize::from(length > 0 && i == 0);
            if length > 0 && (i > 0 || length + space + piece.len() > width) {
                lines.push(std::mem::take(&mut line));
                length = 0;
            }
            if length > 0 {
                line.push(' ');
                length += 1;
            }
            line.extend(piece);
            length += piece.len();
        }
    }
    if length > 0 || lines.is_empty() {
        lines.push(line);
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_break_between_words_and_inside_long_ones() {
        assert_eq!(wrap("one two three", 7), ["one two", "three"]);
        assert_eq!(wrap("abcdefghij kl", 4), ["abcd", "efgh", "ij", "kl"]);
        assert_eq!(wrap("ab cdefghij", 4), ["ab", "cdef", "ghij"]);
        assert_eq!(wrap("", 4), [""]);
        assert_eq!(wrap("é\u{1b}[31m x", 20), ["é\u{fffd}[31m x"]);
    }

    #[test]
    fn a_wide_table_breaks_words_and_keeps_numbers() {
        let mut table = Table::new(&["<pose", "mm", "<reason"]);
        table.row(["p", "123456.78", &"why ".repeat(60)]);
        let mut out = Lines::default();
        out.table(&table);
        assert!(out.text.lines().all(|l| l.chars().count() <= WIDTH), "{}", out.text);
        assert!(out.text.contains("123456.78") && out.text.lines().count() > 4, "{}", out.text);
    }
}
