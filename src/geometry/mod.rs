//! Frames, typed transforms, points, rotations and capsules; the kinematic chain of an arm.
//!
//! Conventions, in this one place: frames are right-handed; cameras look along +z with x right and
//! y down; pixel (0, 0) is the centre of the top-left pixel; quaternions are stored x, y, z, w with
//! w >= 0; lengths are metres, angles radians, times seconds.
//!
//! `Transform<To, From>` is written in the order it is read: `base_from_event: Transform<Base, Event>`
//! takes coordinates in `event` to coordinates in `base`, and neighbours cancel:
//! `Transform<A, B> * Transform<B, C> = Transform<A, C>`. A chain that does not cancel does not compile:
//!
//! ```compile_fail,E0277
//! use cellcal::geometry::{Base, Event, Tcp, Transform};
//! fn wrong(base_from_event: Transform<Base, Event>, base_from_tcp: Transform<Base, Tcp>) {
//!     let _ = base_from_event * base_from_tcp;
//! }
//! ```
//!
//! Uses nothing of the crate. Start at [`Transform`].

mod capsule;
mod frames;
pub mod kinematics;
mod pinhole;
pub mod rotation;
mod transform;

pub use capsule::{Capsule, Nearest};
pub use frames::{Base, Camera, Event, Flange, Frame, Rgb, Sensor, Target, Tcp};
pub use pinhole::Pinhole;
pub use transform::{Point, Transform};
