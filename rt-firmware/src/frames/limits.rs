//! How much of links a firmware serves.

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
