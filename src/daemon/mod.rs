//! What runs for longer than a command and answers over HTTP.
//!
//! Uses everything above `cli`. Start at [`live_view`]: the cameras as a web page.

pub mod live_view;
