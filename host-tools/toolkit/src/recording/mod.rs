//! Recordings: what entered an interpreter, kept in a file, and had again.
//!
//! A robot streams what enters its interpreter ([`esm_link::recording`]), which a client follows
//! over a line; a [`writer`] keeps it with the missions that it is of, in a [`file`](mod@file) that
//! can be read as far as it was written, whatever ended the writing. Read again, it becomes
//! [`Stretch`]es: runs of one mission, each from a known beginning, with what changed before which
//! macro step. A [`player`] runs those through `esm-core`'s interpreter, so that their trace is
//! that of the robot, line by line. A [`walk`] goes through them micro step by micro step.

pub mod choices;
pub mod entered;
pub mod file;
pub mod limits;
pub mod mcap_file;
pub mod missing;
pub mod player;
pub mod plot;
pub mod samples;
pub mod told;
pub mod walk;
pub mod writer;

mod choosing;
mod condense;
#[cfg(any(test, feature = "samples"))]
#[allow(
    clippy::unwrap_used,
    clippy::new_without_default,
    reason = "it is for tests alone"
)]
pub mod planted;
mod rest;
mod retold;
mod stretch;
mod surroundings;

pub use condense::MAX_KEPT_QUIET;
pub use stretch::{Beginning, Change, Input, Stretch};
pub use surroundings::{EventThen, FlagThen, RegionThen, Surroundings, TimerThen};
