//! Runs of slot-0 tasks: they are started in occurrences of slots, executed by the background, and
//! taken back in another occurrence.
//!
//! *Invariant:* there is one job, so that one run is under way at most; whoever waits longest is
//! started next.

use esm_core::tables::Tables;

use super::RealTime;
use super::execution::{apply_flags, find_params};
use super::occurrence::Occurrence;
use super::tasks::TaskTable;
use crate::ports::Harvest;
use esm_link::message::Mode;
use esm_link::trace::TraceRecord;

impl RealTime<'_, '_> {
    /// Takes a slot-0 run back that has ended, and starts another one, in the occurrence that began
    /// last. It has no macro step.
    #[inline(never)]
    pub(super) fn change_jobs(&mut self, slot: usize, start_us: u64) {
        if self.mode != Mode::Running {
            return;
        }
        let Some(mission) = &self.mission else {
            return;
        };
        let occurrence = Occurrence {
            slot,
            start_us,
            number: mission.occurrences.saturating_sub(1),
            interpreter: false,
        };
        self.take_job_back(Some(&occurrence));
        self.start_job(start_us, occurrence.number);
    }

    /// Takes back a slot-0 run that has ended; that becomes known in this occurrence. There is none
    /// where there is no mission.
    pub(super) fn take_job_back(&mut self, occurrence: Option<&Occurrence>) {
        let Some(place) = self.from_background.dequeue() else {
            return;
        };
        let job = place.take();
        self.job = Some(place);
        self.tasks.look_again();
        let running = self.running.take();
        let Some(job) = job else { return };
        let (Some(mission), Some(occurrence)) = (&mut self.mission, occurrence) else {
            self.executor.harvest(job, 0);
            return;
        };
        let index = usize::from(running.unwrap_or(u16::MAX));
        let step_us = mission.noting_step_us(occurrence);
        let harvest = self.executor.harvest(job, step_us);
        let (Some(instance), Harvest::Ended(outcome)) = (running, harvest) else {
            return;
        };
        self.failure = self.failure.or(outcome.failure);
        if self.tasks.is_fresh(instance) {
            // Entered anew meanwhile: flags and enable bit belong to the next activation.
            self.tasks.requeue(instance);
        } else {
            if mission.interpreter.is_current(index) {
                if let Some(places) = mission.interpreter.tables().task_places(index) {
                    apply_flags(&mut mission.interpreter, &places, outcome.flags);
                }
                mission.interpreter.report_exit(index);
            } else {
                mission.interpreter.clear_enabled(index);
            }
            self.tasks.disable(instance);
            self.trace.write_next_in_full();
        }
        self.trace.record(TraceRecord::JobEnded {
            task_instance: instance,
            occurrence: occurrence.number,
        });
    }

    /// Starts the slot-0 run that has waited longest and can be started, and marks as busy those
    /// that cannot.
    #[inline(never)]
    pub(super) fn start_job(&mut self, start_us: u64, number: u64) {
        let Some(mission) = &mut self.mission else {
            return;
        };
        let t_us = mission.t_us(start_us);
        let step_us = mission.step_us;
        let params = &self.params;
        let interpreter = &mut mission.interpreter;
        let mut younger_than = None;
        self.tasks.looked();
        while let Some((instance, age)) = oldest_waiting(&self.tasks, younger_than) {
            younger_than = Some(age);
            let index = usize::from(instance);
            let place = self.tasks.place(instance);
            let blocked = self.executor.lent() == Some(place) || !self.tasks.may_run(instance);
            if !blocked && self.job.is_none() {
                // It waits for another task's run to end, which is not being busy.
                interpreter.set_busy(index, false);
                continue;
            }
            let record = self.tasks.record(instance).filter(|_| !blocked);
            let job = record.and_then(|record| {
                let places = record.places;
                self.executor
                    .lend_bound(&record.binding, step_us, |inputs, declared| {
                        inputs.now_us = t_us;
                        inputs.flags = interpreter.control_flags_at(&places);
                        find_params(interpreter, params, &places, declared.params.len(), inputs);
                    })
            });
            if job.is_none() && !blocked {
                // Any execution may bring the value that it lacks.
                self.tasks.look_again();
            }
            if interpreter.is_current(index) {
                interpreter.set_busy(index, job.is_none());
            }
            let Some(job) = job else { continue };
            let Some(carrier) = self.job.take() else {
                continue;
            };
            *carrier = Some(job);
            // There is one job, so that there is room for it.
            self.job = self.to_background.enqueue(carrier).err();
            self.running = Some(instance);
            self.tasks.executed(instance);
            self.trace.record(TraceRecord::JobStarted {
                task_instance: instance,
                occurrence: number,
            });
        }
    }
}

/// The slot-0 task instance that was enabled longest ago among those that wait to be started, if
/// younger than the last one looked at.
fn oldest_waiting(tasks: &TaskTable<'_>, younger_than: Option<u32>) -> Option<(u16, u32)> {
    let mut oldest: Option<(u16, u32)> = None;
    let mut next = tasks.first_in_slot_0();
    while let Some(instance) = next {
        next = tasks.next_in_slot(instance);
        let age = tasks.age(instance);
        let candidate = tasks.is_fresh(instance) && younger_than.is_none_or(|last| age < last);
        if candidate && oldest.is_none_or(|(_, oldest_age)| age > oldest_age) {
            oldest = Some((instance, age));
        }
    }
    oldest
}

/// The net of a data port.
pub(super) fn net_of(tables: &Tables<'_>, task_instance: usize, port: usize) -> Option<usize> {
    let first = tables.task_instance(task_instance)?.first_connection;
    tables.connection(first + port).flatten()
}
