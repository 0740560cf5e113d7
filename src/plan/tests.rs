//! Plans of small trajectories and of the shipped files.
