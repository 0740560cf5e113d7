//! The simulated cell: arm, display and both cameras in one process, on one simulated clock.
//!
//! [`ur`] is a controller on real sockets, [`scene`] the physics of display and cameras, [`rig`] the
//! cameras as drivers, [`cell`] puts them together; [`hand`] is an operator instead of the
//! arm, [`still`] an arm that never moves. Truth is for the simulators and for tests; the
//! program under test never sees it.

pub mod cell;
pub mod hand;
pub mod rig;
pub mod scene;
pub mod still;
pub mod ur;
