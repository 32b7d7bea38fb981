//! There is memory for two missions, and the link prepares the next while the one before still
//! drives.

use core::marker::PhantomData;

use esm_core::{BlobBuffer, BlobReader, StateMapping, Verified};

use super::memory::{MissionMemory, Prepared};
use crate::features::MISSIONS;
use crate::ports::Registry;
use crate::task::Direction;
use esm_link::message::{Capacity, LinkError};

/// The memory of a mission that has ended: it stays with the blob.
pub(crate) type SpareMemory<'m> = MissionMemory<'m>;

/// The table of what two missions have in common, on its way back.
pub(crate) struct MappingTable<'m>(Option<&'m mut [u16]>);

/// What the link prepares missions in.
pub(crate) struct MissionMemories<'m> {
    memories: [Option<MissionMemory<'m>>; MISSIONS],
    pairs: Option<&'m mut [u16]>,
    /// Of each mission that the real-time side has, somebody who reads its blob, too.
    readers: [Option<Verified<BlobReader<'m>>>; MISSIONS],
}

/// The real-time side has none of its own.
pub(crate) struct OwnMemory<'m>(PhantomData<&'m mut ()>);

/// What a mission has in common with the one of this hash.
pub(super) struct Common<'m> {
    pub(super) mapping: StateMapping<'m>,
    pub(super) before: u32,
}

/// A mission that is to take over.
pub(crate) struct StagedMission<'m> {
    pub(super) prepared: Prepared<'m>,
    /// Of a warm swap, if there is a mission before.
    pub(super) common: Option<Common<'m>>,
}

impl<'m> MappingTable<'m> {
    pub(super) fn of(common: Option<Common<'m>>) -> Self {
        MappingTable(common.map(|common| common.mapping.into_table()))
    }
}

impl<'m> MissionMemories<'m> {
    /// Of the memory for missions.
    pub(crate) fn new(
        memories: [MissionMemory<'m>; MISSIONS],
        pairs: &'m mut [u16],
    ) -> (Self, OwnMemory<'m>) {
        let memories = MissionMemories {
            memories: memories.map(Some),
            pairs: Some(pairs),
            readers: [const { None }; MISSIONS],
        };
        (memories, OwnMemory(PhantomData))
    }

    /// Makes of a mission that was [checked](crate::check) what it needs, and finds out what it has
    /// in common with the one that runs if it is to take over warm.
    // Not inlined: what it needs of the stack is not needed afterwards.
    #[inline(never)]
    pub(crate) fn prepare(
        &mut self,
        mut mission: Verified<BlobBuffer<'m>>,
        warm: bool,
        registry: Registry<'_>,
    ) -> Result<StagedMission<'m>, (LinkError, Option<BlobBuffer<'m>>)> {
        let common = match warm.then(|| self.compare(&mission, registry)).transpose() {
            Ok(common) => common.flatten(),
            Err(error) => return Err((error, Some(mission.into_bytes()))),
        };
        let reader = mission.lend();
        if let Some(place) = self.readers.iter_mut().find(|place| place.is_none()) {
            *place = reader;
        }
        // There are as many rooms as buffers.
        let memory = self.memories.iter_mut().find_map(Option::take);
        debug_assert!(memory.is_some());
        let Some(memory) = memory else {
            return Err((LinkError::Busy, None));
        };
        // Moved once only: it would be on the stack as often as it is moved.
        match Prepared::new(mission, memory, registry) {
            Some(prepared) => Ok(StagedMission { prepared, common }),
            None => Err((LinkError::Busy, None)),
        }
    }

    /// What a mission has in common with the one that runs. None if none does.
    fn compare(
        &mut self,
        mission: &Verified<BlobBuffer<'m>>,
        registry: Registry<'_>,
    ) -> Result<Option<Common<'m>>, LinkError> {
        // During a trial, when there are two, nothing is uploaded.
        let Some(running) = self.readers.iter().flatten().next() else {
            return Ok(None);
        };
        let Some(table) = self.pairs.take() else {
            return Err(LinkError::Busy);
        };
        let mut mapping = StateMapping::new(table);
        let outputs_of = |signature_hash| {
            let bank = registry.find(signature_hash);
            let declared = bank.and_then(|bank| registry.declaration(bank.into()));
            let ports = declared.map_or(&[][..], |declared| declared.ports);
            let is_written = ports.iter().map(|port| port.direction != Direction::In);
            is_written
                .rev()
                .fold(0, |outputs, is| outputs << 1 | u8::from(is))
        };
        match mapping.find(&mission.tables(), &running.tables(), outputs_of) {
            Ok(()) => Ok(Some(Common {
                mapping,
                before: running.hash(),
            })),
            Err(refused) => {
                self.pairs = Some(mapping.into_table());
                Err(LinkError::CapacityExceeded {
                    what: Capacity::Pairs,
                    needed: refused.needed as u32,
                    available: refused.available as u32,
                })
            }
        }
    }

    /// Takes a mission apart that does not take over.
    #[inline(never)]
    pub(crate) fn take_apart(&mut self, staged: StagedMission<'m>) -> BlobBuffer<'m> {
        self.keep_table(MappingTable::of(staged.common));
        let Prepared { interpreter, lists } = staged.prepared;
        let (mission, arena) = interpreter.into_parts();
        let mut blob = mission.into_bytes();
        self.keep(&mut blob, MissionMemory { arena, lists });
        blob
    }

    /// Keeps the memory of a mission that has ended, and takes back who reads its blob.
    pub(crate) fn keep(&mut self, blob: &mut BlobBuffer<'m>, spare: SpareMemory<'m>) {
        self.take_reader_back(blob);
        self.keep_memory(spare);
    }

    fn keep_memory(&mut self, memory: MissionMemory<'m>) {
        if let Some(place) = self.memories.iter_mut().find(|place| place.is_none()) {
            *place = Some(memory);
        }
    }

    fn take_reader_back(&mut self, blob: &mut BlobBuffer<'m>) {
        let first = blob.as_ptr();
        let mut readers = self.readers.iter_mut();
        let reader =
            readers.find_map(|place| place.take_if(|reader| reader.bytes().as_ptr() == first));
        if let Some(reader) = reader {
            // It was found by the address of its bytes.
            let refused = blob.take_back(reader.into_bytes());
            debug_assert!(refused.is_ok());
        }
    }

    /// Keeps the table for the next swap, if it is there.
    pub(crate) fn keep_table(&mut self, table: MappingTable<'m>) {
        if let MappingTable(Some(table)) = table {
            self.pairs = Some(table);
        }
    }
}

impl<'m> OwnMemory<'m> {
    /// Keeps the room of a mission that has ended, where it is the real-time side's.
    pub(crate) fn keep(&mut self, memory: MissionMemory<'m>) -> SpareMemory<'m> {
        memory
    }

    /// The room for a mission that starts again.
    pub(crate) fn take(&mut self, spare: SpareMemory<'m>) -> Option<MissionMemory<'m>> {
        Some(spare)
    }
}

impl<'m> StagedMission<'m> {
    pub(crate) fn mission(&self) -> &Verified<BlobBuffer<'m>> {
        self.prepared.interpreter.verified()
    }
}
