//! The mission that runs: from its start, with what it takes over from the one before, to its end,
//! when its tables and memory are left.
//!
//! *Invariant:* a mission that starts was checked, so that there is room for all that it has.

use esm_core::StateMapping;

use super::RealTime;
use super::machine::Mission;
use super::staging::{Prepared, StoppedMission};
use super::tasks::Lists;
use super::timetable::Origin;
use crate::features::WARM;

impl<'m> RealTime<'_, 'm> {
    /// Starts a mission whose first macro step is `at` this time. `running` is what was in its
    /// place until now: origin and interpreter's period, which the slots go on with if it is the
    /// new interpreter's, too. If there still is a mission, the new one takes over what they have
    /// in `common`. Answers how many regions go on as they were, and the mission before, if there
    /// was one.
    #[inline(never)]
    pub(super) fn start_mission(
        &mut self,
        prepared: Prepared<'m>,
        running: Option<(Origin, u32)>,
        at: Origin,
        common: Option<&StateMapping<'_>>,
    ) -> (u16, Option<StoppedMission<'m>>) {
        self.execution.forget_said();
        self.begin_health();
        let Prepared { interpreter, lists } = prepared;
        let mut mission = Mission::new(interpreter);
        let old = self.execution.begin_mission(lists);
        let (mut carried, mut tasks_us) = (0, 0);
        // Where there is memory for one mission, the one before has ended.
        let before = if WARM { self.machine.take() } else { None };
        if WARM {
            self.execution.begin_migration();
            if let (Some(before), Some(common)) = (&before, common) {
                carried = mission.take_over(before, common);
                tasks_us = self.timetable.t_us_at(at.us);
                self.execution.take_over(old.tasks, common, &mission);
            }
            self.execution.end_migration(old.tasks);
        }
        let tables = mission.tables();
        let longest_us = (self.timetable).begin_mission(&tables, running, at, tasks_us);
        #[cfg(feature = "links")]
        {
            let (origin, _) = self.timetable.running();
            let follows = common.is_some().then_some(&old.frames);
            self.execution.begin_links(follows, origin.us, at.us);
        }
        self.safety.begin_mission(at.us, longest_us);
        let robot_us = self.timetable.previous_end_us();
        let (hash, is_warm) = (mission.hash(), common.is_some());
        (self.observers).begin_mission(robot_us, hash, at.us, is_warm);
        let registry = self.execution.registry();
        self.machine.begin_mission(mission, registry);
        (carried, before.map(|before| self.machine.rest(before, old)))
    }

    /// Starts a mission that does not run, from its beginning.
    #[inline(never)]
    pub(super) fn start_again(
        &mut self,
        StoppedMission { mission, spare }: StoppedMission<'m>,
        running: Option<(Origin, u32)>,
        at: Origin,
    ) {
        // A mission that has ended has left a room.
        let memory = self.machine.own_memory().take(spare);
        let prepared = memory.and_then(|memory| match WARM {
            true => Prepared::again(mission, memory),
            // The room was another's.
            false => Prepared::new(mission, memory, self.execution.registry()),
        });
        debug_assert!(prepared.is_some());
        if let Some(prepared) = prepared {
            self.start_mission(prepared, running, at, None);
        }
    }

    /// Takes the mission away, if there is one. What is left are its tables and memory.
    // Not inlined: no other mission should be made on top of this one.
    #[inline(never)]
    pub(super) fn end_mission(&mut self) -> Option<StoppedMission<'m>> {
        let mission = self.machine.take()?;
        let lists = self.execution.begin_mission(Lists::default());
        self.execution.begin_migration();
        self.execution.end_migration(lists.tasks);
        Some(self.machine.rest(mission, lists))
    }

    /// The origin of the mission's slots, and its interpreter's period, if there is one.
    #[inline(never)]
    pub(super) fn running(&self) -> Option<(Origin, u32)> {
        let is_there = self.machine.mission().is_some();
        is_there.then(|| self.timetable.running())
    }
}
