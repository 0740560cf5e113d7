//! What can be made to go wrong with the simulated controller, and when: words for tests and the command line.
//!
//! Only words: `server` does what they say. Start at [`Planned`], read from texts such as
//! `protective_stop@move:3+0.4`.

#[cfg(test)]
mod tests;

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// Something that goes wrong. Written as its name, with `:` and a value where it needs one.
///
/// Faults of packages are those of RTDE connections, in the direction to the client; what ends, refuses or
/// silences connections does so on every interface. A fault stays until [`Fault::Heal`] unless it is over at once.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Fault {
    /// `drop`: every connection is closed in order; new ones are accepted.
    Drop,
    /// `reset`: every connection is reset (TCP RST); new ones are accepted.
    Reset,
    /// `refuse`: new connections are closed right after they are accepted.
    Refuse,
    /// `stall`: nothing is sent or read any more, connections stay open; time runs at real pace. What waited
    /// (up to 64 KiB, as in the buffers of a system) is delivered late on healing.
    Stall,
    /// `mute`: no data packages and no robot states are sent; time runs at real pace.
    Mute,
    /// `fragment:BYTES`: every package leaves in pieces, over up to 9 cycles (16 ms).
    Fragment {
        /// Size of a piece, 1 to 65535.
        bytes: usize,
    },
    /// `coalesce:N`: data packages leave N at once, so that all but the last are late.
    Coalesce {
        /// Packages in one write, 2 to 1000.
        packages: usize,
    },
    /// `jitter:MS`: every package is delayed by a random time, the order is kept.
    Jitter {
        /// Largest delay, ms of simulated time, up to 10000.
        up_to_ms: f64,
    },
    /// `late:MS`: every package is delayed.
    Late {
        /// Delay, ms of simulated time, up to 10000.
        by_ms: f64,
    },
    /// `garbage`: 100 random bytes in the stream.
    Garbage,
    /// `size:BYTES`: the header of a package with this size and nothing behind it.
    Size {
        /// The size field.
        bytes: u16,
    },
    /// `unknown`: a well-formed package of a kind that RTDE does not have; clients must survive it.
    Unknown,
    /// `text`: a text message of level warning.
    Text,
    /// `wrong_protocol`: the protocol version is not accepted.
    WrongProtocol,
    /// `missing_field:NAME`: this output or input is answered with NOT_FOUND.
    MissingField {
        /// Name of the field.
        name: String,
    },
    /// `in_use:NAME`: this input is answered with IN_USE.
    InUse {
        /// Name of the field.
        name: String,
    },
    /// `wrong_type:NAME`: this field has another type: INT32 instead of DOUBLE, DOUBLE instead of all others.
    WrongType {
        /// Name of the field.
        name: String,
    },
    /// `no_start`: the start of outputs is refused.
    NoStart,
    /// `nan:NAME`: this output is not a number; nothing happens to fields of integers.
    Nan {
        /// Name of the field.
        name: String,
    },
    /// `clock_back:S`: the time stamp jumps back, the connection stays.
    ClockBack {
        /// By how much, s.
        by_s: f64,
    },
    /// `restart`: every connection is closed, the program is gone, registers and time stamp begin at 0; the arm
    /// brakes and stays where it is, powered; new connections are accepted at once.
    Restart,
    /// `boot`: a restart, with robot mode 2 for 5 s and then 3.
    Boot,
    /// `protective_stop`: safety mode 3, the arm brakes on its path, the program pauses.
    ProtectiveStop,
    /// `emergency_stop`: safety mode 7, the arm brakes, power off, the program ends.
    EmergencyStop,
    /// `safeguard_stop`: safety mode 5, the arm brakes on its path, the program pauses, and stays so after healing.
    SafeguardStop,
    /// `reduced`: safety mode 2; everything goes on.
    Reduced,
    /// `violation`: safety mode 8, the arm brakes, power off, the program ends.
    Violation,
    /// `fault`: safety mode 9, the arm brakes, power off, the program ends.
    Fault,
    /// `power_off`: robot mode 3, the arm brakes, the program ends.
    PowerOff,
    /// `pause`: somebody pauses the program at the teach pendant.
    Pause,
    /// `stop_program`: somebody stops the program at the teach pendant.
    StopProgram,
    /// `slider:F`: somebody moves the speed slider.
    Slider {
        /// Speed, 0 to 1.
        fraction: f64,
    },
    /// `teach_button`: somebody holds the freedrive button; only the bit is simulated.
    TeachButton,
    /// `digital_input:N=0` or `=1`: a digital input changes.
    DigitalInput {
        /// Number, 0 to 17.
        bit: u32,
        /// New level.
        on: bool,
    },
    /// `local_control`: remote control is off; the dashboard says so, scripts are ignored.
    LocalControl,
    /// `dashboard_refuse`: the dashboard answers everything with an error.
    DashboardRefuse,
    /// `tcp_offset:MM`: another TCP becomes active, shifted along its own z.
    TcpOffset {
        /// Shift, mm.
        dz_mm: f64,
    },
    /// `payload:KG`: another payload becomes active.
    Payload {
        /// Mass, kg.
        kg: f64,
    },
    /// `foreign_program`: another program runs instead of ours: runtime state 2 and no motion.
    ForeignProgram,
    /// `heal`: every fault above is undone; a paused program stays paused, a program that ended stays ended.
    Heal,
}

/// When a fault happens. `+S` adds seconds of simulated time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum When {
    /// `connect` or `start`: from the beginning; what happens to a connection happens to the first of RTDE,
    /// before anything is answered. With `+S`: after the first RTDE connection was opened.
    Connect {
        /// Simulated time to wait, s.
        after_s: f64,
    },
    /// `t:S`: at this simulated time.
    Time {
        /// Since simulated time began, s.
        at_s: f64,
    },
    /// `move:K`: in the `K`-th motion of programs (`movej`, `movel`), 0.1 s after its begin if nothing is said.
    Move {
        /// Which motion, from 1; a move to where the arm already is does not count.
        number: u64,
        /// Simulated time to wait since it began, s.
        after_s: f64,
    },
    /// `still:K`: when the `K`-th motion has ended, while the arm settles.
    Still {
        /// Which motion, from 1.
        number: u64,
        /// Simulated time to wait since it ended, s.
        after_s: f64,
    },
}

/// A fault and when it happens, written `FAULT@WHEN`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Planned {
    /// When.
    pub when: When,
    /// What.
    pub fault: Fault,
}

/// What is wrong with the text of a fault.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FaultError {
    /// No such fault, or its value does not fit.
    #[error("`{found}` is not a fault; allowed: {allowed}")]
    Fault {
        /// The text.
        found: String,
        /// The form of this fault where its name is known, else all forms.
        allowed: String,
    },
    /// Not a time.
    #[error("`{found}` is not a time of a fault; allowed: {WHENS}, each with +S seconds of simulated time")]
    When {
        /// The text.
        found: String,
    },
    /// Without a time.
    #[error("`{found}` does not say when; write FAULT@WHEN such as drop@move:2+0.4, WHEN one of {WHENS}")]
    Timeless {
        /// The text.
        found: String,
    },
}

const WHENS: &str = "connect (or start), t:S, move:K, still:K with K from 1";

/// Delay in a motion where the text says none, s.
const INTO_MOVE_S: f64 = 0.1;

/// Longest time that a text may name, s.
const MAX_S: f64 = 1e6;

/// Longest delay of a package, ms.
const MAX_DELAY_MS: f64 = 1e4;

const PLAIN: [(&str, Fault); 26] = [
    ("drop", Fault::Drop),
    ("reset", Fault::Reset),
    ("refuse", Fault::Refuse),
    ("stall", Fault::Stall),
    ("mute", Fault::Mute),
    ("garbage", Fault::Garbage),
    ("unknown", Fault::Unknown),
    ("text", Fault::Text),
    ("wrong_protocol", Fault::WrongProtocol),
    ("no_start", Fault::NoStart),
    ("restart", Fault::Restart),
    ("boot", Fault::Boot),
    ("protective_stop", Fault::ProtectiveStop),
    ("emergency_stop", Fault::EmergencyStop),
    ("safeguard_stop", Fault::SafeguardStop),
    ("reduced", Fault::Reduced),
    ("violation", Fault::Violation),
    ("fault", Fault::Fault),
    ("power_off", Fault::PowerOff),
    ("pause", Fault::Pause),
    ("stop_program", Fault::StopProgram),
    ("teach_button", Fault::TeachButton),
    ("local_control", Fault::LocalControl),
    ("dashboard_refuse", Fault::DashboardRefuse),
    ("foreign_program", Fault::ForeignProgram),
    ("heal", Fault::Heal),
];

/// Names that take a value, and which.
const VALUED: [(&str, &str); 14] = [
    ("fragment", "BYTES from 1 to 65535"),
    ("coalesce", "PACKAGES from 2 to 1000"),
    ("jitter", "MS up to 10000"),
    ("late", "MS up to 10000"),
    ("size", "BYTES from 0 to 65535"),
    ("missing_field", "NAME of a field"),
    ("in_use", "NAME of an input"),
    ("wrong_type", "NAME of a field"),
    ("nan", "NAME of an output"),
    ("clock_back", "S, more than 0"),
    ("slider", "FRACTION from 0 to 1"),
    ("digital_input", "N=LEVEL, N from 0 to 17, LEVEL 0 or 1"),
    ("tcp_offset", "MM from -10000 to 10000"),
    ("payload", "KG from 0 to 100"),
];

impl Fault {
    /// Whether it happens to connections that are there, and is over at once.
    pub(super) fn needs_connection(&self) -> bool {
        matches!(self, Self::Drop | Self::Reset | Self::Garbage | Self::Size { .. } | Self::Unknown | Self::Text)
    }

    fn with_value(name: &str, value: &str) -> Option<Self> {
        Some(match name {
            "fragment" => Self::Fragment { bytes: within(value, 1..=65535)? },
            "coalesce" => Self::Coalesce { packages: within(value, 2..=1000)? },
            "jitter" => Self::Jitter { up_to_ms: within(value, 0.0..=MAX_DELAY_MS)? },
            "late" => Self::Late { by_ms: within(value, 0.0..=MAX_DELAY_MS)? },
            "size" => Self::Size { bytes: value.parse().ok()? },
            "missing_field" => Self::MissingField { name: field(value)? },
            "in_use" => Self::InUse { name: field(value)? },
            "wrong_type" => Self::WrongType { name: field(value)? },
            "nan" => Self::Nan { name: field(value)? },
            "clock_back" => Self::ClockBack { by_s: within(value, f64::MIN_POSITIVE..=MAX_S)? },
            "slider" => Self::Slider { fraction: within(value, 0.0..=1.0)? },
            "digital_input" => {
                let (bit, level) = value.split_once('=')?;
                Self::DigitalInput { bit: within(bit, 0..=17)?, on: within(level, 0..=1)? == 1 }
            }
            "tcp_offset" => Self::TcpOffset { dz_mm: within(value, -1e4..=1e4)? },
            "payload" => Self::Payload { kg: within(value, 0.0..=100.0)? },
            _ => return None,
        })
    }
}

/// A number in a range; not-a-number is in none.
fn within<T: FromStr + PartialOrd>(text: &str, range: RangeInclusive<T>) -> Option<T> {
    text.parse().ok().filter(|value| range.contains(value))
}

fn field(name: &str) -> Option<String> {
    let good = !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_');
    good.then(|| name.to_owned())
}

/// What may be written for this name, or everything where there is no such name.
fn allowed(name: &str) -> String {
    let form = |(name, value): &(&str, &str)| format!("{name}:{value}");
    if let Some(valued) = VALUED.iter().find(|(n, _)| *n == name) {
        return form(valued);
    }
    let plain = PLAIN.iter().map(|(name, _)| (*name).to_owned());
    match PLAIN.iter().find(|(n, _)| *n == name) {
        Some((name, _)) => format!("{name}, without a value"),
        None => plain.chain(VALUED.iter().map(form)).collect::<Vec<_>>().join(", "),
    }
}

impl FromStr for Fault {
    type Err = FaultError;

    fn from_str(text: &str) -> Result<Self, FaultError> {
        let (name, value) = text.split_once(':').map_or((text, None), |(name, value)| (name, Some(value)));
        let found = match value {
            None => PLAIN.iter().find(|(n, _)| *n == name).map(|(_, fault)| fault.clone()),
            Some(value) => Self::with_value(name, value),
        };
        found.ok_or_else(|| FaultError::Fault { found: text.into(), allowed: allowed(name) })
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fragment { bytes } => write!(f, "fragment:{bytes}"),
            Self::Coalesce { packages } => write!(f, "coalesce:{packages}"),
            Self::Jitter { up_to_ms } => write!(f, "jitter:{up_to_ms}"),
            Self::Late { by_ms } => write!(f, "late:{by_ms}"),
            Self::Size { bytes } => write!(f, "size:{bytes}"),
            Self::MissingField { name } => write!(f, "missing_field:{name}"),
            Self::InUse { name } => write!(f, "in_use:{name}"),
            Self::WrongType { name } => write!(f, "wrong_type:{name}"),
            Self::Nan { name } => write!(f, "nan:{name}"),
            Self::ClockBack { by_s } => write!(f, "clock_back:{by_s}"),
            Self::Slider { fraction } => write!(f, "slider:{fraction}"),
            Self::DigitalInput { bit, on } => write!(f, "digital_input:{bit}={}", u8::from(*on)),
            Self::TcpOffset { dz_mm } => write!(f, "tcp_offset:{dz_mm}"),
            Self::Payload { kg } => write!(f, "payload:{kg}"),
            plain => f.write_str(PLAIN.iter().find(|(_, fault)| fault == plain).map_or("", |(name, _)| name)),
        }
    }
}

impl FromStr for When {
    type Err = FaultError;

    fn from_str(text: &str) -> Result<Self, FaultError> {
        let seconds = |text: &str| within(text, 0.0..=MAX_S);
        let read = || {
            let (event, after) = match text.split_once('+') {
                Some((event, after)) => (event, Some(seconds(after)?)),
                None => (text, None),
            };
            let number = |text: &str| within(text, 1..=u64::MAX);
            let after_s = after.unwrap_or(0.0);
            Some(match event.split_once(':') {
                None if event == "connect" || event == "start" => Self::Connect { after_s },
                Some(("t", at)) => Self::Time { at_s: Some(seconds(at)? + after_s).filter(|s| *s <= MAX_S)? },
                Some(("move", k)) => Self::Move { number: number(k)?, after_s: after.unwrap_or(INTO_MOVE_S) },
                Some(("still", k)) => Self::Still { number: number(k)?, after_s },
                None | Some(_) => return None,
            })
        };
        read().ok_or_else(|| FaultError::When { found: text.into() })
    }
}

impl fmt::Display for When {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Connect { after_s: 0.0 } => write!(f, "connect"),
            Self::Connect { after_s } => write!(f, "connect+{after_s}"),
            Self::Time { at_s } => write!(f, "t:{at_s}"),
            Self::Move { number, after_s } => write!(f, "move:{number}+{after_s}"),
            Self::Still { number, after_s: 0.0 } => write!(f, "still:{number}"),
            Self::Still { number, after_s } => write!(f, "still:{number}+{after_s}"),
        }
    }
}

impl FromStr for Planned {
    type Err = FaultError;

    fn from_str(text: &str) -> Result<Self, FaultError> {
        let parts = text.rsplit_once('@');
        let (fault, when) = parts.ok_or_else(|| FaultError::Timeless { found: text.into() })?;
        Ok(Self { fault: fault.parse()?, when: when.parse()? })
    }
}

impl fmt::Display for Planned {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}@{}", self.fault, self.when)
    }
}

macro_rules! as_text {
    ($($name:ident),*) => {$(
        impl TryFrom<String> for $name {
            type Error = FaultError;

            fn try_from(text: String) -> Result<Self, FaultError> {
                text.parse()
            }
        }

        impl From<$name> for String {
            fn from(value: $name) -> Self {
                value.to_string()
            }
        }
    )*};
}

as_text!(Fault, When, Planned);
