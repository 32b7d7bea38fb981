//! What the host board has room for.

use esm_link::message::Capacities;
use rt_firmware::{About, Memory, RetainedRam};

use crate::boards;

/// The board's name, as `--board` takes it and as it calls itself.
pub const BOARD: &str = boards::HOST.name;

/// What a mission may use here.
pub const CAPACITIES: Capacities = boards::HOST.capacities;

/// The same, as sizes of memory.
const BLOB_BYTES: usize = CAPACITIES.blob_bytes as usize;
const ARENA_WORDS: usize = CAPACITIES.arena_words as usize;
const SLOTS: usize = CAPACITIES.slots as usize;
const TASKS: usize = CAPACITIES.task_instances as usize;
const NETS: usize = CAPACITIES.nets as usize;
const GROUPS: usize = CAPACITIES.exclusive_groups as usize;

/// Room for the trace of many macro steps, should the reader be slow.
const TRACE_BYTES: usize = 256 * 1024;

/// All memory of a host board but that of its tasks.
pub type HostMemory<'m> =
    Memory<'m, BLOB_BYTES, ARENA_WORDS, SLOTS, TASKS, NETS, GROUPS, TRACE_BYTES>;

/// What a host board that starts says of itself.
pub fn about(kept: &RetainedRam) -> About<'_> {
    About {
        reset: kept.begin(None),
        kept: Some(kept),
        ..About::new(concat!("esm ", env!("CARGO_PKG_VERSION")), BOARD)
    }
}
