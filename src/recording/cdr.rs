//! `event_camera_msgs/msg/EventPacket` in CDR, as ROS 2 writes it.

/// Schema text of the message with its dependencies, for encoding `ros2msg`.
pub(super) const EVENT_PACKET_SCHEMA: &str = "std_msgs/Header header
uint32 height
uint32 width
uint64 seq
uint64 time_base
string encoding
bool is_bigendian
uint8[] events
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
";

/// Raw words of an event camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EventPacket {
    /// Time of arrival, nanoseconds.
    pub stamp_ns: u64,
    /// Sensor height, pixels.
    pub height: u32,
    /// Sensor width, pixels.
    pub width: u32,
    /// Counts the packets of a session.
    pub sequence: u64,
    /// Sensor time of the first word in nanoseconds, wraps unrolled: where a decoder resumes after a gap.
    ///
    /// ROS leaves it undefined for EVT3.
    pub time_base_ns: u64,
    /// `evt3`, `evt2` or `evt21`.
    pub encoding: String,
    /// The words, little-endian.
    pub events: Vec<u8>,
}

impl EventPacket {
    /// Encodes as little-endian CDR.
    pub fn to_cdr(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(self.events.len() + 96);
        out.extend([0, 1, 0, 0]);
        out.extend(((self.stamp_ns / 1_000_000_000) as i32).to_le_bytes());
        out.extend(((self.stamp_ns % 1_000_000_000) as u32).to_le_bytes());
        put_string(&mut out, "event");
        align(&mut out, 4);
        out.extend(self.height.to_le_bytes());
        out.extend(self.width.to_le_bytes());
        align(&mut out, 8);
        out.extend(self.sequence.to_le_bytes());
        out.extend(self.time_base_ns.to_le_bytes());
        put_string(&mut out, &self.encoding);
        out.push(0);
        align(&mut out, 4);
        out.extend((self.events.len() as u32).to_le_bytes());
        out.extend(&self.events);
        out
    }

    /// Decodes little-endian CDR; `None` where the bytes are no such message.
    pub fn from_cdr(bytes: &[u8]) -> Option<Self> {
        let mut cursor = Cursor::new(bytes)?;
        let (stamp_ns, _) = cursor.header()?;
        let (height, width) = (cursor.u32()?, cursor.u32()?);
        let (sequence, time_base_ns) = (cursor.u64()?, cursor.u64()?);
        let encoding = cursor.string()?;
        let is_bigendian = cursor.take(1)?[0];
        if is_bigendian != 0 {
            return None;
        }
        let events = cursor.bytes()?.to_vec();
        Some(Self { stamp_ns, height, width, sequence, time_base_ns, encoding, events })
    }
}

fn align(out: &mut Vec<u8>, to: usize) {
    // Alignment counts from behind the four bytes of the encapsulation header.
    while !(out.len() - 4).is_multiple_of(to) {
        out.push(0);
    }
}

fn put_string(out: &mut Vec<u8>, text: &str) {
    align(out, 4);
    out.extend((text.len() as u32 + 1).to_le_bytes());
    out.extend(text.as_bytes());
    out.push(0);
}

/// Reads a message in little-endian CDR, field by field.
pub(super) struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Cursor<'a> {
    /// The message behind the four bytes that say how it is encoded; `None` where that is not little-endian CDR.
    pub(super) fn new(message: &'a [u8]) -> Option<Self> {
        let (head, bytes) = message.split_at_checked(4)?;
        (head[..2] == [0, 1]).then_some(Self { bytes, at: 0 })
    }

    pub(super) fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let taken = self.bytes.get(self.at..self.at.checked_add(count)?)?;
        self.at += count;
        Some(taken)
    }

    fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.at = self.at.next_multiple_of(N);
        self.take(N)?.try_into().ok()
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.number().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.number().map(u64::from_le_bytes)
    }

    pub(super) fn f64(&mut self) -> Option<f64> {
        self.number().map(f64::from_le_bytes)
    }

    pub(super) fn string(&mut self) -> Option<String> {
        let length = self.u32()? as usize;
        // Some writers give an empty text no end either.
        let text = if length == 0 { &[] } else { self.take(length)?.strip_suffix(&[0])? };
        String::from_utf8(text.to_vec()).ok()
    }

    /// `uint8[]`.
    pub(super) fn bytes(&mut self) -> Option<&'a [u8]> {
        let length = self.u32()? as usize;
        self.take(length)
    }

    /// A sequence of anything.
    pub(super) fn list<T>(&mut self, mut one: impl FnMut(&mut Self) -> Option<T>) -> Option<Vec<T>> {
        (0..self.u32()?).map(|_| one(self)).collect()
    }

    /// `std_msgs/Header`: its stamp in nanoseconds, and its frame.
    pub(super) fn header(&mut self) -> Option<(u64, String)> {
        let (seconds, nanoseconds) = (self.u32()?, self.u32()?);
        // Seconds are signed there; nothing was recorded before 1970.
        let stamp_ns = u64::from(i32::try_from(seconds).ok()?.unsigned_abs()) * 1_000_000_000 + u64::from(nanoseconds);
        Some((stamp_ns, self.string()?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packet_comes_back_and_a_cut_one_is_refused() {
        for encoding in ["evt3", "evt21", "evt2"] {
            let packet = EventPacket {
                stamp_ns: 12_345_678_901,
                height: 720,
                width: 1280,
                sequence: 7,
                time_base_ns: 1 << 40,
                encoding: encoding.into(),
                events: (0..101).collect(),
            };
            let bytes = packet.to_cdr();
            assert_eq!(EventPacket::from_cdr(&bytes), Some(packet));
            assert!((0..bytes.len()).all(|cut| EventPacket::from_cdr(&bytes[..cut]).is_none()));
        }
    }
}
