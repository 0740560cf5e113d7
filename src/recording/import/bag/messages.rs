//! The messages of others that are understood, by schema and encoding; everything else is named.

use foxglove::Decode as _;
use foxglove::messages::{CompressedImage, RawImage, Timestamp};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

use crate::events::Format;
use crate::image::GrayImage;
use crate::recording::EventPacket;
use crate::recording::cdr::Cursor;
use crate::recording::scan::{Channel, Message};

/// What is said of a message that is cut or of another type than its schema.
const NOT_AS_SAID: &str = "not what its schema says, or not in little-endian CDR";
/// A quaternion may be this much longer or shorter than 1.
const NORM_TOLERANCE: f64 = 1e-3;

/// An image and its stamp.
#[derive(Debug)]
pub(super) struct Picture {
    /// Stamp of its header, nanoseconds.
    pub(super) stamp_ns: u64,
    /// What it shows.
    pub(super) pixels: Pixels,
}

/// The pixels of an image.
#[derive(Debug)]
pub(super) enum Pixels {
    /// Gray, or made gray.
    Gray(GrayImage),
    /// A PNG or JPEG, as it is.
    Encoded(Vec<u8>),
}

/// Joints by name.
#[derive(Debug)]
pub(super) struct JointState {
    /// Stamp of its header, nanoseconds.
    pub(super) stamp_ns: u64,
    /// Names.
    pub(super) names: Vec<String>,
    /// Positions, rad; one a name.
    pub(super) positions: Vec<f64>,
    /// Speeds, rad/s; one a name or none at all.
    pub(super) speeds: Vec<f64>,
}

/// Where one frame is in another.
#[derive(Debug)]
pub(super) struct Placed {
    /// Stamp of its header, nanoseconds.
    pub(super) stamp_ns: u64,
    /// The frame that it is told in.
    pub(super) parent: String,
    /// The frame that is told.
    pub(super) child: String,
    /// Takes coordinates of the child to the parent.
    pub(super) parent_from_child: Isometry3<f64>,
}

/// The error that a topic has messages of a kind that is not understood here.
fn refused(channel: &Channel, allowed: &str) -> String {
    let Channel { schema, encoding, .. } = channel;
    let schema = if schema.is_empty() { "no schema".to_owned() } else { format!("schema `{schema}`") };
    format!(
        "has messages of {schema} in encoding `{encoding}`; allowed are {allowed}: convert the bag, or name another topic"
    )
}

/// An image of ROS or Foxglove.
pub(super) fn picture(Message { channel, data, .. }: &Message) -> Result<Picture, String> {
    match (channel.schema.as_str(), channel.encoding.as_str()) {
        ("sensor_msgs/msg/Image", "cdr") => raw_image(data),
        ("sensor_msgs/msg/CompressedImage", "cdr") => {
            let read = || {
                let mut cursor = Cursor::new(data)?;
                let (stamp_ns, _) = cursor.header()?;
                let _format = cursor.string()?;
                Some(Picture { stamp_ns, pixels: Pixels::Encoded(cursor.bytes()?.to_vec()) })
            };
            read().ok_or_else(|| NOT_AS_SAID.into())
        }
        ("foxglove.CompressedImage", "protobuf") => {
            let image = CompressedImage::decode(data.as_slice()).map_err(|why| why.to_string())?;
            Ok(Picture { stamp_ns: nanoseconds(image.timestamp), pixels: Pixels::Encoded(image.data.to_vec()) })
        }
        ("foxglove.RawImage", "protobuf") => {
            let image = RawImage::decode(data.as_slice()).map_err(|why| why.to_string())?;
            let gray = gray(image.width, image.height, &image.encoding, image.step, &image.data)?;
            Ok(Picture { stamp_ns: nanoseconds(image.timestamp), pixels: Pixels::Gray(gray) })
        }
        _ => Err(refused(
            channel,
            "sensor_msgs/msg/Image and CompressedImage in `cdr`, foxglove.RawImage and CompressedImage in `protobuf`",
        )),
    }
}

fn nanoseconds(at: Option<Timestamp>) -> u64 {
    at.map_or(0, |at| u64::from(at.sec()) * 1_000_000_000 + u64::from(at.nsec()))
}

fn raw_image(data: &[u8]) -> Result<Picture, String> {
    let read = || {
        let mut cursor = Cursor::new(data)?;
        let (stamp_ns, _) = cursor.header()?;
        let (height, width, encoding) = (cursor.u32()?, cursor.u32()?, cursor.string()?);
        // Of more than eight bits only; there are none here.
        let _is_bigendian = cursor.take(1)?;
        Some((stamp_ns, height, width, encoding, cursor.u32()?, cursor.bytes()?))
    };
    let (stamp_ns, height, width, encoding, step, bytes) = read().ok_or(NOT_AS_SAID)?;
    Ok(Picture { stamp_ns, pixels: Pixels::Gray(gray(width, height, &encoding, step, bytes)?) })
}

/// Rows of pixels as a gray image; `step` bytes from one row to the next.
fn gray(width: u32, height: u32, encoding: &str, step: u32, bytes: &[u8]) -> Result<GrayImage, String> {
    // Red, green and blue within the bytes of a pixel.
    let (channels, rgb) = match encoding {
        "mono8" | "8UC1" => (1, None),
        "rgb8" => (3, Some([0, 1, 2])),
        "bgr8" | "8UC3" => (3, Some([2, 1, 0])),
        "rgba8" => (4, Some([0, 1, 2])),
        "bgra8" | "8UC4" => (4, Some([2, 1, 0])),
        _ => {
            return Err(format!(
                "has images of encoding `{encoding}`; allowed are mono8, rgb8, bgr8, rgba8, bgra8: convert them, such as \
                 with image_proc"
            ));
        }
    };
    let [width, height, step] = [width, height, step].map(|n| n as usize);
    let row_bytes = width.saturating_mul(channels);
    let needed = height.saturating_sub(1).saturating_mul(step).saturating_add(row_bytes);
    if width == 0 || height == 0 || step < row_bytes || bytes.len() < needed {
        let found = bytes.len();
        return Err(format!(
            "has an image of {width}x{height} {encoding} with a step of {step} and only {found} bytes"
        ));
    }
    let mut pixels = Vec::with_capacity(width * height);
    for row in bytes.chunks(step).take(height) {
        let row = &row[..row_bytes];
        match rgb {
            None => pixels.extend(row),
            Some(rgb) => pixels.extend(row.chunks(channels).map(|pixel| luma(rgb.map(|i| pixel[i])))),
        }
    }
    Ok(GrayImage { width, height, pixels })
}

/// Luma of ITU-R BT.601 in whole numbers, as everybody computes it.
fn luma([r, g, b]: [u8; 3]) -> u8 {
    ((4899 * u32::from(r) + 9617 * u32::from(g) + 1868 * u32::from(b) + 8192) >> 14) as u8
}

/// A packet of an event camera, and the format of its words.
pub(super) fn packet(Message { channel, data, .. }: &Message) -> Result<(EventPacket, Format), String> {
    if (channel.schema.as_str(), channel.encoding.as_str()) != ("event_camera_msgs/msg/EventPacket", "cdr") {
        return Err(refused(channel, "event_camera_msgs/msg/EventPacket in `cdr`"));
    }
    let packet = EventPacket::from_cdr(data).ok_or(
        "is no EventPacket in little-endian CDR, or its words are big-endian; record it again on a little-endian computer",
    )?;
    match packet.encoding.as_str() {
        "evt3" => Ok(Format::Evt3),
        "evt2" => Ok(Format::Evt2),
        "evt21" => Ok(Format::Evt21 { legacy_halves: false }),
        "evt21_legacy" => Ok(Format::Evt21 { legacy_halves: true }),
        other => Err(format!(
            "has packets of encoding `{other}`; allowed are evt3, evt2 and evt21: record the raw words of the camera"
        )),
    }
    .map(|format| (packet, format))
}

/// The positions of joints.
pub(super) fn joints(Message { channel, data, .. }: &Message) -> Result<JointState, String> {
    if (channel.schema.as_str(), channel.encoding.as_str()) != ("sensor_msgs/msg/JointState", "cdr") {
        return Err(refused(channel, "sensor_msgs/msg/JointState in `cdr`"));
    }
    let read = || {
        let mut cursor = Cursor::new(data)?;
        let (stamp_ns, _) = cursor.header()?;
        let names = cursor.list(Cursor::string)?;
        let (positions, speeds) = (cursor.list(Cursor::f64)?, cursor.list(Cursor::f64)?);
        Some(JointState { stamp_ns, names, positions, speeds })
    };
    read().ok_or_else(|| NOT_AS_SAID.into())
}

/// Transforms between frames.
pub(super) fn transforms(Message { channel, data, .. }: &Message) -> Result<Vec<Placed>, String> {
    let tf = ["tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"];
    if !tf.contains(&channel.schema.as_str()) || channel.encoding != "cdr" {
        return Err(refused(channel, "tf2_msgs/msg/TFMessage in `cdr`"));
    }
    let mut cursor = Cursor::new(data).ok_or(NOT_AS_SAID)?;
    let found = cursor.list(|cursor| {
        let (stamp_ns, parent) = cursor.header()?;
        let child = cursor.string()?;
        let mut numbers = [0.0; 7];
        for number in &mut numbers {
            *number = cursor.f64()?;
        }
        Some((stamp_ns, parent, child, numbers))
    });
    found.ok_or(NOT_AS_SAID)?.into_iter().map(placed).collect()
}

fn placed(
    (stamp_ns, parent, child, [x, y, z, qx, qy, qz, qw]): (u64, String, String, [f64; 7]),
) -> Result<Placed, String> {
    let q = Quaternion::new(qw, qx, qy, qz);
    if !([x, y, z].iter().all(|v| v.is_finite()) && (q.norm() - 1.0).abs() <= NORM_TOLERANCE) {
        return Err(format!(
            "has a transform from `{child}` to `{parent}` that is none: {x}, {y}, {z}; {qx}, {qy}, {qz}, {qw}"
        ));
    }
    let parent_from_child = Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_quaternion(q));
    // Frames had a leading slash once.
    let [parent, child] = [parent, child].map(|frame| frame.trim_start_matches('/').to_owned());
    Ok(Placed { stamp_ns, parent, child, parent_from_child })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_become_gray_whatever_their_order_and_step() {
        // Two pixels a row, one byte of padding; the last row has none.
        let rgb = [255, 0, 0, 0, 255, 0, 9, 0, 0, 255, 255, 255, 255];
        let bgr = [0, 0, 255, 0, 255, 0, 9, 255, 0, 0, 255, 255, 255];
        // 0.299, 0.587 and 0.114 of 255.
        let expected = vec![76, 150, 29, 255];
        assert_eq!(gray(2, 2, "rgb8", 7, &rgb).unwrap().pixels, expected);
        assert_eq!(gray(2, 2, "bgr8", 7, &bgr).unwrap().pixels, expected);
        assert_eq!(gray(2, 1, "mono8", 2, &[3, 4]).unwrap().pixels, [3, 4]);
    }

    #[test]
    fn images_that_cannot_be_are_named() {
        assert!(gray(2, 2, "bayer_rggb8", 2, &[0; 4]).unwrap_err().contains("`bayer_rggb8`; allowed are mono8"));
        assert!(gray(2, 2, "mono16", 4, &[0; 8]).unwrap_err().contains("`mono16`"));
        for (width, height, step, bytes) in
            [(2, 2, 6, 11), (3, 2, 6, 99), (0, 2, 6, 99), (2, 0, 6, 99), (u32::MAX, u32::MAX, u32::MAX, 99)]
        {
            assert!(gray(width, height, "rgb8", step, &vec![0; bytes]).is_err(), "{width}x{height} {step} {bytes}");
        }
    }
}
