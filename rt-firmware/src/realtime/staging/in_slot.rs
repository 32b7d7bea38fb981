//! There is memory for one mission, and it is prepared in the interpreter's slot.

use core::marker::PhantomData;

use esm_core::{BlobBuffer, Verified};

use super::memory::MissionMemory;
use crate::ports::Registry;
use esm_link::message::LinkError;

/// The memory of a mission that has ended: it is where there is memory for the next.
pub(crate) struct SpareMemory<'m>(pub(super) PhantomData<&'m mut ()>);

/// The table of what two missions have in common: there is none.
pub(crate) struct MappingTable<'m>(pub(super) PhantomData<&'m mut ()>);

/// What the link prepares missions in: nothing.
pub(crate) struct MissionMemories<'m>(PhantomData<&'m mut ()>);

/// The room of the mission that runs, while none does.
pub(crate) struct OwnMemory<'m>(Option<MissionMemory<'m>>);

/// A mission that is to take over.
pub(crate) struct StagedMission<'m>(pub(super) Verified<BlobBuffer<'m>>);

impl<'m> MissionMemories<'m> {
    /// Of the memory for missions: it is the real-time side's.
    pub(crate) fn new(memories: [MissionMemory<'m>; 1], _: &'m mut [u16]) -> (Self, OwnMemory<'m>) {
        let [memory] = memories;
        (MissionMemories(PhantomData), OwnMemory(Some(memory)))
    }

    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn prepare(
        &mut self,
        mission: Verified<BlobBuffer<'m>>,
        _warm: bool,
        _: Registry<'_>,
    ) -> Result<StagedMission<'m>, (LinkError, Option<BlobBuffer<'m>>)> {
        Ok(StagedMission(mission))
    }

    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn take_apart(&mut self, staged: StagedMission<'m>) -> BlobBuffer<'m> {
        staged.0.into_bytes()
    }

    pub(crate) fn keep(&mut self, _: &mut BlobBuffer<'m>, _: SpareMemory<'m>) {}

    pub(crate) fn keep_table(&mut self, _: MappingTable<'m>) {}
}

impl<'m> OwnMemory<'m> {
    /// Keeps the room of a mission that has ended.
    pub(crate) fn keep(&mut self, memory: MissionMemory<'m>) -> SpareMemory<'m> {
        self.0 = Some(memory);
        SpareMemory(PhantomData)
    }

    /// The room for a mission that starts again.
    pub(crate) fn take(&mut self, _: SpareMemory<'m>) -> Option<MissionMemory<'m>> {
        self.0.take()
    }
}

impl<'m> StagedMission<'m> {
    pub(crate) fn mission(&self) -> &Verified<BlobBuffer<'m>> {
        &self.0
    }
}
