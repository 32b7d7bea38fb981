//! Runs of background tasks: they are started in activations of slots, executed by the background,
//! and taken back in another activation.
//!
//! *Invariant:* there is one background run, so that one run is under way at most; whoever waits
//! longest is started next.

use esm_core::tables::Tables;

use super::RealTime;
use super::execution::{apply_flags, find_params};
use super::running::Activation;
use super::tasks::TaskTable;
use crate::ports::ReturnedRun;
use esm_link::trace::TraceEvent;

impl RealTime<'_, '_> {
    /// Takes a background run back that has ended, and starts another one, in the activation that
    /// began last. It has no macro step.
    #[inline(never)]
    pub(super) fn change_runs(&mut self, slot: usize, start_us: u64) {
        if !self.is_running() {
            return;
        }
        let Some(mission) = &self.mission else {
            return;
        };
        let activation = Activation {
            slot,
            start_us,
            number: mission.activations.saturating_sub(1),
            interpreter: false,
        };
        self.take_run_back(Some(&activation));
        self.start_run(start_us, activation.number);
    }

    /// Takes back a background run that has ended; that becomes known in this activation. There is
    /// none where there is no mission.
    pub(super) fn take_run_back(&mut self, activation: Option<&Activation>) {
        let Some(place) = self.from_background.dequeue() else {
            return;
        };
        let background_run = place.take();
        self.background_run = Some(place);
        self.tasks.look_again();
        let running = self.running.take();
        let Some(background_run) = background_run else {
            return;
        };
        let (Some(mission), Some(activation)) = (&mut self.mission, activation) else {
            self.executor.return_run(background_run, 0);
            return;
        };
        let index = usize::from(running.unwrap_or(u16::MAX));
        let step_us = mission.noting_step_us(activation);
        let returned = self.executor.return_run(background_run, step_us);
        let (Some(instance), ReturnedRun::Ended(outcome)) = (running, returned) else {
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
        self.trace.record(TraceEvent::BackgroundRunEnded {
            task_instance: instance,
            activation: activation.number,
        });
    }

    /// Starts the background run that has waited longest and can be started, and marks as busy
    /// those that cannot.
    #[inline(never)]
    pub(super) fn start_run(&mut self, start_us: u64, number: u64) {
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
            let blocked =
                self.executor.checked_out() == Some(place) || !self.tasks.may_run(instance);
            if !blocked && self.background_run.is_none() {
                // It waits for another task's run to end, which is not being busy.
                interpreter.set_busy(index, false);
                continue;
            }
            let record = self.tasks.record(instance).filter(|_| !blocked);
            let background_run = record.and_then(|record| {
                let places = record.places;
                self.executor
                    .checkout_bound(&record.binding, step_us, |inputs, declared| {
                        inputs.now_us = t_us;
                        inputs.flags = interpreter.control_flags_at(&places);
                        find_params(interpreter, params, &places, declared.params.len(), inputs);
                    })
            });
            if background_run.is_none() && !blocked {
                // Any execution may bring the value that it lacks.
                self.tasks.look_again();
            }
            if interpreter.is_current(index) {
                interpreter.set_busy(index, background_run.is_none());
            }
            let Some(background_run) = background_run else {
                continue;
            };
            let Some(carrier) = self.background_run.take() else {
                continue;
            };
            *carrier = Some(background_run);
            // There is one background run, so that there is room for it.
            self.background_run = self.to_background.enqueue(carrier).err();
            self.running = Some(instance);
            self.tasks.executed(instance);
            self.trace.record(TraceEvent::BackgroundRunStarted {
                task_instance: instance,
                activation: number,
            });
        }
    }
}

/// The background task instance that was enabled longest ago among those that wait to be started,
/// if younger than the last one looked at.
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
