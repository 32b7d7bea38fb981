//! What a robot is, and what it has room for.

use serde::{Deserialize, Serialize};

use super::crash_report::ResetReason;
use crate::credentials::Access;

#[cfg(doc)]
use super::{MAX_CHUNK, PROTOCOL_VERSION, Request};

/// What a robot is, and what it has room for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DeviceInfo<'a> {
    /// [`PROTOCOL_VERSION`]
    pub protocol: u16,
    /// Name and version of the firmware.
    pub firmware: &'a str,
    /// Name of the board.
    pub board: &'a str,
    /// Number of task types.
    pub task_types: u8,
    /// What a mission may use.
    pub capacities: Capacities,
    /// Hash of the mission that runs.
    pub mission: Option<u32>,
    /// Why the robot started the last time.
    pub reset: ResetReason,
    /// How it takes uploads.
    pub uploads: Uploads,
    /// Whether it has a key.
    pub access: Access,
}

/// How a robot takes uploads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Uploads {
    /// Bytes of a [`Request::Chunk`] at most: [`MAX_CHUNK`] or less.
    pub chunk_bytes: u16,
    /// Bytes of the blob that may be on their way, sent and not answered yet, whatever the size of
    /// the chunks that they are in.
    pub window_bytes: u16,
}

/// What a mission may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Capacities {
    /// Bytes of a blob.
    pub blob_bytes: u32,
    /// 32-bit words for the interpreter: current states, timers, flags, event queue.
    pub arena_words: u32,
    /// Slots.
    pub slots: u16,
    /// Task instances.
    pub task_instances: u16,
    /// Nets.
    pub nets: u16,
    /// Groups of exclusive tasks.
    pub exclusive_groups: u16,
}

/// One of the [`Capacities`], or what follows from them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Capacity {
    /// Bytes of a blob.
    BlobBytes,
    /// Words for the interpreter.
    ArenaWords,
    /// Slots.
    Slots,
    /// Task instances.
    TaskInstances,
    /// Nets.
    Nets,
    /// Groups of exclusive tasks.
    ExclusiveGroups,
    /// Entries of the table of what a mission has in common with the one that it is to take over
    /// from warm: two for each of the [words](Capacities::arena_words).
    Pairs,
    /// Steps of a script.
    ScriptSteps,
    /// Links.
    Links,
    /// Frames of all links.
    Frames,
}
