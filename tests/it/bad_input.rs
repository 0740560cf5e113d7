//! What a user can get wrong, and what they are told.
