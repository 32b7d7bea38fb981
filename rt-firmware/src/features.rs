//! What this firmware was built with. A request for what it was built without is refused with
//! [`NotBuiltIn`](esm_link::message::LinkError::NotBuiltIn), and nothing changes.
//!
//! They are constants and not conditions on the code, so that each firmware is compiled from all of
//! it: what a constant makes unreachable takes no flash, and what is as long as one says takes no
//! memory.
//!
//! A host learns them by [`Request::Features`](esm_link::message::Request::Features), and need not
//! ask for what is not there.

/// The robot can have a key (feature `keys`).
pub const KEYS: bool = cfg!(feature = "keys");

/// A mission can take over from another warm (feature `warm`). Without it, its slots and tasks
/// begin anew and a request for a warm swap is refused.
pub const WARM: bool = cfg!(feature = "warm");

/// Parameters of the mission that runs can be read, changed and saved (feature `params`).
pub const PARAMS: bool = cfg!(feature = "params");

/// The robot tells news by itself, where a host wants them (feature `news`).
pub const STATUS_EVENTS: bool = cfg!(feature = "news");

/// What enters the interpreter can be recorded over the link (feature `record`).
pub const RECORD: bool = cfg!(feature = "record");

/// Values on nets can be read while the mission runs (feature `telemetry`).
pub const TELEMETRY: bool = cfg!(feature = "telemetry");

/// The board tells what it has measured of itself, and its line can have another rate for a while
/// (feature `selftest`).
pub const SELFTEST: bool = cfg!(feature = "selftest");

/// The rover has behaviours, and what stands on their list can be changed over the link (feature
/// `behaviours`).
pub const BEHAVIOURS: bool = cfg!(feature = "behaviours");

/// What happens to behaviours is told, in the trace and in the black box (feature
/// `all-behaviours`). A small robot has no room for that.
pub const NOTES: bool = cfg!(feature = "all-behaviours");

/// From one activation to the next time is counted in 32 bits (feature `speed`). Without it, the
/// whole clock is looked at after each activation, which takes longer and less flash.
pub const SPEED: bool = cfg!(feature = "speed");

/// Missions whose tables, tasks and nets are there at the same time: where one takes over from
/// another warm, both are.
pub const MISSIONS: usize = if WARM { 2 } else { 1 };
