//! Values that several commands take on the command line.

pub use crate::scenario::time::{Time, TimeError};
pub use crate::serial::port::{Port, PortError};
