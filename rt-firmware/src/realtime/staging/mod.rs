//! A mission that is to take over, with all that can be made of it before.
//!
//! Where one mission can take over from another warm there is memory for both, and it travels with
//! a mission's blob: the link makes what a mission needs while the one before still drives, and
//! what is left for the interpreter's slot is to exchange the two. A firmware without the feature
//! `warm` has memory for one, and makes what a mission needs in the slot, when the one before has
//! ended.

#[cfg(feature = "warm")]
mod ahead;
#[cfg(not(feature = "warm"))]
mod in_slot;
mod memory;
mod start;

#[cfg(feature = "warm")]
pub(crate) use ahead::{MappingTable, MissionMemories, OwnMemory, SpareMemory, StagedMission};
#[cfg(not(feature = "warm"))]
pub(crate) use in_slot::{MappingTable, MissionMemories, OwnMemory, SpareMemory, StagedMission};

pub(crate) use memory::{MissionMemory, Prepared};

use esm_core::{BlobBuffer, Verified};

/// A mission that has ended and may start again.
pub(crate) struct StoppedMission<'m> {
    pub(crate) mission: Verified<BlobBuffer<'m>>,
    pub(crate) spare: SpareMemory<'m>,
}
