//! What keeps board, plant and link client in step, whichever board it is.
//!
//! | module | what it holds |
//! |---|---|
//! | [`pace`] | how fast robot time may run against the wall clock |

pub mod pace;
