//! The main job on the simulated cell, end to end.
