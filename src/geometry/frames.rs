//! The coordinate frames of a cell, and the camera where it is data.

use serde::{Deserialize, Serialize};

/// A coordinate frame.
pub trait Frame: 'static {
    /// The name used in variable names, result files and MCAP frame ids.
    const NAME: &'static str;
}

macro_rules! frames {
    ($($(#[$doc:meta])* $name:ident = $text:literal;)*) => {$(
        $(#[$doc])*
        #[derive(Debug)]
        pub enum $name {}
        impl Frame for $name { const NAME: &'static str = $text; }
    )*};
}

frames! {
    /// Robot base, as the controller reports it.
    Base = "base";
    /// Tool centre point that is active on the controller.
    Tcp = "tcp";
    /// Mounting flange of the arm.
    Flange = "flange";
    /// ChArUco board: origin at the outer top-left corner, x right, y down, z into the board.
    Target = "target";
    /// Event camera.
    Event = "event";
    /// Frame camera.
    Rgb = "rgb";
    /// The camera that is being treated, where the code is the same for both.
    Sensor = "camera";
}

/// Which of the two cameras, where that is data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Camera {
    /// The frame camera.
    Rgb,
    /// The event camera.
    Event,
}

impl Camera {
    /// Both cameras, in the order of every table.
    pub const BOTH: [Self; 2] = [Self::Rgb, Self::Event];

    /// The name of the camera and of its frame.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rgb => Rgb::NAME,
            Self::Event => Event::NAME,
        }
    }
}

impl std::fmt::Display for Camera {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}
