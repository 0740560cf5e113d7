//! How many markers each ArUco dictionary has.

use crate::board::DICTIONARIES;

/// In the order of [`DICTIONARIES`].
const MARKERS: [u32; DICTIONARIES.len()] =
    [50, 100, 250, 1000, 50, 100, 250, 1000, 50, 100, 250, 1000, 50, 100, 250, 1000, 1024, 30, 35, 2320, 587];

/// Number of markers of a dictionary; `None` for a name that OpenCV does not know.
pub(super) fn marker_count(name: &str) -> Option<u32> {
    DICTIONARIES.iter().zip(MARKERS).find(|(known, _)| **known == name).map(|(_, count)| count)
}

/// The known names, for a message.
pub(super) fn names() -> String {
    DICTIONARIES.join(", ")
}
