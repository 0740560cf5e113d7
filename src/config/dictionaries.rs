//! The ArUco dictionaries that OpenCV predefines.

const SIZES: [&str; 4] = ["4X4", "5X5", "6X6", "7X7"];
const COUNTS: [u32; 4] = [50, 100, 250, 1000];
const OTHERS: [&str; 5] =
    ["DICT_ARUCO_ORIGINAL", "DICT_APRILTAG_16h5", "DICT_APRILTAG_25h9", "DICT_APRILTAG_36h10", "DICT_APRILTAG_36h11"];

/// Every name, such as `DICT_4X4_50`, with the number of its markers.
fn all() -> impl Iterator<Item = (String, u32)> {
    let squares = SIZES.into_iter().flat_map(|size| COUNTS.map(|count| (format!("DICT_{size}_{count}"), count)));
    squares.chain(OTHERS.into_iter().map(str::to_owned).zip([1024, 30, 35, 2320, 587]))
}

/// Number of markers of a dictionary; `None` for a name that OpenCV does not know.
pub(super) fn marker_count(name: &str) -> Option<u32> {
    all().find(|(known, _)| known == name).map(|(_, count)| count)
}

/// The known names, for a message.
pub(super) fn names() -> String {
    let others = OTHERS.join(", ");
    format!("DICT_{{4X4,5X5,6X6,7X7}}_{{50,100,250,1000}}, {others}")
}
