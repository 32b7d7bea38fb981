//! There is memory for two missions, and the link prepares the next while the one before still
//! drives.

use core::marker::PhantomData;

use esm_core::{BlobBuffer, BlobReader, Pairing, Verified};

use super::{Prepared, Resting, Room};
use crate::features::MISSIONS;
use crate::ports::Registry;
use crate::realtime::RealTime;
use crate::realtime::mission::Origin;
use crate::task::Direction;
use esm_link::message::{Capacity, LinkError};

/// The memory of a mission that has ended: it stays with the blob.
pub(crate) type Spare<'m> = Room<'m>;

/// The table of what two missions have in common, on its way back.
pub(crate) struct PairTable<'m>(Option<&'m mut [u16]>);

/// What the link prepares missions in.
pub(crate) struct Rooms<'m> {
    rooms: [Option<Room<'m>>; MISSIONS],
    pairs: Option<&'m mut [u16]>,
    /// Of each mission that the real-time side has, somebody who reads its blob, too.
    readers: [Option<Verified<BlobReader<'m>>>; MISSIONS],
}

/// The real-time side has none of its own.
pub(crate) struct OwnRoom<'m>(PhantomData<&'m mut ()>);

/// What a mission has in common with the one of this hash.
struct Common<'m> {
    pairing: Pairing<'m>,
    before: u32,
}

/// A mission that is to take over.
pub(crate) struct Upcoming<'m> {
    prepared: Prepared<'m>,
    /// Of a warm swap, if there is a mission before.
    common: Option<Common<'m>>,
}

impl<'m> PairTable<'m> {
    fn of(common: Option<Common<'m>>) -> Self {
        PairTable(common.map(|common| common.pairing.into_table()))
    }
}

impl<'m> Rooms<'m> {
    /// Of the memory for missions.
    pub(crate) fn new(rooms: [Room<'m>; MISSIONS], pairs: &'m mut [u16]) -> (Self, OwnRoom<'m>) {
        let rooms = Rooms {
            rooms: rooms.map(Some),
            pairs: Some(pairs),
            readers: [const { None }; MISSIONS],
        };
        (rooms, OwnRoom(PhantomData))
    }

    /// Makes of a mission that was [checked](crate::check) what it needs, and finds out what it has
    /// in common with the one that runs if it is to take over warm.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn prepare(
        &mut self,
        mut mission: Verified<BlobBuffer<'m>>,
        warm: bool,
        registry: Registry<'_>,
    ) -> Result<Upcoming<'m>, (LinkError, Option<BlobBuffer<'m>>)> {
        let common = match warm.then(|| self.compare(&mission, registry)).transpose() {
            Ok(common) => common.flatten(),
            Err(error) => return Err((error, Some(mission.into_bytes()))),
        };
        let reader = mission.lend();
        if let Some(place) = self.readers.iter_mut().find(|place| place.is_none()) {
            *place = reader;
        }
        // There are as many rooms as buffers.
        let room = self.rooms.iter_mut().find_map(Option::take);
        let prepared = room.and_then(|room| Prepared::new(mission, room, registry));
        debug_assert!(prepared.is_some());
        prepared
            .map(|prepared| Upcoming { prepared, common })
            .ok_or((LinkError::Busy, None))
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
        let mut pairing = Pairing::new(table);
        let outputs_of = |signature_hash| {
            let bank = registry.find(signature_hash);
            let declared = bank.and_then(|bank| registry.declaration(bank.into()));
            let ports = declared.map_or(&[][..], |declared| declared.ports);
            let is_written = ports.iter().map(|port| port.direction != Direction::In);
            is_written
                .rev()
                .fold(0, |outputs, is| outputs << 1 | u8::from(is))
        };
        match pairing.find(&mission.tables(), &running.tables(), outputs_of) {
            Ok(()) => Ok(Some(Common {
                pairing,
                before: running.hash(),
            })),
            Err(refused) => {
                self.pairs = Some(pairing.into_table());
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
    pub(crate) fn take_apart(&mut self, upcoming: Upcoming<'m>) -> BlobBuffer<'m> {
        self.keep_table(PairTable::of(upcoming.common));
        let Prepared { interpreter, lists } = upcoming.prepared;
        let (mission, arena) = interpreter.into_parts();
        let mut blob = mission.into_bytes();
        self.keep(&mut blob, Room { arena, lists });
        blob
    }

    /// Keeps the memory of a mission that has ended, and takes back who reads its blob.
    pub(crate) fn keep(&mut self, blob: &mut BlobBuffer<'m>, spare: Spare<'m>) {
        self.take_reader_back(blob);
        self.keep_room(spare);
    }

    fn keep_room(&mut self, room: Room<'m>) {
        if let Some(place) = self.rooms.iter_mut().find(|place| place.is_none()) {
            *place = Some(room);
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
    pub(crate) fn keep_table(&mut self, table: PairTable<'m>) {
        if let PairTable(Some(table)) = table {
            self.pairs = Some(table);
        }
    }
}

impl<'m> OwnRoom<'m> {
    /// Keeps the room of a mission that has ended, where it is the real-time side's.
    pub(crate) fn keep(&mut self, room: Room<'m>) -> Spare<'m> {
        room
    }

    /// The room for a mission that starts again.
    pub(crate) fn take(&mut self, spare: Spare<'m>) -> Option<Room<'m>> {
        Some(spare)
    }
}

impl<'m> Upcoming<'m> {
    pub(crate) fn mission(&self) -> &Verified<BlobBuffer<'m>> {
        self.prepared.interpreter.verified()
    }
}

impl<'m> RealTime<'_, 'm> {
    /// Starts a mission in place of the one that runs. Answers how many regions go on as they were,
    /// the mission before, if there was one, and what goes back.
    pub(in crate::realtime) fn start_upcoming(
        &mut self,
        Upcoming { prepared, common }: Upcoming<'m>,
        warm: bool,
        at: Origin,
    ) -> (u16, Option<Resting<'m>>, PairTable<'m>) {
        let running = self.running();
        // A mission that is not the one that this was found for hands over nothing.
        let before = common
            .as_ref()
            .filter(|common| warm && self.health.mission == Some(common.before))
            .map(|common| &common.pairing);
        let (carried, before) = self.start_mission(prepared, running, at, before);
        (carried, before, PairTable::of(common))
    }
}
