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
