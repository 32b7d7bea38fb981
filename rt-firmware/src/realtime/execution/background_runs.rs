//! Runs of background tasks: they are started in activations of slots, executed by the background,
//! and taken back in another activation.
//!
//! *Invariant:* there is one background run, so that one run is under way at most; whoever waits
//! longest is started next.

use super::{Around, Execution};
use crate::ports::ReturnedRun;
use crate::realtime::events::Event;
use crate::realtime::tasks::TaskTable;

/// An activation in which a background run is started.
pub(in crate::realtime) struct RunStart {
    /// What the time of the mission's tasks is.
    pub(in crate::realtime) t_us: u64,
    /// The last macro step, on the robot's clock.
    pub(in crate::realtime) step_us: u64,
    /// Number of the activation.
    pub(in crate::realtime) number: u64,
}

/// An activation in which a background run is taken back.
pub(in crate::realtime) struct RunEnd {
    /// The macro step, on the robot's clock, that notes its end.
    pub(in crate::realtime) step_us: u64,
    /// Number of the activation.
    pub(in crate::realtime) number: u64,
}

impl Execution<'_, '_> {
    /// Whether a background run has ended that was not taken back.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(in crate::realtime) fn has_run_ended(&self) -> bool {
        self.from_background.ready()
    }

    /// Whether it is worth while to look for a background task that can be started.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(in crate::realtime) fn may_start_run(&self) -> bool {
        self.tasks.look_for_runs()
    }

    /// Whether a background run is under way.
    pub(in crate::realtime) fn is_background_busy(&self) -> bool {
        self.executor.checked_out().is_some()
    }
}

impl<'m> Execution<'_, 'm> {
    /// Takes back a background run that has ended; that becomes known in this activation. There is
    /// none where there is no mission.
    pub(in crate::realtime) fn take_run_back(
        &mut self,
        end: Option<RunEnd>,
        around: Around<'_, '_, 'm>,
    ) {
        let Around { machine, observers } = around;
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
        let (Some(mission), Some(end)) = (machine.mission_mut(), end) else {
            self.executor.return_run(background_run, 0);
            return;
        };
        let index = usize::from(running.unwrap_or(u16::MAX));
        let returned = self.executor.return_run(background_run, end.step_us);
        let (Some(instance), ReturnedRun::Ended(outcome)) = (running, returned) else {
            return;
        };
        self.failure = self.failure.or(outcome.failure);
        if self.tasks.is_fresh(instance) {
            // Entered anew meanwhile: flags and enable bit belong to the next activation.
            self.tasks.requeue(instance);
        } else {
            if mission.is_current(index) {
                if let Some(places) = mission.tables().task_places(index) {
                    mission.apply_flags(&places, outcome.flags);
                }
                mission.report_exit(index);
            } else {
                mission.clear_enabled(index);
            }
            self.finish_task(instance, observers);
        }
        let event = Event::BackgroundRunEnded {
            task_instance: instance,
            activation: end.number,
        };
        observers.tell(end.step_us, event);
    }

    /// Starts the background run that has waited longest and can be started, and marks as busy
    /// those that cannot.
    #[inline(never)]
    pub(in crate::realtime) fn start_run(&mut self, start: RunStart, around: Around<'_, '_, 'm>) {
        let Around { machine, observers } = around;
        if machine.mission().is_none() {
            return;
        }
        let RunStart {
            t_us,
            step_us,
            number,
        } = start;
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
                if let Some(mission) = machine.mission_mut() {
                    mission.set_busy(index, false);
                }
                continue;
            }
            let record = self.tasks.record(instance).filter(|_| !blocked);
            let background_run = record.and_then(|record| {
                let places = record.binding.places;
                self.executor
                    .checkout_bound(&record.binding, step_us, |inputs, declared| {
                        inputs.now_us = t_us;
                        if let Some(mission) = machine.mission() {
                            inputs.flags = mission.control_flags(&places);
                            machine.find_params(mission, &places, declared.params.len(), inputs);
                        }
                    })
            });
            if background_run.is_none() && !blocked {
                // Any execution may bring the value that it lacks.
                self.tasks.look_again();
            }
            if let Some(mission) = machine.mission_mut()
                && mission.is_current(index)
            {
                mission.set_busy(index, background_run.is_none());
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
            let event = Event::BackgroundRunStarted {
                task_instance: instance,
                activation: number,
            };
            observers.tell(step_us, event);
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
