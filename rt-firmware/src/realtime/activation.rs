//! The timer's entry, and an activation of a slot from its beginning to its end: the exchange with
//! the body, in the interpreter's slot the macro step, the slot's tasks, a background run that has
//! ended or waits, what is counted.
//!
//! At the end of an activation the next one is looked up: its start, and the slot's first enabled
//! task. So its first task starts a constant number of instructions after the timer. What is due,
//! but was not looked up, is the business of [`due`](super::due).
//!
//! *Invariant:* what was looked up does not change before its time. Nothing but activations changes
//! what it depends on; who changes mode or mission besides [takes it back](RealTime::forget_next).

use esm_core::Fault;
use esm_core::dispatcher::{self, Near};

use super::RealTime;
use super::events::Event;
use super::execution::background_runs::{RunEnd, RunStart};
#[cfg(feature = "links")]
use super::execution::links;
use super::execution::{Around, StepObserver};
use super::slots::SlotEntry;
use super::tasks::NONE;
use super::timetable::Activation;
use crate::board::{ActivationStart, Board, ticks_between};
use crate::features::WARM;
use crate::task::Step;
use esm_link::message::{Mode, SafeReason};

impl RealTime<'_, '_> {
    /// Executes all that is due, and returns when to be called again, in ticks of the board's
    /// clock. To be called from the slot timer's interrupt, first at any time. Being called early
    /// does no harm.
    #[cfg_attr(feature = "speed", inline(always))]
    pub fn on_timer<B: Board>(&mut self, board: &mut B) -> u64 {
        // Nothing comes before this: it is what the delay of a slot is made of.
        let began_count = board.count();
        let (delay_ticks, is_on_time) = self.timetable.delay::<B>(began_count);
        if !is_on_time || self.safety.is_stop_wanted(board) {
            return self.go_on(board, false);
        }
        let execution = &self.execution;
        let start = (self.timetable).next_start::<B>(|slot| execution.duration_us(slot));
        if let Err(reason) = board.begin_activation(&start) {
            return self.begin_in_vain(board, &start, delay_ticks, reason);
        }
        if let Some(step) = self.execution.execute_first(board, &mut self.machine) {
            self.execute_near(board, step, began_count);
        }
        let Some((taken, next)) = self.timetable.take_near() else {
            return self.end_far(board, began_count, delay_ticks);
        };
        let ended_count = if self.safety.is_called() {
            match self.end_attentively(board, began_count, delay_ticks, taken) {
                Some(ended_count) => ended_count,
                None => return self.go_on(board, true),
            }
        } else {
            let ended_count = board.count();
            let took_ticks = ticks_between::<B>(began_count, ended_count);
            self.count_activation(board, taken.slot(), delay_ticks, took_ticks);
            ended_count
        };
        match self.look_up_near(board, next, ended_count) {
            Some(start_ticks) => self.timetable.whole_ticks::<B>(start_ticks),
            None => self.go_on(board, true),
        }
    }

    /// Takes over what the first task of an activation did that was looked up, and executes those
    /// that follow it.
    #[cfg_attr(feature = "speed", inline(always))]
    fn execute_near<B: Board>(&mut self, board: &mut B, first: Step, began_count: u32) {
        self.execute_others(board, Some(first), began_count);
        // A background run may lack what a task has just published.
        if self.execution.is_more_to_do() {
            self.safety.call();
        }
    }

    /// Takes over what the first task of a slot did, and executes those that follow it, in an
    /// activation that began at `began_count`.
    #[inline(never)]
    fn execute_others<B: Board>(&mut self, board: &mut B, first: Option<Step>, began_count: u32) {
        let around = Around {
            machine: &mut self.machine,
            observers: &mut self.observers,
        };
        (self.execution).execute_others(first, board, around, began_count);
    }

    /// Ends and counts an activation that was looked up, after which more is to be looked at than
    /// the next one. Returns when that was; `None` if there is a command.
    #[cold]
    #[inline(never)]
    fn end_attentively<B: Board>(
        &mut self,
        board: &mut B,
        began_count: u32,
        delay_ticks: u32,
        taken: Near,
    ) -> Option<u32> {
        self.safety.take_call();
        let has_executed = self.execution.take_executed();
        if self.execution.has_run_ended() || has_executed && self.execution.may_start_run() {
            self.settle();
            self.change_runs(taken.slot(), self.timetable.start_us(taken));
        }
        let ended_count = board.count();
        let took_ticks = ticks_between::<B>(began_count, ended_count);
        self.count_activation(board, taken.slot(), delay_ticks, took_ticks);
        self.look_for_failure(board);
        (!self.commands.has_come()).then_some(ended_count)
    }

    /// Counts an activation that was looked up.
    #[cfg_attr(feature = "speed", inline(always))]
    fn count_activation(
        &mut self,
        board: &mut impl Board,
        slot: usize,
        delay_ticks: u32,
        took_ticks: u32,
    ) {
        self.safety.count_time(took_ticks);
        self.count_execution(board, slot, delay_ticks, took_ticks);
    }

    /// Ends an activation of a slot whose next start is far away.
    #[cold]
    #[inline(never)]
    fn end_far<B: Board>(&mut self, board: &mut B, began_count: u32, delay_ticks: u32) -> u64 {
        let taken = self.take_far();
        if self.execution.has_run_ended() || self.execution.may_start_run() {
            self.change_runs(taken.slot, taken.start_us);
        }
        let took_ticks = ticks_between::<B>(began_count, board.count());
        self.count_activation(board, taken.slot, delay_ticks, took_ticks);
        self.look_for_failure(board);
        self.go_on(board, true)
    }

    fn take_far(&mut self) -> dispatcher::Activation {
        let execution = &self.execution;
        self.timetable.take_far(|slot| execution.duration_us(slot))
    }

    /// The activation that was looked up could not begin.
    #[cold]
    #[inline(never)]
    fn begin_in_vain<B: Board>(
        &mut self,
        board: &mut B,
        start: &ActivationStart,
        delay_ticks: u32,
        reason: SafeReason,
    ) -> u64 {
        self.take_far();
        self.observers.count_delay::<B>(delay_ticks);
        self.fail_safe(board, reason);
        self.safety.count_time(
            board
                .now_low_ticks()
                .wrapping_sub(start.start_ticks as u32)
                .wrapping_sub(delay_ticks),
        );
        self.go_on(board, true)
    }

    /// Puts the robot into its safe state if a task wants that: after all tasks of the slot, so
    /// that none of them writes the motors any more.
    #[cfg_attr(feature = "speed", inline(always))]
    fn look_for_failure<B: Board>(&mut self, board: &mut B) {
        if let Some(reason) = self.execution.take_failure() {
            self.fail_safe(board, reason);
        }
    }

    /// Works out what was counted in 32 bits of the activations that were looked up.
    pub(super) fn settle(&mut self) {
        let execution = &self.execution;
        self.timetable.settle(|slot| execution.duration_us(slot));
    }

    /// Looks up the next activation after this one, which was on time, was looked up itself, and
    /// ended at this count. Answers its start on the board's clock, low half; `None` if it is due
    /// already or far away, or may be the first of another mission.
    #[cfg_attr(feature = "speed", inline(always))]
    fn look_up_near<B: Board>(
        &mut self,
        board: &mut B,
        next: Near,
        ended_count: u32,
    ) -> Option<u32> {
        let start_ticks = self.timetable.start_ticks::<B>(next);
        if !self.timetable.is_near::<B>(start_ticks, ended_count) {
            return None;
        }
        if self.timetable.is_rare(next) {
            return self.look_up_rare(board, next, start_ticks);
        }
        self.look_up_usual(next, start_ticks);
        Some(start_ticks)
    }

    /// The same of one that may be the interpreter's, or wait for a look at the whole clock.
    #[cold]
    #[inline(never)]
    fn look_up_rare<B: Board>(
        &mut self,
        board: &mut B,
        next: Near,
        start_ticks: u32,
    ) -> Option<u32> {
        if self.timetable.is_look_due(next) && !self.look_at_clock(board, next) {
            return None;
        }
        if self.timetable.is_interpreters(next.slot()) {
            self.timetable.look_up_near(start_ticks);
            self.timetable.pass_over_next();
            return (!self.may_change_mission()).then_some(start_ticks);
        }
        self.look_up_usual(next, start_ticks);
        Some(start_ticks)
    }

    #[cfg_attr(feature = "speed", inline(always))]
    fn look_up_usual(&mut self, next: Near, start_ticks: u32) {
        self.timetable.look_up_near(start_ticks);
        let instance = self.first_enabled(next.slot());
        if instance != NONE {
            self.prepare_first(next, instance);
        }
    }

    /// Looks at the whole clock, which was not looked at for long, before this activation. False if
    /// there is more to be done.
    #[cold]
    #[inline(never)]
    fn look_at_clock<B: Board>(&mut self, board: &mut B, next: Near) -> bool {
        let began_count = board.count();
        let now_ticks = board.now_ticks();
        self.settle();
        self.look_for_stops(board);
        if self.commands.is_waiting() || !self.safety.is_running() {
            return false;
        }
        self.feed_watchdog(board, now_ticks);
        self.timetable.looked(next);
        let took_ticks = ticks_between::<B>(began_count, board.count());
        self.safety.count_time(took_ticks);
        self.safety.settle_time(B::TICKS_PER_US);
        true
    }

    /// Whether the interpreter's next activation may be the first of another mission.
    #[inline(never)]
    fn may_change_mission(&self) -> bool {
        WARM && (self.commands.is_waiting()
            || self.machine.trial().is_some()
            || self.safety.is_mission_coming())
    }

    /// Looks up the dispatcher's next activation, which starts at this time, after a look at the
    /// whole clock.
    pub(super) fn look_up<B: Board>(&mut self, start_ticks: u64) {
        let next = self.timetable.next_near();
        let slot = next.slot();
        if self.timetable.is_interpreters(slot) || !self.safety.is_running() {
            return;
        }
        self.timetable.look_up::<B>(start_ticks);
        self.execution.set_base(self.timetable.base_times_us());
        self.execution.forget();
        let instance = self.first_enabled(slot);
        if instance != NONE {
            self.prepare_first(next, instance);
        }
    }

    /// The first enabled task instance of a slot, or [`NONE`].
    #[cfg_attr(feature = "speed", inline(always))]
    fn first_enabled(&self, slot: usize) -> u16 {
        let slot = self.execution.slot(slot);
        slot.map_or(NONE, SlotEntry::first_enabled)
    }

    /// Prepares the first task of an activation. Where it cannot be executed, the activation is not
    /// looked up.
    #[cfg_attr(feature = "speed", inline(always))]
    fn prepare_first(&mut self, next: Near, instance: u16) {
        self.execution.begin_near(next.slot(), next.since_us());
        if !self.execution.prepare_first(instance, &self.machine) {
            self.timetable.pass_over_next();
        }
    }

    /// What was looked up is so no more.
    pub(super) fn forget_next(&mut self) {
        self.settle();
        self.timetable.pass_over_next();
    }

    /// Executes an activation that began at `began_ticks`; its nominal start was at `start_ticks`.
    pub(super) fn execute<B: Board>(
        &mut self,
        board: &mut B,
        activation: &Activation,
        began_ticks: u64,
        start_ticks: u64,
    ) {
        let delay_ticks = u32::try_from(began_ticks - start_ticks).unwrap_or(u32::MAX);
        let start_us = self.timetable.robot_us(activation.start_us);
        let start = ActivationStart {
            slot: activation.slot,
            number: activation.number,
            start_us,
            start_ticks,
            previous_end_us: self.timetable.previous_end_us().min(start_us),
            interpreter: activation.interpreter,
        };
        let duration_us = self.execution.duration_us(activation.slot);
        self.timetable.end(activation.start_us, duration_us);
        self.observers.count_delay::<B>(delay_ticks);
        if self.safety.mode() == Mode::EmergencyStopped {
            self.hold_still(board);
        }
        if let Err(reason) = board.begin_activation(&start)
            && self.safety.is_running()
        {
            self.fail_safe(board, reason);
        }
        self.take_run_back(Some(activation));
        if activation.interpreter {
            self.send_answered();
            let silent_us = self.safety.listen(start_us);
            self.execution.tell_link_silent(silent_us);
            if self.safety.is_running() {
                self.macro_step(board, start_us);
            } else {
                board.motors_off();
            }
        }
        if self.safety.is_running() {
            self.execute_slot(board, activation, start_us);
            let took_ticks = board.now_low_ticks().wrapping_sub(began_ticks as u32);
            self.count_execution(board, activation.slot, delay_ticks, took_ticks);
            self.look_for_failure(board);
        }
        if activation.interpreter {
            self.tell_health();
        }
    }

    /// Executes the tasks of an activation that starts at this robot time, and starts a background
    /// run.
    fn execute_slot<B: Board>(&mut self, board: &mut B, activation: &Activation, robot_us: u64) {
        let t_us = self.timetable.t_us(activation.start_us);
        self.execution.begin(activation.slot, t_us, robot_us);
        let now_ticks = board.now_low_ticks();
        let first = self.first_enabled(activation.slot);
        if first != NONE {
            self.execution.prepare_first(first, &self.machine);
            let step = self.execution.execute_first(board, &mut self.machine);
            self.execute_others(board, step, now_ticks);
        }
        if self.execution.may_start_run() {
            self.start_run(activation.start_us, activation.number);
        }
    }

    #[inline(never)]
    fn macro_step(&mut self, board: &mut impl Board, robot_us: u64) {
        let RealTime {
            timetable,
            machine,
            execution,
            observers,
            ..
        } = self;
        let Some(mission) = machine.mission_mut() else {
            return;
        };
        timetable.begin_step(robot_us);
        observers.before_step(mission.interpreter());
        let ended = mission.macro_step(&mut StepObserver {
            execution,
            observers,
            robot_us,
        });
        observers.after_step(mission.interpreter());
        match ended {
            Ok(summary) => {
                observers.end_step(&summary, mission.interpreter(), execution.executor());
                #[cfg(feature = "links")]
                links::clear_seen(execution, mission);
            }
            Err(fault) => {
                let step = mission.next_step();
                observers.tell(robot_us, Event::Fault { step, fault });
                let reason = match fault {
                    Fault::EventQueueOverflow => SafeReason::EventQueueOverflow,
                    Fault::MacroStepLimit => SafeReason::MacroStepLimit,
                };
                self.fail_safe(board, reason);
            }
        }
    }

    /// Takes a background run back that has ended, and starts another one, in the activation that
    /// began last. It has no macro step.
    #[inline(never)]
    fn change_runs(&mut self, slot: usize, start_us: u64) {
        if !self.safety.is_running() {
            return;
        }
        let activation = Activation {
            slot,
            start_us,
            number: self.timetable.activations().saturating_sub(1),
            interpreter: false,
        };
        self.take_run_back(Some(&activation));
        self.start_run(start_us, activation.number);
    }

    /// Takes back a background run that has ended; that becomes known in this activation.
    pub(super) fn take_run_back(&mut self, activation: Option<&Activation>) {
        if !self.execution.has_run_ended() {
            return;
        }
        let end = activation.map(|activation| RunEnd {
            step_us: self.timetable.noting_step_us(activation),
            number: activation.number,
        });
        let around = Around {
            machine: &mut self.machine,
            observers: &mut self.observers,
        };
        self.execution.take_run_back(end, around);
    }

    /// Starts a background run in an activation that starts so long after the origin.
    fn start_run(&mut self, start_us: u64, number: u64) {
        let start = RunStart {
            t_us: self.timetable.t_us(start_us),
            step_us: self.timetable.step_us(),
            number,
        };
        let around = Around {
            machine: &mut self.machine,
            observers: &mut self.observers,
        };
        self.execution.start_run(start, around);
    }
}
