//! The start of a mission that takes over.

#[cfg(not(feature = "warm"))]
use core::marker::PhantomData;

use super::MappingTable;
#[cfg(not(feature = "warm"))]
use super::SpareMemory;
#[cfg(feature = "warm")]
use super::StagedMission;
#[cfg(not(feature = "warm"))]
use super::StoppedMission;
use crate::realtime::RealTime;
use crate::realtime::machine::NewTrial;
use crate::realtime::mailbox::Content;
use crate::realtime::timetable::Origin;

#[cfg(feature = "warm")]
impl<'m> RealTime<'_, 'm> {
    /// Starts the mission of a swap in place of the one that runs, which stays for a trial. Answers
    /// how many regions go on as they were, and what goes back.
    pub(in crate::realtime) fn start_staged(
        &mut self,
        content: &mut Content<'m>,
        warm: bool,
        trial: Option<NewTrial>,
        at: Origin,
    ) -> (u16, MappingTable<'m>) {
        let Some(StagedMission { prepared, common }) = content.take_mission() else {
            return (0, MappingTable::of(None));
        };
        let running = self.running();
        // A mission that is not the one that this was found for hands over nothing.
        let shared = common
            .as_ref()
            .filter(|common| warm && self.machine.hash() == Some(common.before))
            .map(|common| &common.mapping);
        let (carried, before) = self.start_mission(prepared, running, at, shared);
        self.leave(before, trial);
        (carried, MappingTable::of(common))
    }
}

#[cfg(not(feature = "warm"))]
impl<'m> RealTime<'_, 'm> {
    /// Starts the mission of a swap in place of the one that runs, which ends first, and stays for
    /// a trial. Answers how many regions go on as they were, and what goes back.
    pub(in crate::realtime) fn start_staged(
        &mut self,
        content: &mut Content<'m>,
        _warm: bool,
        trial: Option<NewTrial>,
        at: Origin,
    ) -> (u16, MappingTable<'m>) {
        let running = self.running();
        self.end_before(trial);
        if let Some(new) = content.take_mission() {
            let new = StoppedMission {
                mission: new.0,
                spare: SpareMemory(PhantomData),
            };
            self.start_again(new, running, at);
        }
        (0, MappingTable(PhantomData))
    }

    /// Ends the mission that runs.
    // Not inlined: the new mission should not be made on top of it.
    #[inline(never)]
    fn end_before(&mut self, trial: Option<NewTrial>) {
        let before = self.end_mission();
        self.leave(before, trial);
    }
}
