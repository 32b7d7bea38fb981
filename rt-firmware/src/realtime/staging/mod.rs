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

#[cfg(feature = "warm")]
pub(crate) use ahead::{MappingTable, MissionMemories, OwnMemory, SpareMemory, StagedMission};
#[cfg(not(feature = "warm"))]
pub(crate) use in_slot::{MappingTable, MissionMemories, OwnMemory, SpareMemory, StagedMission};

use esm_core::{BlobBuffer, Interpreter, Verified};

use super::slots::SlotEntry;
use super::tasks::{self, TaskEntry};
use crate::ports::Registry;

/// The memory of one mission, beside its blob's.
pub(crate) struct MissionMemory<'m> {
    pub(crate) arena: &'m mut [u32],
    pub(crate) lists: Lists<'m>,
}

/// What is kept for the tasks and slots of a mission.
#[derive(Default)]
pub(crate) struct Lists<'m> {
    pub(crate) tasks: &'m mut [TaskEntry],
    pub(crate) slots: &'m mut [SlotEntry],
    pub(crate) first_in_slot_0: Option<u16>,
}

/// A mission before its first macro step, which has all that it needs.
pub(crate) struct Prepared<'m> {
    pub(crate) interpreter: Interpreter<'m, BlobBuffer<'m>>,
    pub(crate) lists: Lists<'m>,
}

/// A mission that has ended and may start again.
pub(crate) struct StoppedMission<'m> {
    pub(crate) mission: Verified<BlobBuffer<'m>>,
    pub(crate) spare: SpareMemory<'m>,
}

impl<'m> Prepared<'m> {
    /// Of a mission that was [checked](crate::check). None if the room is too small for its
    /// interpreter, which that has found out.
    // Not inlined, as nothing here: no other mission should be made on top of this one.
    #[inline(never)]
    pub(crate) fn new(
        mission: Verified<BlobBuffer<'m>>,
        memory: MissionMemory<'m>,
        registry: Registry<'_>,
    ) -> Option<Self> {
        // Changed where it is returned: moved about, it would be on the stack more than once.
        let mut prepared = Self::in_memory(mission, memory);
        if let Some(Prepared { interpreter, lists }) = &mut prepared {
            tasks::prepare(&interpreter.tables(), registry, lists);
        }
        prepared
    }

    /// Of one that ran in this room before.
    #[inline(never)]
    pub(crate) fn again(
        mission: Verified<BlobBuffer<'m>>,
        memory: MissionMemory<'m>,
    ) -> Option<Self> {
        let mut prepared = Self::in_memory(mission, memory);
        if let Some(Prepared { lists, .. }) = &mut prepared {
            tasks::prepare_again(lists);
        }
        prepared
    }

    #[cfg_attr(feature = "warm", inline(never))]
    fn in_memory(
        mission: Verified<BlobBuffer<'m>>,
        MissionMemory { arena, lists }: MissionMemory<'m>,
    ) -> Option<Self> {
        let made = Interpreter::new(mission, arena);
        debug_assert!(made.is_ok(), "the room was found to be large enough");
        made.map(|interpreter| Prepared { interpreter, lists }).ok()
    }
}
