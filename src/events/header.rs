//! The ASCII header of a Prophesee RAW file, of all ages: which words follow, and the size of the sensor.

use std::fmt;

use super::RawError;

/// Longest line that can belong to a header; a data block that happens to begin with `% ` has no line end so soon.
const LINE_BYTES_MAX: usize = 4096;

/// Prophesee systems from this number on send 64-bit words whole; older ones swap the halves.
const FIRST_SYSTEM_WITH_WHOLE_WORDS: u32 = 0x37;

/// The keys that [`Header::to_bytes`] derives from the format and the size.
const DERIVED_KEYS: [&str; 5] = ["evt", "format", "geometry", "endianness", "end"];

/// How events are packed into words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// EVT2: 32-bit words, one event each.
    Evt2,
    /// EVT2.1: 64-bit words, up to 32 events each.
    Evt21 {
        /// Whether the upper 32-bit half of each word comes first (`endianness=legacy`: EVK4 and older).
        legacy_halves: bool,
    },
    /// EVT3: 16-bit words that change a state.
    Evt3,
}

impl Format {
    /// The name as in ROS messages and JSON: `evt2`, `evt21`, `evt3`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Evt2 => "evt2",
            Self::Evt21 { .. } => "evt21",
            Self::Evt3 => "evt3",
        }
    }

    /// Bytes of a word.
    pub fn word_bytes(self) -> usize {
        match self {
            Self::Evt2 => 4,
            Self::Evt21 { .. } => 8,
            Self::Evt3 => 2,
        }
    }

    fn version(self) -> &'static str {
        match self {
            Self::Evt2 => "2.0",
            Self::Evt21 { .. } => "2.1",
            Self::Evt3 => "3.0",
        }
    }

    /// The format that a `format`, `evt` or ROS `encoding` value names; EVT2.1 in its whole-word form.
    ///
    /// # Errors
    /// [`RawError::UnknownFormat`] with the name.
    pub fn from_name(name: &str) -> Result<Self, RawError> {
        match name.to_ascii_lowercase().as_str() {
            "evt2" | "evt2.0" | "2.0" => Ok(Self::Evt2),
            "evt21" | "evt2.1" | "2.1" => Ok(Self::Evt21 { legacy_halves: false }),
            "evt3" | "evt3.0" | "3.0" => Ok(Self::Evt3),
            _ => Err(RawError::UnknownFormat { found: name.to_owned() }),
        }
    }
}

impl Format {
    /// The format that the `encoding` of an event camera names; `evt21_legacy` has the halves of its words exchanged.
    ///
    /// # Errors
    /// [`RawError::UnknownFormat`] with the name.
    pub fn from_encoding(encoding: &str) -> Result<Self, RawError> {
        match encoding {
            "evt21_legacy" => Ok(Self::Evt21 { legacy_halves: true }),
            name => Self::from_name(name),
        }
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// What the header of a RAW file says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Header {
    /// How the data is packed.
    pub format: Format,
    /// Columns of the sensor; `None` where the file does not tell.
    pub width: Option<u16>,
    /// Rows of the sensor; `None` where the file does not tell.
    pub height: Option<u16>,
    /// All `% key value` lines in order, without `% end`.
    pub fields: Vec<(String, String)>,
    /// Bytes up to the first data word; 0 for a header that was not read from a file.
    pub len_bytes: usize,
}

impl Header {
    /// A header to be written.
    pub fn new(format: Format, width: u16, height: u16) -> Self {
        Self { format, width: Some(width), height: Some(height), fields: Vec::new(), len_bytes: 0 }
    }

    /// Reads the header at the start of `bytes`, a whole RAW file or its first 64 KiB.
    ///
    /// The header ends at `% end`, or in old files before the first line that does not begin with `% `.
    /// Where the file does not name the format or the size, the system that recorded it does, if it is known.
    ///
    /// # Errors
    /// [`RawError`] for an empty file, a file that is no RAW, a format that is missing, unknown or contradictory,
    /// and a size that is malformed or contradictory.
    pub fn parse(bytes: &[u8]) -> Result<Self, RawError> {
        if bytes.is_empty() {
            return Err(RawError::Empty);
        }
        if !bytes.starts_with(b"% ") && !bytes.starts_with(b"%\n") {
            return Err(RawError::not_raw(bytes));
        }
        let (fields, len_bytes) = split_fields(bytes);
        let fields = Fields(fields);
        fields.refuse_dat()?;
        let format = fields.format()?;
        let (width, height) = fields.geometry()?.unzip();
        Ok(Self { format, width, height, fields: fields.0, len_bytes })
    }

    /// The value of the first line with this key.
    pub fn field(&self, key: &str) -> Option<&str> {
        find(&self.fields, key)
    }

    /// The header as written at the start of a file, `% end` included.
    ///
    /// `fields` come first, except those that follow from `format`, `width` and `height`; control characters in
    /// them become spaces.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut text = String::new();
        for (key, value) in self.fields.iter().filter(|(key, _)| !DERIVED_KEYS.contains(&key.as_str())) {
            push_line(&mut text, key, value);
        }
        push_line(&mut text, "evt", self.format.version());
        let mut format = self.format.name().to_ascii_uppercase();
        if let (Some(width), Some(height)) = (self.width, self.height) {
            format += &format!(";height={height};width={width}");
            push_line(&mut text, "geometry", &format!("{width}x{height}"));
        }
        if let Format::Evt21 { legacy_halves } = self.format {
            let endianness = if legacy_halves { "legacy" } else { "little" };
            format += &format!(";endianness={endianness}");
            push_line(&mut text, "endianness", endianness);
        }
        push_line(&mut text, "format", &format);
        text.push_str("% end\n");
        text.into_bytes()
    }
}

fn push_line(text: &mut String, key: &str, value: &str) {
    text.push_str("% ");
    text.extend([key, " ", value].into_iter().flat_map(str::chars).map(|c| if c.is_control() { ' ' } else { c }));
    text.push('\n');
}

fn find<'a>(fields: &'a [(String, String)], key: &str) -> Option<&'a str> {
    fields.iter().find(|(k, _)| k == key).map(|(_, value)| value.as_str())
}

/// The `% key value` lines and the number of bytes they take.
fn split_fields(bytes: &[u8]) -> (Vec<(String, String)>, usize) {
    let mut fields = Vec::new();
    let mut rest = bytes;
    while let Some((line, after)) = split_line(rest) {
        rest = after;
        if line == "end" {
            break;
        }
        if !line.is_empty() {
            let (key, value) = line.split_once([' ', '\t']).unwrap_or((line, ""));
            fields.push((key.to_owned(), value.trim().to_owned()));
        }
    }
    (fields, bytes.len() - rest.len())
}

/// One header line without its `% ` and its end, and what follows; `None` where data begins.
fn split_line(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let window = bytes.get(..LINE_BYTES_MAX.min(bytes.len()))?;
    let end = window.iter().position(|&b| b == b'\n')?;
    let line = std::str::from_utf8(&window[..end]).ok()?;
    let line = line.strip_prefix('%')?;
    let readable = (line.trim().is_empty() || line.starts_with(' ')) && !line.trim_end().contains(is_binary);
    readable.then(|| (line.trim(), &bytes[end + 1..]))
}

fn is_binary(c: char) -> bool {
    c.is_control() && c != '\t'
}

/// The lines of a header, and what follows from them.
struct Fields(Vec<(String, String)>);

impl Fields {
    fn get(&self, key: &str) -> Option<&str> {
        find(&self.0, key)
    }

    /// Refuses DAT files, which have `% ` lines too but other data.
    fn refuse_dat(&self) -> Result<(), RawError> {
        let is_dat = self.0.iter().any(|(key, value)| key == "Data" && value.starts_with("file containing"));
        if is_dat { Err(RawError::UnknownFormat { found: "DAT".to_owned() }) } else { Ok(()) }
    }

    fn format(&self) -> Result<Format, RawError> {
        let named = self.get("format").map(|text| Format::from_name(option_name(text))).transpose()?;
        let legacy = self.get("evt").map(Format::from_name).transpose()?;
        let format = match (named, legacy) {
            (Some(named), Some(legacy)) if named != legacy => {
                return Err(RawError::Contradiction {
                    what: "format",
                    one: format!("% format {named}"),
                    other: format!("% evt {}", legacy.version()),
                });
            }
            (Some(format), _) | (None, Some(format)) => format,
            (None, None) => self.system().map(|system| system.format).ok_or(RawError::NoFormat)?,
        };
        match format {
            Format::Evt21 { .. } => Ok(Format::Evt21 { legacy_halves: self.legacy_halves()? }),
            other => Ok(other),
        }
    }

    /// Whether EVT2.1 words come with their halves exchanged; the rule of OpenEB.
    fn legacy_halves(&self) -> Result<bool, RawError> {
        let named = self.get("format").and_then(|text| option(text, "endianness"));
        match named.or_else(|| self.get("endianness")) {
            Some("legacy") => Ok(true),
            Some("little") => Ok(false),
            Some(other) => Err(RawError::UnknownFormat { found: format!("EVT2.1 with endianness {other}") }),
            None => Ok(self.system_id().is_some_and(|id| id > 0 && id < FIRST_SYSTEM_WITH_WHOLE_WORDS)),
        }
    }

    fn geometry(&self) -> Result<Option<(u16, u16)>, RawError> {
        let in_format = self.get("format").and_then(|text| Some((option(text, "width")?, option(text, "height")?)));
        let in_format = in_format.map(|(width, height)| size(width, height)).transpose()?;
        let own = self.get("geometry").map(|text| {
            let (width, height) = text.split_once(['x', 'X']).unwrap_or((text, ""));
            size(width, height)
        });
        match (in_format, own.transpose()?) {
            (Some(one), Some(other)) if one != other => Err(RawError::Contradiction {
                what: "size",
                one: format!("{}x{} in % format", one.0, one.1),
                other: format!("{}x{} in % geometry", other.0, other.1),
            }),
            (Some(size), _) | (None, Some(size)) => Ok(Some(size)),
            (None, None) => Ok(self.system().map(|system| system.size)),
        }
    }

    /// The number of the recording system, if Prophesee made it: others use the same numbers for other things.
    fn system_id(&self) -> Option<u32> {
        let integrators = ["integrator_name", "camera_integrator_name", "plugin_integrator_name"];
        let foreign = integrators.iter().filter_map(|key| self.get(key)).any(|name| name != "Prophesee");
        if foreign { None } else { self.get("system_ID")?.parse().ok() }
    }

    fn system(&self) -> Option<System> {
        System::from_id(self.system_id()?)
    }
}

/// The part of `EVT3;height=720;width=1280` before the options.
fn option_name(text: &str) -> &str {
    text.split(';').next().unwrap_or(text).trim()
}

/// The value of one option of `EVT3;height=720;width=1280`.
fn option<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    text.split(';')
        .skip(1)
        .filter_map(|part| part.split_once('='))
        .find(|(k, _)| k.trim() == key)
        .map(|(_, v)| v.trim())
}

fn size(width: &str, height: &str) -> Result<(u16, u16), RawError> {
    let side = |text: &str| text.trim().parse::<u16>().ok().filter(|side| (1..=2048).contains(side));
    match (side(width), side(height)) {
        (Some(width), Some(height)) => Ok((width, height)),
        _ => Err(RawError::BadSize { found: format!("{width}x{height}") }),
    }
}

/// What a Prophesee system of old records when its header does not say; numbers from OpenEB.
struct System {
    format: Format,
    size: (u16, u16),
}

impl System {
    fn from_id(id: u32) -> Option<Self> {
        let (format, size) = match id {
            0x15 | 0x17 | 0x19 | 0x1c | 0x1d | 0x21 | 0x22 | 0x23 | 0x29 | 0x97 | 0x99 | 0xa1 | 0xa2 => {
                (Format::Evt2, (640, 480))
            }
            0x28 => (Format::Evt3, (640, 480)),
            0x1a | 0x1f | 0x27 | 0x9a => (Format::Evt2, (1280, 720)),
            0x1e | 0x20 | 0x2e | 0x30 | 0x31 | 0x32 | 0x35 | 0x3a => (Format::Evt3, (1280, 720)),
            0x3b | 0x40 => (Format::Evt21 { legacy_halves: false }, (320, 320)),
            _ => return None,
        };
        Some(Self { format, size })
    }
}
