//! What a package says, in both directions.

use bytes::{Buf as _, BufMut as _, Bytes, BytesMut};

use super::{CodecError, FieldAnswer, Package};

const REQUEST_PROTOCOL_VERSION: u8 = b'V';
const GET_URCONTROL_VERSION: u8 = b'v';
const TEXT_MESSAGE: u8 = b'M';
pub(super) const DATA_PACKAGE: u8 = b'U';
const SETUP_OUTPUTS: u8 = b'O';
const SETUP_INPUTS: u8 = b'I';
const START: u8 = b'S';
const PAUSE: u8 = b'P';

/// Bytes of field names that a recipe may have.
const MAX_NAMES_BYTES: usize = 2048;

/// How bad a text message is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TextLevel {
    /// 0.
    Exception,
    /// 1.
    Error,
    /// 2.
    Warning,
    /// 3, and every unknown level.
    Info,
}

impl TextLevel {
    const ALL: [Self; 4] = [Self::Exception, Self::Error, Self::Warning, Self::Info];

    fn from_byte(byte: u8) -> Self {
        Self::ALL.get(usize::from(byte)).copied().unwrap_or(Self::Info)
    }
}

/// A text message, either way.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TextMessage {
    /// The text; at most 255 bytes are sent.
    pub message: String,
    /// Who says it; at most 255 bytes are sent.
    pub source: String,
    /// How bad it is.
    pub level: TextLevel,
}

/// Version of the controller software.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ControllerVersion {
    /// 5 on PolyScope 5, 10 on PolyScope X.
    pub major: u32,
    /// Minor.
    pub minor: u32,
    /// Bug fix.
    pub bugfix: u32,
    /// Build.
    pub build: u32,
}

impl std::fmt::Display for ControllerVersion {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}.{}.{}.{}", self.major, self.minor, self.bugfix, self.build)
    }
}

/// From the client to the controller.
#[derive(Debug, Clone, PartialEq)]
pub enum Request {
    /// Asks for this protocol version.
    ProtocolVersion(u16),
    /// Asks for the version of the controller.
    ControllerVersion,
    /// Asks for these outputs at this rate, Hz.
    SetupOutputs {
        /// Rate, Hz.
        frequency_hz: f64,
        /// Field names.
        names: Vec<String>,
    },
    /// Claims these inputs.
    SetupInputs {
        /// Field names.
        names: Vec<String>,
    },
    /// Starts the outputs.
    Start,
    /// Pauses the outputs.
    Pause,
    /// Says something.
    Text(TextMessage),
    /// Input values.
    Data {
        /// Number of the input recipe.
        recipe: u8,
        /// The values, for [`super::Recipe::decode`].
        body: Bytes,
    },
}

/// From the controller to the client.
#[derive(Debug, Clone, PartialEq)]
pub enum Answer {
    /// Whether the protocol version is accepted.
    ProtocolVersion(bool),
    /// The version of the controller.
    ControllerVersion(ControllerVersion),
    /// The output recipe.
    SetupOutputs {
        /// Number of the recipe.
        recipe: u8,
        /// One per name, in order.
        fields: Vec<FieldAnswer>,
    },
    /// The input recipe; number 0 where it is not valid.
    SetupInputs {
        /// Number of the recipe.
        recipe: u8,
        /// One per name, in order.
        fields: Vec<FieldAnswer>,
    },
    /// Whether outputs were started.
    Start(bool),
    /// Whether outputs were paused.
    Pause(bool),
    /// Says something; may come at any time.
    Text(TextMessage),
    /// Output values; may come at any time after the start.
    Data {
        /// Number of the output recipe.
        recipe: u8,
        /// The values, for [`super::Recipe::decode`].
        body: Bytes,
    },
}

impl Request {
    /// The bytes on the wire.
    pub fn to_bytes(&self) -> Result<Bytes, CodecError> {
        let mut payload = BytesMut::new();
        let kind = match self {
            Self::ProtocolVersion(version) => {
                payload.put_u16(*version);
                REQUEST_PROTOCOL_VERSION
            }
            Self::ControllerVersion => GET_URCONTROL_VERSION,
            Self::SetupOutputs { frequency_hz, names } => {
                payload.put_f64(*frequency_hz);
                put_names(&mut payload, names)?;
                SETUP_OUTPUTS
            }
            Self::SetupInputs { names } => {
                put_names(&mut payload, names)?;
                SETUP_INPUTS
            }
            Self::Start => START,
            Self::Pause => PAUSE,
            Self::Text(text) => put_text(&mut payload, text),
            Self::Data { recipe, body } => put_data(&mut payload, *recipe, body),
        };
        Package { kind, payload: payload.freeze() }.to_bytes()
    }

    /// What a package from a client says.
    pub fn from_package(package: Package) -> Result<Self, CodecError> {
        let Package { kind, mut payload } = package;
        Ok(match kind {
            REQUEST_PROTOCOL_VERSION => Self::ProtocolVersion(exactly("protocol version", payload, take_u16)?),
            GET_URCONTROL_VERSION => exactly("version request", payload, |_| Some(Self::ControllerVersion))?,
            SETUP_OUTPUTS => {
                let frequency_hz = payload.try_get_f64().map_err(|_| short("output setup", payload.len()))?;
                Self::SetupOutputs { frequency_hz, names: names_of("output setup", &payload)? }
            }
            SETUP_INPUTS => Self::SetupInputs { names: names_of("input setup", &payload)? },
            START => exactly("start", payload, |_| Some(Self::Start))?,
            PAUSE => exactly("pause", payload, |_| Some(Self::Pause))?,
            TEXT_MESSAGE => Self::Text(exactly("text", payload, take_text)?),
            DATA_PACKAGE => {
                let recipe = payload.try_get_u8().map_err(|_| short("data", 0))?;
                Self::Data { recipe, body: payload }
            }
            kind => return Err(CodecError::Kind { kind }),
        })
    }
}

impl Answer {
    /// The bytes on the wire.
    pub fn to_bytes(&self) -> Result<Bytes, CodecError> {
        let mut payload = BytesMut::new();
        let kind = match self {
            Self::ProtocolVersion(accepted) => put_bool(&mut payload, *accepted, REQUEST_PROTOCOL_VERSION),
            Self::ControllerVersion(v) => {
                [v.major, v.minor, v.bugfix, v.build].iter().for_each(|n| payload.put_u32(*n));
                GET_URCONTROL_VERSION
            }
            Self::SetupOutputs { recipe, fields } => put_recipe(&mut payload, *recipe, fields, SETUP_OUTPUTS),
            Self::SetupInputs { recipe, fields } => put_recipe(&mut payload, *recipe, fields, SETUP_INPUTS),
            Self::Start(accepted) => put_bool(&mut payload, *accepted, START),
            Self::Pause(accepted) => put_bool(&mut payload, *accepted, PAUSE),
            Self::Text(text) => put_text(&mut payload, text),
            Self::Data { recipe, body } => put_data(&mut payload, *recipe, body),
        };
        Package { kind, payload: payload.freeze() }.to_bytes()
    }

    /// What a package from a controller says.
    pub fn from_package(package: Package) -> Result<Self, CodecError> {
        let Package { kind, mut payload } = package;
        Ok(match kind {
            REQUEST_PROTOCOL_VERSION => Self::ProtocolVersion(exactly("protocol version", payload, take_bool)?),
            GET_URCONTROL_VERSION => Self::ControllerVersion(exactly("version", payload, take_version)?),
            SETUP_OUTPUTS => {
                let (recipe, fields) = take_recipe("output setup", &payload)?;
                Self::SetupOutputs { recipe, fields }
            }
            SETUP_INPUTS => {
                let (recipe, fields) = take_recipe("input setup", &payload)?;
                Self::SetupInputs { recipe, fields }
            }
            START => Self::Start(exactly("start", payload, take_bool)?),
            PAUSE => Self::Pause(exactly("pause", payload, take_bool)?),
            TEXT_MESSAGE => Self::Text(exactly("text", payload, take_text)?),
            DATA_PACKAGE => {
                let recipe = payload.try_get_u8().map_err(|_| short("data", 0))?;
                Self::Data { recipe, body: payload }
            }
            kind => return Err(CodecError::Kind { kind }),
        })
    }
}

fn short(what: &'static str, bytes: usize) -> CodecError {
    CodecError::Payload { what, why: format!("only {bytes} bytes") }
}

/// Reads with `take`, and refuses missing and left-over bytes.
fn exactly<T>(what: &'static str, mut payload: Bytes, take: impl Fn(&mut Bytes) -> Option<T>) -> Result<T, CodecError> {
    let bytes = payload.len();
    match take(&mut payload) {
        Some(taken) if payload.is_empty() => Ok(taken),
        Some(_) => Err(CodecError::Payload { what, why: format!("{} of {bytes} bytes left over", payload.len()) }),
        None => Err(short(what, bytes)),
    }
}

fn take_u16(from: &mut Bytes) -> Option<u16> {
    from.try_get_u16().ok()
}

fn take_bool(from: &mut Bytes) -> Option<bool> {
    from.try_get_u8().ok().map(|b| b != 0)
}

fn take_version(from: &mut Bytes) -> Option<ControllerVersion> {
    let mut next = || from.try_get_u32().ok();
    Some(ControllerVersion { major: next()?, minor: next()?, bugfix: next()?, build: next()? })
}

fn take_text(from: &mut Bytes) -> Option<TextMessage> {
    let message = take_short_text(from)?;
    let source = take_short_text(from)?;
    let level = TextLevel::from_byte(from.try_get_u8().ok()?);
    Some(TextMessage { message, source, level })
}

fn take_short_text(from: &mut Bytes) -> Option<String> {
    let length = usize::from(from.try_get_u8().ok()?);
    (from.len() >= length).then(|| String::from_utf8_lossy(&from.split_to(length)).into_owned())
}

fn take_recipe(what: &'static str, payload: &Bytes) -> Result<(u8, Vec<FieldAnswer>), CodecError> {
    let Some((recipe, types)) = payload.split_first() else { return Err(short(what, 0)) };
    let unknown = |name: &str| CodecError::Payload { what, why: format!("unknown field type `{name}`") };
    let names = names_of(what, types)?;
    let fields: Result<Vec<_>, _> = names.iter().map(|n| FieldAnswer::from_name(n).ok_or_else(|| unknown(n))).collect();
    Ok((*recipe, fields?))
}

/// Comma-separated names; an empty last one (a trailing comma) is ignored.
fn names_of(what: &'static str, bytes: &[u8]) -> Result<Vec<String>, CodecError> {
    let printable = bytes.iter().all(|b| b.is_ascii_graphic());
    let text = std::str::from_utf8(bytes).ok().filter(|_| printable);
    let Some(text) = text else {
        return Err(CodecError::Payload { what, why: "names are not printable ASCII".into() });
    };
    let mut names: Vec<String> = text.split(',').map(str::to_owned).collect();
    if names.last().is_some_and(String::is_empty) {
        names.pop();
    }
    Ok(names)
}

fn put_names(payload: &mut BytesMut, names: &[String]) -> Result<(), CodecError> {
    let fail = |why: String| Err(CodecError::Encode { what: "setup", why });
    let good = |name: &String| !name.is_empty() && name.bytes().all(|b| b.is_ascii_graphic() && b != b',');
    if let Some(bad) = names.iter().find(|n| !good(n)) {
        return fail(format!("`{bad}` is not a field name"));
    }
    let text = names.join(",");
    if text.len() > MAX_NAMES_BYTES {
        return fail(format!("{} bytes of names, at most {MAX_NAMES_BYTES} are allowed", text.len()));
    }
    payload.put_slice(text.as_bytes());
    Ok(())
}

fn put_bool(payload: &mut BytesMut, value: bool, kind: u8) -> u8 {
    payload.put_u8(u8::from(value));
    kind
}

fn put_recipe(payload: &mut BytesMut, recipe: u8, fields: &[FieldAnswer], kind: u8) -> u8 {
    let names: Vec<_> = fields.iter().map(|f| f.name()).collect();
    payload.put_u8(recipe);
    payload.put_slice(names.join(",").as_bytes());
    kind
}

fn put_data(payload: &mut BytesMut, recipe: u8, body: &[u8]) -> u8 {
    payload.put_u8(recipe);
    payload.put_slice(body);
    DATA_PACKAGE
}

fn put_text(payload: &mut BytesMut, text: &TextMessage) -> u8 {
    for part in [&text.message, &text.source] {
        let cut = part.floor_char_boundary(usize::from(u8::MAX));
        let bytes = &part.as_bytes()[..cut];
        payload.put_u8(bytes.len() as u8);
        payload.put_slice(bytes);
    }
    let level = TextLevel::ALL.iter().position(|l| *l == text.level).unwrap_or(0);
    payload.put_u8(level as u8);
    TEXT_MESSAGE
}
