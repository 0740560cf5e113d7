//! What a report says, before it is set as text or HTML.

/// How a part is to be taken. Never the only carrier of a meaning: its words say the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Tone {
    Plain,
    Good,
    Bad,
    /// Worth a look.
    Alert,
}

/// A whole report.
#[derive(Debug)]
pub(super) struct Document {
    /// Cell, session, program.
    pub(super) subject: Vec<(String, String)>,
    pub(super) verdict: Verdict,
    pub(super) sections: Vec<Section>,
}

/// The first thing that is read.
#[derive(Debug)]
pub(super) struct Verdict {
    /// In capitals.
    pub(super) word: String,
    pub(super) tone: Tone,
    /// What the word means for the reader.
    pub(super) meaning: &'static str,
    /// Why, one sentence each.
    pub(super) reasons: Vec<String>,
}

/// A part with a title.
#[derive(Debug)]
pub(super) struct Section {
    pub(super) title: String,
    pub(super) tone: Tone,
    pub(super) blocks: Vec<Block>,
}

/// A piece of a section.
#[derive(Debug)]
pub(super) enum Block {
    Heading(String),
    Text(String),
    /// What a number can and cannot tell.
    Note(String),
    List(Vec<String>),
    /// Names and values.
    Facts(Vec<(String, String)>),
    Table(Table),
    /// Why the section is missing.
    Absent(String),
    /// Only where pictures can be shown.
    Plot(Plot),
}

/// The plots.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Plot {
    TargetCheck,
    ViewRms,
    Layout,
    Panel,
}

#[derive(Debug)]
pub(super) struct Table {
    pub(super) columns: Vec<Column>,
    pub(super) rows: Vec<Row>,
}

#[derive(Debug)]
pub(super) struct Column {
    pub(super) title: String,
    pub(super) align: Align,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Align {
    /// Words; may be broken into lines.
    Left,
    /// Numbers; never broken.
    Right,
}

#[derive(Debug)]
pub(super) struct Row {
    pub(super) cells: Vec<String>,
    pub(super) tone: Tone,
}

impl Section {
    pub(super) fn new(title: impl Into<String>, blocks: Vec<Block>) -> Self {
        Self { title: title.into(), tone: Tone::Plain, blocks }
    }

    pub(super) fn absent(title: impl Into<String>, why: impl Into<String>) -> Self {
        Self::new(title, vec![Block::Absent(why.into())])
    }
}

impl Table {
    /// Columns whose title starts with `<` hold words, all others numbers.
    pub(super) fn new(titles: &[&str]) -> Self {
        let column = |title: &&str| match title.strip_prefix('<') {
            Some(words) => Column { title: words.into(), align: Align::Left },
            None => Column { title: (*title).into(), align: Align::Right },
        };
        Self { columns: titles.iter().map(column).collect(), rows: Vec::new() }
    }

    pub(super) fn row<S: Into<String>>(&mut self, cells: impl IntoIterator<Item = S>) {
        self.toned(Tone::Plain, cells);
    }

    pub(super) fn toned<S: Into<String>>(&mut self, tone: Tone, cells: impl IntoIterator<Item = S>) {
        self.rows.push(Row { cells: cells.into_iter().map(Into::into).collect(), tone });
    }
}

/// Text on one line without anything that could steer a terminal or turn the direction of reading.
pub(super) fn visible(text: &str) -> String {
    let shown = |c: char| match c {
        '\n' | '\r' | '\t' => ' ',
        '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => '\u{fffd}',
        c if c.is_control() => '\u{fffd}',
        c => c,
    };
    text.chars().map(shown).collect()
}
