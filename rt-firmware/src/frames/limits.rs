//! How much of links a firmware serves.

/// The most links of a mission that a board's firmware with links serves: a microcontroller's
/// memory is small.
pub const BOARD_LINKS: usize = 1;

/// The most frames of a mission there.
pub const BOARD_FRAMES: usize = 24;

/// What a firmware has memory for.
struct Room {
    links: usize,
    frames: usize,
    values: usize,
}

const ROOM: Room = if cfg!(feature = "many-frames") {
    Room {
        links: 4,
        frames: 128,
        values: 32,
    }
} else if cfg!(feature = "links") {
    Room {
        links: BOARD_LINKS,
        frames: BOARD_FRAMES,
        values: 12,
    }
} else {
    Room {
        links: 0,
        frames: 0,
        values: 0,
    }
};

/// The most links of a mission that this firmware serves.
pub const LINKS: usize = ROOM.links;

/// The most frames of a mission, of all its links.
pub const FRAMES: usize = ROOM.frames;

/// Values that were received and are on nets, or read by a task in slot 0.
pub const VALUES: usize = ROOM.values;

/// The most occurrences of one frame that are handed over in one activation of `transmit`. A frame
/// that would need more has a period too short for the dispatcher's slot: what is beyond finds no
/// room, and `NAME_full` says so.
#[cfg(feature = "links")]
pub(crate) const MAX_OCCURRENCES: u32 = 32;

/// A task that is no dispatcher.
#[cfg(feature = "links")]
pub(crate) const NO_DISPATCHER: u8 = u8::MAX;
