//! The start of a mission that takes over.

#[cfg(not(feature = "warm"))]
use core::marker::PhantomData;

#[cfg(not(feature = "warm"))]
use super::SpareMemory;
use super::{MappingTable, StagedMission, StoppedMission};
use crate::realtime::RealTime;
use crate::realtime::timetable::Origin;

#[cfg(feature = "warm")]
impl<'m> RealTime<'_, 'm> {
    /// Starts a mission in place of the one that runs. Answers how many regions go on as they were,
    /// the mission before, if there was one, and what goes back.
    pub(in crate::realtime) fn start_staged(
        &mut self,
        StagedMission { prepared, common }: StagedMission<'m>,
        warm: bool,
        at: Origin,
    ) -> (u16, Option<StoppedMission<'m>>, MappingTable<'m>) {
        let running = self.running();
        // A mission that is not the one that this was found for hands over nothing.
        let before = common
            .as_ref()
            .filter(|common| warm && self.machine.hash() == Some(common.before))
            .map(|common| &common.mapping);
        let (carried, before) = self.start_mission(prepared, running, at, before);
        (carried, before, MappingTable::of(common))
    }
}

#[cfg(not(feature = "warm"))]
impl<'m> RealTime<'_, 'm> {
    /// Starts a mission in place of the one that runs, which ends first. Answers how many regions
    /// go on as they were, the mission before, if there was one, and what goes back.
    pub(in crate::realtime) fn start_staged(
        &mut self,
        new: StagedMission<'m>,
        _warm: bool,
        at: Origin,
    ) -> (u16, Option<StoppedMission<'m>>, MappingTable<'m>) {
        let running = self.running();
        let before = self.end_mission();
        let new = StoppedMission {
            mission: new.0,
            spare: SpareMemory(PhantomData),
        };
        self.start_again(new, running, at);
        (0, before, MappingTable(PhantomData))
    }
}
