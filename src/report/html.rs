//! Sets a report as one HTML page. All text goes through [`escape`].

use std::fmt::Write as _;

use super::document::{Align, Block, Document, Section, Table, Tone, visible};
use super::plots;
use crate::calibration::result::CalibrationResult;

/// Cells of at most so many characters are not broken into lines.
const SHORT: usize = 32;

const STYLE: &str = include_str!("style.css");

/// The whole page; `result` is what the plots draw.
pub(super) fn render(document: &Document, result: &CalibrationResult) -> String {
    let mut page = Page { html: String::new(), result };
    let cell = escape(&result.cell);
    let word = escape(&document.verdict.word);
    // Browsers load nothing and run nothing, whatever a text might hold.
    page.push(&format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n<title>{word}: calibration of {cell}</title>\n\
         <style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n<h1>Calibration of {cell}</h1>\n"
    ));
    page.facts(&document.subject);
    page.verdict(document);
    page.contents(&document.sections);
    document.sections.iter().enumerate().for_each(|(i, s)| page.section(i, s));
    page.push("</main>\n</body>\n</html>\n");
    page.html
}

/// Text that is text wherever it stands in a page: in an element, in a quoted attribute, in an SVG.
pub(super) fn escape(text: &str) -> String {
    let mut escaped = String::new();
    for c in visible(text).chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            c => escaped.push(c),
        }
    }
    escaped
}

fn class(tone: Tone) -> &'static str {
    match tone {
        Tone::Plain => "plain",
        Tone::Good => "good",
        Tone::Bad => "bad",
        Tone::Alert => "alert",
    }
}

struct Page<'a> {
    html: String,
    result: &'a CalibrationResult,
}

impl Page<'_> {
    fn push(&mut self, html: &str) {
        self.html.push_str(html);
    }

    fn element(&mut self, tag: &str, class: &str, text: &str) {
        let class = if class.is_empty() { String::new() } else { format!(" class=\"{class}\"") };
        let _ = writeln!(self.html, "<{tag}{class}>{}</{tag}>", escape(text));
    }

    fn verdict(&mut self, document: &Document) {
        let verdict = &document.verdict;
        let _ = writeln!(self.html, "<div class=\"verdict {}\" role=\"status\">", class(verdict.tone));
        self.element("p", "word", &verdict.word);
        self.element("p", "", verdict.meaning);
        self.list(&verdict.reasons);
        self.push("</div>\n");
    }

    fn contents(&mut self, sections: &[Section]) {
        self.push("<nav aria-label=\"Sections\">\n");
        for (i, section) in sections.iter().enumerate() {
            let short = section.title.split(':').next().unwrap_or_default();
            let _ = writeln!(self.html, "<a href=\"#s{i}\">{}</a>", escape(short));
        }
        self.push("</nav>\n");
    }

    fn section(&mut self, number: usize, section: &Section) {
        let _ = writeln!(self.html, "<section id=\"s{number}\" class=\"{}\">", class(section.tone));
        self.element("h2", "", &section.title);
        section.blocks.iter().for_each(|b| self.block(b));
        self.push("</section>\n");
    }

    fn block(&mut self, block: &Block) {
        match block {
            Block::Heading(text) => self.element("h3", "", text),
            Block::Text(text) => self.element("p", "", text),
            Block::Note(text) => self.element("p", "note", text),
            Block::List(items) => self.list(items),
            Block::Facts(facts) => self.facts(facts),
            Block::Table(table) => self.table(table),
            Block::Absent(why) => self.element("p", "absent", &format!("absent: {why}")),
            Block::Plot(plot) => self.plot(*plot),
        }
    }

    fn list(&mut self, items: &[String]) {
        if items.is_empty() {
            return;
        }
        self.push("<ul>\n");
        items.iter().for_each(|item| self.element("li", "", item));
        self.push("</ul>\n");
    }

    fn facts(&mut self, facts: &[(String, String)]) {
        self.push("<dl>\n");
        for (name, value) in facts {
            self.element("dt", "", name);
            self.element("dd", "", value);
        }
        self.push("</dl>\n");
    }

    fn table(&mut self, table: &Table) {
        let side = |i: usize| table.columns.get(i).map_or("", |c| if c.align == Align::Right { "number" } else { "" });
        self.push("<div class=\"scroll\"><table>\n<thead><tr>\n");
        for (i, column) in table.columns.iter().enumerate() {
            self.element("th", side(i), &column.title);
        }
        self.push("</tr></thead>\n<tbody>\n");
        for row in &table.rows {
            let _ = writeln!(self.html, "<tr class=\"{}\">", class(row.tone));
            for (i, cell) in row.cells.iter().enumerate() {
                let words = if cell.chars().count() <= SHORT { "short" } else { "" };
                self.element("td", if side(i).is_empty() { words } else { side(i) }, cell);
            }
            self.push("</tr>\n");
        }
        self.push("</tbody>\n</table></div>\n");
    }

    fn plot(&mut self, plot: super::document::Plot) {
        let Some(figure) = plots::draw(plot, self.result) else { return };
        let class = if figure.wide { "wide" } else { "pair" };
        let _ = writeln!(self.html, "<figure class=\"{class}\">\n<div class=\"scroll drawings\">");
        figure.drawings.iter().for_each(|d| self.push(d));
        self.push("</div>\n");
        self.element("figcaption", "", &figure.caption);
        self.push("</figure>\n");
    }
}
