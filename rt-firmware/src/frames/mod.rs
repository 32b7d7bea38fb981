//! Frames of links: what a mission sends to other processors and receives from them at planned
//! times, as Merz, Rudol and Wzorek have it (section 4).
//!
//! A link has two dispatchers, which missions enable like tasks. `transmit` takes values and flags
//! from their nets at the start of its activation, and hands a frame with its start time to the
//! link's [`LinkDevice`]; `receive` takes what had arrived by the start of its own, publishes the
//! newest value of each frame, and says by flags what came and what is late. [`check()`] is what is
//! asked of a mission's frames before; which bytes cross the wire, [`esm_link::frames`] says.
//!
//! A value is written from its net's buffer straight into the device's, and read from the device's
//! into one of [`VALUES`] buffers, which the net then refers to: there is no other copy.

#[cfg(feature = "can")]
pub mod can;
#[cfg(feature = "links")]
mod check;
mod clock;
mod device;
mod limits;
#[cfg(not(feature = "links"))]
mod off;
#[cfg(feature = "links")]
mod on;
#[cfg(feature = "links")]
mod table;
#[cfg(all(test, feature = "links"))]
mod tests;

pub use clock::RobotClock;
pub use device::{LinkDevice, Taken};
#[cfg(feature = "links")]
pub(crate) use limits::NO_DISPATCHER;
pub use limits::{BOARD_FRAMES, BOARD_LINKS, FRAMES, LINKS, VALUES};

#[cfg(feature = "links")]
pub use check::{check, fields_of};
#[cfg(feature = "links")]
pub(crate) use on::{Activation, Flags, FrameLists, FrameMemory};

#[cfg(not(feature = "links"))]
pub(crate) use off::{FrameLists, FrameMemory, check};
