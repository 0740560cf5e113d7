//! What runs for longer than a command and answers over HTTP.
//!
//! Uses everything above `cli`. Start at [`target_page`], the display, and [`live_view`], the cameras; `guard` says
//! who may ask them, `connections` holds whoever does.

mod connections;
mod guard;
pub mod live_view;
pub mod target_page;
