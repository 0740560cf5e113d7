//! Files as people get them wrong, and what they are told.
