//! OpenCV: the only module that names it. Plain functions, our types in and out.
//!
//! Uses `geometry`, `image`, `board`. Debian 12 has OpenCV 4.6, Debian 13 has 4.10, and their functions for
//! markers differ: `build.rs` says which are there. The ChArUco corners of 4.6 are biased by about half a pixel as
//! they come, so [`charuco`] refines them itself.

pub mod charuco;
pub mod codec;
mod mat;
pub mod solve;
pub mod video;
pub mod video_file;

/// What OpenCV could not do.
#[derive(Debug, thiserror::Error)]
pub enum CvError {
    /// OpenCV's own message.
    #[error("OpenCV: {0}")]
    OpenCv(#[from] opencv::Error),
    /// The name is not in OpenCV's list.
    #[error("unknown ArUco dictionary `{0}`; use a name such as DICT_4X4_50 or DICT_6X6_250")]
    Dictionary(String),
    /// The bytes are no image.
    #[error("not a readable image ({bytes} bytes); PNG, JPEG, BMP and TIFF are read")]
    NotAnImage {
        /// Number of bytes.
        bytes: usize,
    },
    /// A solver answered with something that is no camera or no pose.
    #[error("{0}")]
    Unusable(String),
}

/// Version of the OpenCV library that is loaded.
pub fn version() -> String {
    opencv::core::get_version_string().unwrap_or_else(|_| "unknown".into())
}

/// Lets OpenCV use `count` threads; results do not depend on it.
pub fn set_threads(count: usize) -> Result<(), CvError> {
    Ok(opencv::core::set_num_threads(i32::try_from(count).unwrap_or(i32::MAX))?)
}
