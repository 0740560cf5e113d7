//! Whole programs out of the bytes of a script socket.

/// Longest program text, bytes.
const MAX_BYTES: usize = 1 << 20;

const OPENING: [&str; 6] = ["def", "sec", "thread", "if", "while", "for"];

/// Collects bytes until a program is complete: the last `end` and its line end, or one line without `def`.
#[derive(Debug, Default)]
pub(in super::super) struct Upload {
    text: Vec<u8>,
    word: Vec<u8>,
    depth: usize,
    in_text: bool,
    in_comment: bool,
    has_words: bool,
}

impl Upload {
    /// Takes bytes in and gives the programs that they complete; bytes that are no UTF-8 are replaced.
    ///
    /// A text above 1 MiB is dropped.
    pub(in super::super) fn push(&mut self, bytes: &[u8]) -> Vec<String> {
        bytes.iter().filter_map(|byte| self.push_byte(*byte)).collect()
    }

    fn push_byte(&mut self, byte: u8) -> Option<String> {
        self.text.push(byte);
        let part_of_word = byte.is_ascii_alphanumeric() || byte == b'_';
        if !self.in_text && !self.in_comment && part_of_word {
            self.word.push(byte);
        } else {
            self.end_word();
        }
        match byte {
            b'"' if !self.in_comment => self.in_text = !self.in_text,
            b'#' if !self.in_text => self.in_comment = true,
            b'\n' => return self.end_line(),
            _ => {}
        }
        if self.text.len() > MAX_BYTES {
            *self = Self::default();
        }
        None
    }

    fn end_word(&mut self) {
        let word = std::mem::take(&mut self.word);
        self.has_words |= !word.is_empty();
        if OPENING.iter().any(|o| o.as_bytes() == word) {
            self.depth += 1;
        } else if word == b"end" {
            self.depth = self.depth.saturating_sub(1);
        }
    }

    fn end_line(&mut self) -> Option<String> {
        (self.in_comment, self.in_text) = (false, false);
        if self.depth > 0 {
            return None;
        }
        let done = std::mem::take(self);
        done.has_words.then(|| String::from_utf8_lossy(&done.text).into_owned())
    }
}
