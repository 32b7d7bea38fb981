//! What a robot that measures itself has found: numbers with their limits, and what to do about
//! those that are outside.
//!
//! [`wheels`] finds out how motors and encoders are wired, [`body`] judges what else is on the
//! robot, [`board`] what the board itself does. Whoever measures (`esm selftest`) hands over what
//! it has measured; nothing here asks a robot.

pub mod board;
pub mod body;
mod finding;
pub mod wheels;

pub use finding::Finding;
