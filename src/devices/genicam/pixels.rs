//! Pixel formats: what a camera sends, and gray images of 8 bits.

use crate::image::GrayImage;

/// Formats that are taken, best first: as SFNC names them, with their significant bits.
pub(super) const FORMATS: [(&str, u32); 5] =
    [("Mono8", 8), ("Mono10", 10), ("Mono12", 12), ("Mono14", 14), ("Mono16", 16)];

/// An image out of the bytes of a buffer: one byte a pixel, or two, little-endian, of which the high `bits` are kept.
pub(super) fn gray(bytes: &[u8], size: [u32; 2], bits: u32) -> Result<GrayImage, String> {
    let [width, height] = size.map(|n| n as usize);
    let (count, deep) = (width * height, bits > 8);
    let needed = if deep { 2 * count } else { count };
    let Some(bytes) = bytes.get(..needed) else {
        return Err(format!("sent {} bytes for an image of {width}x{height}, which has {needed}", bytes.len()));
    };
    let narrowed = |pair: &[u8]| {
        let value = u32::from(pair[0]) | u32::from(pair[1]) << 8;
        u8::try_from(value >> (bits - 8)).unwrap_or(u8::MAX)
    };
    let pixels = if deep { bytes.chunks_exact(2).map(narrowed).collect() } else { bytes.to_vec() };
    Ok(GrayImage { width, height, pixels })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deep_pixels_keep_their_high_bits() {
        let of = |values: [u16; 4], bits| {
            let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
            gray(&bytes, [2, 2], bits).unwrap().pixels
        };
        assert_eq!(of([0, 4, 1020, 1023], 10), [0, 1, 255, 255]);
        assert_eq!(of([0, 16, 2048, 4095], 12), [0, 1, 128, 255]);
        assert_eq!(of([255, 256, 0x8000, 0xffff], 16), [0, 1, 128, 255]);
        assert_eq!(gray(&[1, 2, 3, 4, 5], [2, 2], 8).unwrap().pixels, [1, 2, 3, 4], "rows may be padded at the end");
        assert!(gray(&[1, 2, 3], [2, 2], 8).unwrap_err().starts_with("sent 3 bytes"));
    }
}
