//! The memory of one mission, and a mission that has been made in it.

use esm_core::{BlobBuffer, Interpreter, Verified};

use crate::ports::Registry;
use crate::realtime::tasks::{self, Lists};

/// The memory of one mission, beside its blob's.
pub(crate) struct MissionMemory<'m> {
    pub(crate) arena: &'m mut [u32],
    pub(crate) lists: Lists<'m>,
}

/// A mission before its first macro step, which has all that it needs.
pub(crate) struct Prepared<'m> {
    pub(crate) interpreter: Interpreter<'m, BlobBuffer<'m>>,
    pub(crate) lists: Lists<'m>,
}

impl<'m> Prepared<'m> {
    /// Of a mission that was [checked](crate::check). None if the room is too small for its
    /// interpreter, which that has found out.
    // Not inlined, as nothing here: no other mission should be made on top of this one.
    #[inline(never)]
    pub(crate) fn new(
        mission: Verified<BlobBuffer<'m>>,
        mut memory: MissionMemory<'m>,
        registry: Registry<'_>,
    ) -> Option<Self> {
        // The lists first: afterwards the mission would have to be on the stack more than once.
        tasks::prepare(&mission.tables(), registry, &mut memory.lists);
        Self::in_memory(mission, memory)
    }

    /// Of one that ran in this room before.
    #[inline(never)]
    pub(crate) fn again(
        mission: Verified<BlobBuffer<'m>>,
        mut memory: MissionMemory<'m>,
    ) -> Option<Self> {
        tasks::prepare_again(&mut memory.lists);
        Self::in_memory(mission, memory)
    }

    #[inline(never)]
    fn in_memory(
        mission: Verified<BlobBuffer<'m>>,
        MissionMemory { arena, lists }: MissionMemory<'m>,
    ) -> Option<Self> {
        let made = Interpreter::in_arena(mission, arena);
        debug_assert!(made.is_some(), "the room was found to be large enough");
        made.map(|interpreter| Prepared { interpreter, lists })
    }
}
