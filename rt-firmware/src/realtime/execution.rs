//! The execution of a slot's enabled tasks: each reads its task instance's record, and nothing else
//! that a mission says.

use esm_core::tables::TaskPlaces;
use esm_core::{BlobBuffer, Interpreter};

use super::RealTime;
use super::params::LiveParams;
use super::running::Mission;
use super::tasks::{NO_GROUP, NONE, TaskActivity, TaskEntry, TaskTable};
use crate::board::{Board, ticks_between};
use crate::ports::{FlagChanges, Inputs, StepOutput};
use crate::task::{MAX_PARAMS, Step};
use esm_link::black_box::Event;
use esm_link::trace::TraceEvent;

impl RealTime<'_, '_> {
    /// Executes the enabled tasks of a slot, from the one on that was
    /// [prepared](Self::prepare_task), in an activation that [began](crate::Executor::begin) at
    /// `began_count`.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn execute_tasks<B: Board>(
        &mut self,
        board: &mut B,
        first: u16,
        began_count: u32,
        slot: impl Fn(&Self) -> usize,
    ) {
        let mut began_count = began_count;
        let mut instance = first;
        loop {
            let step = self.run_task(instance);
            let now_count = board.count();
            let took_ticks = ticks_between::<B>(began_count, now_count);
            began_count = now_count;
            let next = self.end_task(instance, step);
            // Not before the step: each instruction there makes it later.
            let duration_us = self.duration_us(slot(self));
            let duration_ticks = duration_us.saturating_mul(B::TICKS_PER_US);
            if took_ticks > duration_ticks && step.is_some() {
                self.note_overrun::<B>(instance, took_ticks, duration_us);
            }
            // As a rule there is one.
            if next == NONE {
                break;
            }
            instance = self.tasks.first_enabled(next);
            if instance == NONE {
                break;
            }
            self.prepare_task(instance);
        }
    }

    /// Executes the task that was prepared, and keeps which one that is for whoever ends the
    /// firmware meanwhile.
    #[cfg_attr(feature = "speed", inline(always))]
    fn run_task(&mut self, instance: u16) -> Option<Step> {
        let Some(kept) = self.kept else {
            return self.executor.run();
        };
        kept.set_task(Some(instance));
        let step = self.executor.run();
        kept.set_task(None);
        step
    }

    /// Gives an enabled task what its next execution needs. False if it cannot be executed: it is
    /// busy then.
    #[inline(never)]
    pub(super) fn prepare_task(&mut self, instance: u16) -> bool {
        let (Some(record), Some(Mission { interpreter, .. })) = (
            self.tasks.lists.tasks.get_mut(usize::from(instance)),
            &self.mission,
        ) else {
            return false;
        };
        self.executor.forget();
        if record.group != NO_GROUP
            && TaskTable::is_held_from(self.tasks.groups, record.group, instance)
        {
            return false;
        }
        let inputs = self.executor.inputs();
        if record.places.control_flags != 0 {
            inputs.flags = interpreter.control_flags_at(&record.places);
        }
        let count = usize::from(record.params);
        if count > 0 {
            find_params(interpreter, &self.params, &record.places, count, inputs);
        }
        let enter = record.activity == TaskActivity::Fresh;
        self.executor.prepare(&mut record.binding, enter)
    }

    /// Takes over what a task did, and returns the task instance that follows in its slot. It was
    /// not executed if it is busy.
    #[inline(never)]
    fn end_task(&mut self, instance: u16, step: Option<Step>) -> u16 {
        let (Some(record), Some(Mission { interpreter, .. })) = (
            self.tasks.lists.tasks.get_mut(usize::from(instance)),
            &mut self.mission,
        ) else {
            return NONE;
        };
        let next = record.next_in_slot;
        let Some(step) = step else {
            show_busy(interpreter, record, true);
            return next;
        };
        if record.is_busy {
            show_busy(interpreter, record, false);
        }
        record.activity = TaskActivity::UnderWay;
        if let Some(said) = self.executor.end_step(&record.binding) {
            apply_flags(interpreter, &record.places, said.flags);
            self.take_over(instance, said);
        }
        if step == Step::Finished {
            self.finish_task(instance);
        }
        next
    }

    /// Takes over what a task said beside its flags.
    #[cfg_attr(feature = "speed", inline(always))]
    fn take_over(&mut self, instance: u16, said: StepOutput) {
        if let Some(allowed) = said.allowed_overruns {
            self.supervisor = Some((instance, u16::try_from(allowed).unwrap_or(u16::MAX)));
        }
        self.failure = self.failure.or(said.failure);
    }

    /// A task has done its work.
    #[inline(never)]
    fn finish_task(&mut self, instance: u16) {
        if let Some(Mission { interpreter, .. }) = &mut self.mission {
            interpreter.report_exit(usize::from(instance));
        }
        self.tasks.disable(instance);
        self.trace.write_next_in_full();
    }

    /// A task took longer than its slot.
    #[cold]
    #[inline(never)]
    fn note_overrun<B: Board>(&mut self, instance: u16, took_ticks: u32, duration_us: u32) {
        let took_us = took_ticks / B::TICKS_PER_US.max(1);
        let end_us = self.executor.robot_us() + u64::from(duration_us);
        self.tasks.overrun(instance);
        self.note_at(
            end_us,
            Event::Overrun {
                task_instance: instance,
                took_us: u16::try_from(took_us).unwrap_or(u16::MAX),
            },
        );
        self.trace.record(TraceEvent::Overrun {
            task_instance: instance,
            took_us,
        });
    }
}

/// Sets or resets a task's busy flag.
#[inline(never)]
fn show_busy(
    interpreter: &mut Interpreter<'_, BlobBuffer<'_>>,
    record: &mut TaskEntry,
    is_busy: bool,
) {
    record.is_busy = is_busy;
    interpreter.set_busy_at(&record.places, is_busy);
}

/// Finds what a task's parameters are.
#[inline(never)]
pub(super) fn find_params(
    interpreter: &Interpreter<'_, BlobBuffer<'_>>,
    params: &LiveParams,
    places: &TaskPlaces,
    count: usize,
    inputs: &mut Inputs,
) {
    let wanted = inputs
        .params
        .get_mut(..count.min(MAX_PARAMS))
        .unwrap_or_default();
    interpreter.params_at(places, wanted);
    params.put_into(wanted, places.first_param);
}

/// Writes the control flags that a task wrote.
pub(super) fn apply_flags(
    interpreter: &mut Interpreter<'_, BlobBuffer<'_>>,
    places: &TaskPlaces,
    flags: FlagChanges,
) {
    if flags.written != 0 {
        interpreter.set_flags_at(places, flags.written, flags.values);
    }
}
