//! Motors: what they are like, from a drive that was recorded, and gains that suit them.
//!
//! | module | what |
//! |---|---|
//! | `drive` | what a recording tells of the wheels |
//! | `motor` | a motor's model, and how it is found |
//! | `gains` | gains of `WheelSpeed` for a model |

mod drive;
mod gains;
mod motor;

pub use drive::{DriveError, LONGEST_PERIOD_US, WheelDrive, WheelSample, wheels_of};
pub use gains::Gains;
pub use motor::{FitError, Motor, fit};

/// Names of the wheels, in the order in which they are told.
pub const SIDES: [&str; 2] = ["left", "right"];
