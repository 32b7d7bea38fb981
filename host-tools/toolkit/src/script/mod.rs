//! Scripts: what a robot is to do, a behaviour a line, without a mission that says so.
//!
//! ```text
//! // Out of the room, and back.
//! go_to x_m = 2, y_m = 0.5 unless near range_m = 0.3 -> suspend
//! turn_to angle_rad = 3.1416
//! go_to x_m = 2 unless stuck after_s = 2 -> insert turn_to unless near range_m = 0.1 -> end
//! ```
//!
//! A line is the name of a behaviour, as the firmware declares it or in small letters, its
//! parameters, and situations that are watched beside it. What is left out of the parameters has
//! its default. [`read`] checks a text against what a firmware declares.

mod read;
mod steps;
mod words;

pub use read::{read, read_line};
pub use steps::{Reading, Script, Step, is_behaviour, script_name, signature_hash};

#[cfg(test)]
mod tests;
