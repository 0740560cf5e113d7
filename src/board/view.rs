//! The corners that one camera saw at one pose.

use serde::{Deserialize, Serialize};

/// One inner corner in an image.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Corner {
    /// Id on the board.
    pub id: u32,
    /// Position in pixels: x right, y down, (0, 0) is the centre of the top-left pixel.
    pub px: [f64; 2],
    /// Covariance of the position (xx, xy, yy), px2; absent where the detector gives none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covariance_px2: Option<[f64; 3]>,
}

impl Corner {
    /// A corner of unknown accuracy.
    pub fn at(id: u32, px: [f64; 2]) -> Self {
        Self { id, px, covariance_px2: None }
    }
}

/// The corners that one camera saw at one pose, ids ascending, each id once.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct View {
    /// The corners.
    pub corners: Vec<Corner>,
}

impl View {
    /// A view of these corners, sorted by id; of a doubled id the first stays.
    pub fn new(mut corners: Vec<Corner>) -> Self {
        corners.sort_by_key(|c| c.id);
        corners.dedup_by_key(|c| c.id);
        Self { corners }
    }

    /// Where the camera saw corner `id`, in pixels.
    pub fn px(&self, id: u32) -> Option<[f64; 2]> {
        self.corners.binary_search_by_key(&id, |c| c.id).ok().map(|i| self.corners[i].px)
    }

    /// The corners whose ids `other` has too.
    pub fn common_with(&self, other: &Self) -> Self {
        Self { corners: self.corners.iter().filter(|c| other.px(c.id).is_some()).copied().collect() }
    }
}
