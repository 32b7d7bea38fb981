//! The execution of a slot's enabled tasks: what enters one, and what it leaves.
//!
//! *Invariant:* while a task is executed, nothing of what was needed to make it ready, or to take over what it did, is on the stack.

use esm_core::tables::TaskPlaces;
use esm_core::{BlobBuffer, Interpreter};

use super::RealTime;
use super::mission::Mission;
use super::params::LiveParams;
use super::tasks::NONE;
use crate::board::Board;
use crate::ports::{FlagChanges, Inputs, Said};
use crate::task::{Declaration, Step};
use esm_link::black_box::Event;
use esm_link::trace::TraceRecord;

impl<const SLOTS: usize> RealTime<'_, '_, SLOTS> {
    /// Executes the enabled tasks of a slot, from this one on, in an occurrence that starts at `start_us`.
    pub(super) fn execute_tasks<B: Board>(
        &mut self,
        board: &mut B,
        first: Option<u16>,
        start_us: u64,
        period_us: u32,
        duration_ticks: u32,
    ) {
        let mut next = first;
        while let Some(instance) = next.and_then(|next| self.first_enabled(next)) {
            let began_ticks = board.now_low_ticks();
            let step = if self.make_task_ready(instance, start_us, period_us) {
                self.execute_ready(instance)
            } else {
                None
            };
            self.end_task(board, instance, step, began_ticks, duration_ticks);
            next = self.tasks.next_in_slot(instance);
        }
    }

    /// Executes the task that the executor has, and keeps which one that is for whoever ends the firmware meanwhile.
    #[inline(always)]
    pub(super) fn execute_ready(&mut self, instance: u16) -> Option<Step> {
        if let Some(kept) = self.kept {
            kept.set_task((instance != NONE).then_some(instance));
            let step = self.executor.execute_ready();
            kept.set_task(None);
            return step;
        }
        self.executor.execute_ready()
    }

    /// The first enabled task instance of a slot, from this one on.
    #[inline(always)]
    pub(super) fn first_enabled(&self, first: u16) -> Option<u16> {
        let found = self.tasks.first_enabled(first);
        // What the interpreter enables and disables is told to the table.
        debug_assert!(found.is_none_or(|found| {
            let mission = self.mission.as_ref();
            mission.is_some_and(|mission| mission.interpreter.is_enabled(usize::from(found)))
        }));
        found
    }

    /// Gives an enabled task what it needs to be executed in an occurrence that starts at `start_us`, and finds where what belongs to it stands. False if
    /// it cannot be executed.
    // Not inlined: no task should run on top of what this needs of the stack.
    #[inline(never)]
    pub(super) fn make_task_ready(&mut self, instance: u16, start_us: u64, period_us: u32) -> bool {
        let Some(mission) = &self.mission else {
            return false;
        };
        let Some((task, enter)) = self.tasks.to_run(instance) else {
            return false;
        };
        let interpreter = &mission.interpreter;
        let tables = interpreter.tables();
        let Some(places) = tables.task_places(usize::from(instance)) else {
            return false;
        };
        self.ready.places = places;
        let health = &self.health;
        let link_silent_us = self.link_silent_us;
        let params = &self.params;
        self.executor.make_ready(
            task,
            tables.nets_from(places.first_connection),
            enter,
            mission.robot_us(start_us),
            |inputs, declared| {
                inputs.now_us = mission.t_us(start_us);
                inputs.period_us = period_us;
                inputs.overruns = health.overruns;
                inputs.missed = health.missed;
                inputs.link_silent_us = link_silent_us;
                find_inputs(interpreter, params, &places, declared, inputs);
            },
        )
    }

    /// Takes over what an enabled task did in its execution, which began at `began_ticks`; there was none if it could not be executed.
    #[inline(never)]
    pub(super) fn end_task<B: Board>(
        &mut self,
        board: &mut B,
        instance: u16,
        step: Option<Step>,
        began_ticks: u32,
        duration_ticks: u32,
    ) {
        let Some(Mission { interpreter, .. }) = &mut self.mission else {
            return;
        };
        let index = usize::from(instance);
        let places = self.ready.places;
        let Some(step) = step else {
            interpreter.set_busy(index, true);
            return;
        };
        interpreter.set_busy_at(&places, false);
        let tables = interpreter.tables();
        let Said {
            flags,
            allowed_overruns,
            failure,
        } = self
            .executor
            .end_ready(tables.nets_from(places.first_connection))
            .unwrap_or_default();
        if let Some(allowed) = allowed_overruns {
            self.supervisor = Some((instance, u16::try_from(allowed).unwrap_or(u16::MAX)));
        }
        self.tasks.executed(instance);
        apply_flags(interpreter, &places, flags);
        self.failure = self.failure.or(failure);
        if step == Step::Finished {
            interpreter.report_exit(index);
            self.tasks.disable(instance);
            self.trace.write_next_in_full();
        }
        let took_ticks = board.now_low_ticks().wrapping_sub(began_ticks);
        if took_ticks > duration_ticks {
            self.tasks.overrun(instance);
            let took_us = took_ticks / B::TICKS_PER_US.max(1);
            self.note(Event::Overrun {
                task_instance: instance,
                took_us: u16::try_from(took_us).unwrap_or(u16::MAX),
            });
            self.trace.record(TraceRecord::Overrun {
                task_instance: instance,
                took_us,
            });
        }
    }
}

/// Finds what enters the execution of a task beside time and the values on nets: its parameters and flags.
pub(super) fn find_inputs(
    interpreter: &Interpreter<'_, BlobBuffer<'_>>,
    params: &LiveParams,
    places: &TaskPlaces,
    declared: &Declaration,
    inputs: &mut Inputs,
) {
    if !declared.params.is_empty() {
        let values = interpreter.tables().params_from(places.first_param);
        let wanted = inputs.params.get_mut(..declared.params.len());
        let wanted = wanted.unwrap_or_default();
        for (bits, value) in wanted.iter_mut().zip(values) {
            *bits = value;
        }
        params.put_into(wanted, places.first_param);
    }
    inputs.flags = interpreter.control_flags_at(places);
}

/// Writes the control flags that a task wrote.
pub(super) fn apply_flags(
    interpreter: &mut Interpreter<'_, BlobBuffer<'_>>,
    places: &TaskPlaces,
    flags: FlagChanges,
) {
    let mut written = flags.written;
    while written != 0 {
        let flag = written.trailing_zeros();
        written &= written - 1;
        interpreter.set_flag_at(places, flag as usize, flags.values >> flag & 1 != 0);
    }
}
