//! There is memory for one mission, and it is prepared in the interpreter's slot.

use core::marker::PhantomData;

use esm_core::{BlobBuffer, Verified};

use super::{Resting, Room};
use crate::ports::Registry;
use crate::realtime::RealTime;
use crate::realtime::mission::Origin;
use esm_link::message::LinkError;

/// The memory of a mission that has ended: it is where there is memory for the next.
pub(crate) struct Spare<'m>(PhantomData<&'m mut ()>);

/// The table of what two missions have in common: there is none.
pub(crate) struct PairTable<'m>(PhantomData<&'m mut ()>);

/// What the link prepares missions in: nothing.
pub(crate) struct Rooms<'m>(PhantomData<&'m mut ()>);

/// The room of the mission that runs, while none does.
pub(crate) struct OwnRoom<'m>(Option<Room<'m>>);

/// A mission that is to take over.
pub(crate) struct Upcoming<'m>(Verified<BlobBuffer<'m>>);

impl<'m> Rooms<'m> {
    /// Of the memory for missions: it is the real-time side's.
    pub(crate) fn new(rooms: [Room<'m>; 1], _: &'m mut [u16]) -> (Self, OwnRoom<'m>) {
        let [room] = rooms;
        (Rooms(PhantomData), OwnRoom(Some(room)))
    }

    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn prepare(
        &mut self,
        mission: Verified<BlobBuffer<'m>>,
        _warm: bool,
        _: Registry<'_>,
    ) -> Result<Upcoming<'m>, (LinkError, Option<BlobBuffer<'m>>)> {
        Ok(Upcoming(mission))
    }

    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn take_apart(&mut self, upcoming: Upcoming<'m>) -> BlobBuffer<'m> {
        upcoming.0.into_bytes()
    }

    pub(crate) fn keep(&mut self, _: &mut BlobBuffer<'m>, _: Spare<'m>) {}

    pub(crate) fn keep_table(&mut self, _: PairTable<'m>) {}
}

impl<'m> OwnRoom<'m> {
    /// Keeps the room of a mission that has ended.
    pub(crate) fn keep(&mut self, room: Room<'m>) -> Spare<'m> {
        self.0 = Some(room);
        Spare(PhantomData)
    }

    /// The room for a mission that starts again.
    pub(crate) fn take(&mut self, _: Spare<'m>) -> Option<Room<'m>> {
        self.0.take()
    }
}

impl<'m> Upcoming<'m> {
    pub(crate) fn mission(&self) -> &Verified<BlobBuffer<'m>> {
        &self.0
    }
}

impl<'m> RealTime<'_, 'm> {
    /// Starts a mission in place of the one that runs, which ends first. Answers how many regions
    /// go on as they were, the mission before, if there was one, and what goes back.
    pub(in crate::realtime) fn start_upcoming(
        &mut self,
        new: Upcoming<'m>,
        _warm: bool,
        at: Origin,
    ) -> (u16, Option<Resting<'m>>, PairTable<'m>) {
        let running = self.running();
        let before = self.end_mission();
        let new = Resting {
            mission: new.0,
            spare: Spare(PhantomData),
        };
        self.start_again(new, running, at);
        (0, before, PairTable(PhantomData))
    }
}
