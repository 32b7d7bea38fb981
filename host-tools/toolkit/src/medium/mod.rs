//! What lies between the processors of a robot, simulated: lines, memory that two share, a CAN bus.
//!
//! Time is plant time, an integer in picoseconds, in which a bit of any usual rate has a length. A
//! processor names times by its own [`clock`], in whole microseconds, which may run fast or slow.
//! What a medium does to what it carries follows from its settings and a seed alone: two runs are
//! equal to the byte.
//!
//! A medium knows nothing of what is in the bytes; on CAN, a frame has an identifier.

pub mod can;
pub mod chance;
pub mod clock;
pub mod line;
pub mod memory;
mod plant_time;

pub use plant_time::{Cut, PS_IN_S, PS_IN_US};
