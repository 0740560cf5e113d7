//! Encoded images: which format they are in and whether they are whole.

use super::Probe;
use super::data_set::ImageFile;
use super::error::{ImportError, Place};
use super::source::io_error;

const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";
const JPEG: &[u8] = &[0xff, 0xd8, 0xff];

/// An image as it is in its file.
#[derive(Debug)]
pub(super) struct Image {
    /// Its bytes.
    pub(super) bytes: Vec<u8>,
    /// `png` or `jpeg`.
    pub(super) format: &'static str,
    /// Width and height, pixels.
    pub(super) size: (u32, u32),
}

/// Reads an image and checks that it is whole.
pub(super) fn read(file: &ImageFile, probe: Probe<'_>) -> Result<Image, ImportError> {
    let ImageFile { path, name, named_at } = file;
    let bytes = std::fs::read(path).map_err(|why| io_error(name, &why))?;
    let place = Place::file(name);
    let unreadable = |why: String| place.wrong(format!("is unreadable: {why} (named in {named_at})"));
    let format = whole_format(&bytes).map_err(unreadable)?;
    let size = probe(&bytes).map_err(unreadable)?;
    Ok(Image { bytes, format, size })
}

/// Reads an image that must be of this size; `declared_in` is where the size was said.
pub(super) fn read_sized(
    file: &ImageFile,
    size: (u32, u32),
    declared_in: &str,
    probe: Probe<'_>,
) -> Result<Image, ImportError> {
    let image = read(file, probe)?;
    if image.size == size {
        return Ok(image);
    }
    let ((width, height), (declared_width, declared_height)) = (image.size, size);
    let named_at = &file.named_at;
    Err(Place::file(&file.name).wrong(format!(
        "is {width} x {height} pixels, but {declared_in} {declared_width} x {declared_height} (named in {named_at}); \
         all images of a camera must have one size"
    )))
}

/// The format of an encoded image, or why it is none or not whole: decoders fill a cut image with gray.
pub(super) fn whole_format(bytes: &[u8]) -> Result<&'static str, String> {
    let (format, whole) = match bytes {
        [] => return Err("the file is empty".into()),
        _ if bytes.starts_with(PNG) => ("png", is_whole_png(bytes)),
        _ if bytes.starts_with(JPEG) => ("jpeg", is_whole_jpeg(bytes)),
        _ => {
            let head = bytes[..bytes.len().min(8)].escape_ascii();
            return Err(format!("it begins with `{head}`, which is neither PNG nor JPEG"));
        }
    };
    if whole { Ok(format) } else { Err(format!("the {format} is cut off after {} bytes", bytes.len())) }
}

/// Whether the chunks reach IEND.
fn is_whole_png(bytes: &[u8]) -> bool {
    let mut rest = &bytes[PNG.len()..];
    while let Some((length, after)) = rest.split_first_chunk::<4>() {
        let Some((kind, after)) = after.split_first_chunk::<4>() else { return false };
        // Each chunk ends with four bytes of checksum.
        let Some(next) = (u32::from_be_bytes(*length) as usize).checked_add(4).and_then(|n| after.get(n..)) else {
            return false;
        };
        if kind == b"IEND" {
            return true;
        }
        rest = next;
    }
    false
}

/// Whether the end marker comes after the last start of scan; inside a scan 0xff is always stuffed.
fn is_whole_jpeg(bytes: &[u8]) -> bool {
    let last = |marker: u8| bytes.windows(2).rposition(|pair| pair == [0xff, marker]);
    match (last(0xda), last(0xd9)) {
        (Some(scan), Some(end)) => end > scan,
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{jpeg, png};
    use super::*;

    #[test]
    fn whole_images_are_told_and_cut_ones_refused_at_every_byte() {
        for (image, format) in [(png(3, 2), "png"), (jpeg(3, 2), "jpeg")] {
            assert_eq!(whole_format(&image), Ok(format));
            assert!((0..image.len()).all(|cut| whole_format(&image[..cut]).is_err()), "{format}");
        }
        assert!(whole_format(b"BM123456789").unwrap_err().contains("begins with `BM123456`"));
    }
}
