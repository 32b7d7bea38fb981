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

#[cfg(feature = "links")]
mod check;
mod device;
#[cfg(not(feature = "links"))]
mod off;
#[cfg(feature = "links")]
mod on;
#[cfg(feature = "links")]
mod table;
#[cfg(all(test, feature = "links"))]
mod tests;
#[cfg(feature = "links")]
mod values;

pub use device::{LinkDevice, Taken};

#[cfg(feature = "links")]
pub use check::check;
#[cfg(feature = "links")]
pub(crate) use on::{Activation, Flags, FrameLists, FrameMemory};
#[cfg(feature = "links")]
pub(crate) use values::{ReceivedValue, VALUE_BYTES};

#[cfg(not(feature = "links"))]
pub(crate) use off::{FrameLists, FrameMemory, check};

/// The most links of a mission that this firmware serves.
pub const LINKS: usize = if cfg!(feature = "links") { 4 } else { 0 };

/// The most frames of a mission, of all its links.
pub const FRAMES: usize = if cfg!(feature = "links") { 128 } else { 0 };

/// Values that were received and are on nets, or read by a task in slot 0.
pub const VALUES: usize = if cfg!(feature = "links") { 32 } else { 0 };

/// The most occurrences of one frame that are handed over in one activation of `transmit`. A frame
/// that would need more has a period too short for the dispatcher's slot: what is beyond finds no
/// room, and `NAME_full` says so.
#[cfg(feature = "links")]
pub(crate) const MAX_OCCURRENCES: u32 = 32;

/// A task that is no dispatcher.
#[cfg(feature = "links")]
pub(crate) const NO_DISPATCHER: u8 = u8::MAX;
