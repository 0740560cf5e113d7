//! What runs for longer than a command and answers over HTTP.
//!
//! Uses everything above `cli`. Start at [`target_page`]: the display as a web page.

pub mod target_page;
