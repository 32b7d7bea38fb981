//! What keeps board, plant and link client in step, whichever board it is.
//!
//! | module | what it holds |
//! |---|---|
//! | [`in_system`] | what a board asks that is one of several |
//! | [`mod@line`] | the link's bytes, swapped at the board's own times, and a client that waits by them |
//! | [`pace`] | how fast robot time may run against the wall clock |
//! | [`plant_side`] | the plant, shared by the board that drives it and whoever watches |

pub mod in_system;
pub mod line;
pub mod pace;
pub mod plant_side;
