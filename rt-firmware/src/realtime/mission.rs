//! The mission that runs: from its start, with what it takes over from the one before, to its end,
//! when its tables and memory are left.
//!
//! *Invariant:* a mission that starts was checked, so that there is room for all that it has.

use esm_core::StateMapping;

use super::params::LiveParams;
use super::running::{Mission, Origin, interpreter_period_us};
use super::staging::{MissionMemory, Prepared, StoppedMission};
use super::tasks::{self, Lists};
use super::{RealTime, params};
use crate::features::WARM;
use esm_link::black_box::Event;
use esm_link::message::Mode;
use esm_link::trace::TraceEvent;

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
        self.running = None;
        self.supervisor = None;
        self.failure = None;
        self.heard_us = at.us;
        self.executor.inputs().link_silent_us = 0;
        self.params = LiveParams::NONE;
        self.begin_health();
        let Prepared {
            mut interpreter,
            lists,
        } = prepared;
        let tables = interpreter.tables();
        let follows = running.filter(|(_, period_us)| *period_us == interpreter_period_us(&tables));
        let origin = follows.map_or(at, |(origin, _)| origin);
        let began_us = at.us - origin.us;
        // It was checked before that there is room for the slots, and verified that they have
        // periods.
        let refused = self.dispatcher.restart_at(tables.slots(), began_us);
        debug_assert!(refused.is_ok());
        // What starts with the interpreter, and before it in the order of the slots, has been.
        while follows.is_some()
            && self.dispatcher.next().slot != tables.interpreter_slot()
            && self.dispatcher.take(began_us).is_some()
        {}
        let old = self.tasks.begin(lists);
        let (mut carried, mut tasks_us) = (0, 0);
        // Where there is memory for one mission, the one before has ended.
        let before = if WARM { self.mission.take() } else { None };
        if WARM {
            self.executor.begin_migration();
            if let (Some(before), Some(mapping)) = (&before, common) {
                carried = interpreter.take_over(&before.interpreter, mapping).regions;
                tasks_us = before.t_us(at.us.saturating_sub(before.origin.us));
                let registry = self.executor.registry();
                self.tasks
                    .go_on(old.tasks, mapping.tasks(), registry, |task| {
                        interpreter.is_enabled(task)
                    });
                for (net, other) in mapping.nets() {
                    self.executor.migrate_net(net, other);
                }
            }
            self.executor.end_migration(tasks::left_behind(old.tasks));
        }
        let tables = interpreter.tables();
        let longest = tables.slots().map(|slot| slot.period_us).max();
        let shortest = tables.slots().map(|slot| slot.period_us).min();
        self.shortest_period_us = shortest.unwrap_or(0);
        self.supervision.begin_mission(longest.unwrap_or(0));
        let mission = interpreter.verified().hash();
        let saved = self.saved.of(mission);
        params::restore(&mut self.params, saved, &tables, self.executor.registry());
        self.health.mission = Some(mission);
        if !self.mode.is_latched() {
            self.mode = Mode::Running;
        }
        let interpreter_slot = tables.interpreter_slot();
        self.note(Event::Mission { hash: mission });
        self.trace.write_next_in_full();
        self.trace.record(TraceEvent::Started {
            mission,
            start_us: at.us,
        });
        self.record.started(mission, at.us, common.is_some());
        self.sampler.started(mission);
        self.mission = Some(Mission {
            interpreter,
            origin,
            began_us,
            tasks_us,
            activations: 0,
            next_step: 0,
            step_us: at.us,
            interpreter_slot,
        });
        (carried, before.map(|before| self.rest(before, old)))
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
        let prepared = self.own.take(spare).and_then(|memory| match WARM {
            true => Prepared::again(mission, memory),
            // The room was another's.
            false => Prepared::new(mission, memory, self.executor.registry()),
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
        let mission = self.mission.take()?;
        let lists = self.tasks.begin(Lists::default());
        self.executor.begin_migration();
        self.executor.end_migration(tasks::left_behind(lists.tasks));
        Some(self.rest(mission, lists))
    }

    /// The origin of the mission's slots, and its interpreter's period.
    #[inline(never)]
    pub(super) fn running(&self) -> Option<(Origin, u32)> {
        self.mission.as_ref().map(Mission::running)
    }

    /// Takes a mission apart that has ended.
    fn rest(&mut self, mission: Mission<'m>, lists: Lists<'m>) -> StoppedMission<'m> {
        let (mission, arena) = mission.interpreter.into_parts();
        let spare = self.own.keep(MissionMemory { arena, lists });
        StoppedMission { mission, spare }
    }
}
