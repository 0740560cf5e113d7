//! Text to tokens.

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Word {
    Int(i32),
    Float(f64),
    Text(String),
    Name(String),
    /// Operators and brackets.
    Sign(&'static str),
    End,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Token {
    pub(super) word: Word,
    pub(super) line: usize,
    /// Whether it is the first on its line: a bracket there opens no call and no index.
    pub(super) opens_line: bool,
}

/// Longest first where one begins another.
const SIGNS: [&str; 20] =
    ["==", "!=", "<=", ">=", "<", ">", "=", "+", "-", "*", "/", "%", "(", ")", "[", "]", ",", ":", ";", "."];

/// The tokens of a text and an [`Word::End`]; an error says what and in which line.
pub(super) fn tokens(text: &str) -> Result<Vec<Token>, String> {
    let mut found = Vec::new();
    let (mut rest, mut line, mut opens_line) = (text, 1, true);
    while let Some(c) = rest.chars().next() {
        if c == '\n' {
            (line, opens_line, rest) = (line + 1, true, &rest[1..]);
        } else if c.is_whitespace() {
            rest = &rest[c.len_utf8()..];
        } else if c == '#' {
            rest = rest.find('\n').map_or("", |end| &rest[end..]);
        } else {
            let (word, length) = word(rest).ok_or_else(|| format!("line {line}: `{c}` begins no word"))?;
            found.push(Token { word, line, opens_line });
            (opens_line, rest) = (false, &rest[length..]);
        }
    }
    found.push(Token { word: Word::End, line, opens_line: true });
    Ok(found)
}

fn word(rest: &str) -> Option<(Word, usize)> {
    let first = rest.chars().next()?;
    if first == '"' {
        let inside = &rest[1..];
        let end = inside.find(['"', '\n']).filter(|end| inside[*end..].starts_with('"'))?;
        return Some((Word::Text(inside[..end].to_owned()), end + 2));
    }
    if first.is_ascii_alphabetic() || first == '_' {
        let length = rest.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(rest.len());
        return Some((Word::Name(rest[..length].to_owned()), length));
    }
    if first.is_ascii_digit() || (first == '.' && rest[1..].starts_with(|c: char| c.is_ascii_digit())) {
        return number(rest);
    }
    SIGNS.iter().find(|s| rest.starts_with(**s)).map(|s| (Word::Sign(s), s.len()))
}

fn number(rest: &str) -> Option<(Word, usize)> {
    let bytes = rest.as_bytes();
    let digits = |from: usize| bytes[from..].iter().take_while(|b| b.is_ascii_digit()).count();
    let mut length = digits(0);
    if bytes.get(length) == Some(&b'.') {
        length += 1 + digits(length + 1);
    }
    if matches!(bytes.get(length), Some(b'e' | b'E')) {
        let sign = usize::from(matches!(bytes.get(length + 1), Some(b'+' | b'-')));
        let exponent = digits((length + 1 + sign).min(bytes.len()));
        if exponent > 0 {
            length += 1 + sign + exponent;
        }
    }
    let text = &rest[..length];
    let whole = text.parse::<i32>().ok().map(Word::Int);
    Some((whole.or_else(|| text.parse().ok().map(Word::Float))?, length))
}
