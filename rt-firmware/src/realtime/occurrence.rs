//! The timer's entry, and an occurrence of a slot from its beginning to its end: the exchange with
//! the body, in the interpreter's slot the macro step, the slot's tasks, a slot-0 run that has
//! ended or waits, what is counted.
//!
//! At the end of an occurrence the next one is looked up: its start, and the slot's first enabled
//! task. So its first task starts a constant number of instructions after the timer. What is due,
//! but was not looked up, is the business of [`due`](super::due).
//!
//! *Invariant:* what was looked up does not change before its time. Nothing but occurrences changes
//! what it depends on; who changes mode or mission besides [takes it back](RealTime::forget_next).

use core::sync::atomic::Ordering;

use esm_core::{Fault, dispatcher};

use super::mission::Origin;
use super::slots::SlotEntry;
use super::tasks::NONE;
use super::trace::StepObserver;
use super::{IDLE_POLL_US, RealTime};
use crate::board::{Board, OccurrenceStart, ticks};
use crate::features::WARM;
use esm_link::message::{Mode, SafeReason};

/// How long occurrences may follow one another, each looked up after the one before, without a look
/// at the whole clock.
const LOOK_US: u32 = 100_000;

/// The next occurrence, where it was looked up after the one before. It never is one of the
/// interpreter's, which begins with a macro step.
#[derive(Clone, Copy)]
pub(super) struct Next {
    /// Nominal start on the board's clock, low half.
    start_ticks: u32,
    /// For how long from then it is on time; 0 where nothing is looked up.
    window_ticks: u32,
    duration_us: u32,
    /// The slot's first enabled task instance, or [`NONE`].
    instance: u16,
}

impl Next {
    pub(super) const NOTHING: Next = Next {
        start_ticks: 0,
        window_ticks: 0,
        duration_us: 0,
        instance: NONE,
    };
}

/// For how long an occurrence is on time, where this is the shortest period of all slots. What
/// begins later than that may have been missed.
#[cfg_attr(feature = "speed", inline(always))]
fn mission_window<B: Board>(shortest_period_us: u32) -> u32 {
    /// Less than half a round of the clock, so that one that has gone half around is not taken for
    /// one that is late.
    const LONGEST_WINDOW_US: u32 = i32::MAX as u32 / u16::MAX as u32;
    shortest_period_us.min(LONGEST_WINDOW_US) * B::TICKS_PER_US
}

/// An occurrence that is being executed.
#[derive(Clone, Copy)]
pub(super) struct Occurrence {
    pub(super) slot: usize,
    /// Nominal start since the origin.
    pub(super) start_us: u64,
    pub(super) number: u64,
    pub(super) interpreter: bool,
}

impl RealTime<'_, '_> {
    /// Executes all that is due, and returns when to be called again, in ticks of the board's
    /// clock. To be called from the slot timer's interrupt, first at any time. Being called early
    /// does no harm.
    #[cfg_attr(feature = "speed", inline(always))]
    pub fn on_timer<B: Board>(&mut self, board: &mut B) -> u64 {
        // Nothing comes before this: it is what the delay of a slot is made of.
        let now_ticks = board.now_low_ticks();
        let delay_ticks = now_ticks.wrapping_sub(self.next.start_ticks);
        if delay_ticks >= self.next.window_ticks || self.is_stop_wanted(board) {
            return self.go_on(board, false);
        }
        let start = self.next_start::<B>();
        if let Err(reason) = board.begin_occurrence(&start) {
            return self.begin_in_vain(board, &start, delay_ticks, reason);
        }
        let Next {
            duration_us,
            instance,
            ..
        } = self.next;
        if instance != NONE {
            self.execute_tasks(board, instance, now_ticks, duration_us);
        }
        let taken = self.dispatcher.next();
        self.dispatcher.take_on_time();
        self.end(taken.start_us, duration_us);
        self.count_delay::<B>(delay_ticks);
        if self.from_background.ready() || self.tasks.look_for_jobs() {
            self.change_jobs(taken.slot, taken.start_us);
        }
        let ended_ticks = board.now_low_ticks();
        let took_ticks = ended_ticks.wrapping_sub(now_ticks);
        self.count_time::<B>(took_ticks);
        self.count_execution(board, taken.slot, delay_ticks, took_ticks);
        self.look_for_failure(board);
        match self.look_up_next::<B>(&taken, ended_ticks) {
            Some(at_ticks) => at_ticks,
            None => self.go_on(board, true),
        }
    }

    /// What a board is told of the next occurrence.
    #[cfg_attr(feature = "speed", inline(always))]
    fn next_start<B: Board>(&self) -> OccurrenceStart {
        let dispatcher::Occurrence { slot, start_us } = self.dispatcher.next();
        let (origin, number) = self
            .mission
            .as_ref()
            .map_or((Origin { ticks: 0, us: 0 }, 0), |mission| {
                (mission.origin, mission.occurrences)
            });
        let since_us = origin.us + start_us;
        OccurrenceStart {
            slot,
            number,
            start_us: since_us,
            start_ticks: origin.ticks + ticks::<B>(start_us),
            previous_end_us: self.previous_end_us.min(since_us),
            interpreter: false,
        }
    }

    /// The occurrence that was looked up could not begin.
    #[cold]
    #[inline(never)]
    fn begin_in_vain<B: Board>(
        &mut self,
        board: &mut B,
        start: &OccurrenceStart,
        delay_ticks: u32,
        reason: SafeReason,
    ) -> u64 {
        let duration_us = self.next.duration_us;
        let taken = self.dispatcher.next();
        self.dispatcher.take_on_time();
        self.end(taken.start_us, duration_us);
        self.count_delay::<B>(delay_ticks);
        self.fail_safe(board, reason);
        self.count_time::<B>(
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
        if let Some(reason) = self.failure.take() {
            self.fail_safe(board, reason);
        }
    }

    /// An occurrence is over, as far as whoever asks for the time is concerned.
    #[cfg_attr(feature = "speed", inline(always))]
    fn end(&mut self, start_us: u64, duration_us: u32) {
        if let Some(mission) = &mut self.mission {
            mission.occurrences += 1;
            self.previous_end_us = mission.robot_us(start_us) + u64::from(duration_us);
        }
    }

    /// Looks up the next occurrence after one that was on time, and returns its start, which is
    /// when to be called again. `None` if it is due already or far away, or if there is something
    /// else to do first: a letter waits, or the whole clock was not looked at for long.
    #[cfg_attr(feature = "speed", inline(always))]
    fn look_up_next<B: Board>(
        &mut self,
        taken: &dispatcher::Occurrence,
        now_ticks: u32,
    ) -> Option<u64> {
        const NEAR_US: u32 = 2 * IDLE_POLL_US;
        let look_ticks = LOOK_US.saturating_mul(B::TICKS_PER_US);
        if self.from_link.ready() || now_ticks.wrapping_sub(self.looked_ticks) >= look_ticks {
            return None;
        }
        let next = self.dispatcher.next();
        // No period is as long as these bits last.
        let wait_us = (next.start_us as u32).wrapping_sub(taken.start_us as u32);
        if wait_us > NEAR_US {
            return None;
        }
        let start_ticks = self.mission.as_ref()?.origin.ticks + ticks::<B>(next.start_us);
        let wait_ticks = (start_ticks as u32).wrapping_sub(now_ticks) as i32;
        if wait_ticks <= 0 {
            return None;
        }
        self.look_up::<B>(next, start_ticks as u32)
            .then_some(start_ticks)
    }

    /// Looks up the dispatcher's next occurrence. Its start is near, so that the low half of the
    /// clock tells whether it is due. False if it may be the first of another mission.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn look_up<B: Board>(
        &mut self,
        next: dispatcher::Occurrence,
        start_ticks: u32,
    ) -> bool {
        self.next.start_ticks = start_ticks;
        self.next.window_ticks = 0;
        let Some(mission) = &self.mission else {
            return false;
        };
        if next.slot == mission.interpreter_slot {
            return !(WARM
                && (self.waiting.is_some()
                    || self.trial.is_some()
                    || self.signs.mission_is_coming.load(Ordering::Relaxed)));
        }
        let Some(entry) = self.tasks.lists.slots.get(next.slot) else {
            return false;
        };
        if self.mode != Mode::Running {
            return true;
        }
        self.next.duration_us = entry.duration_us();
        self.next.instance = entry.first_enabled();
        if self.next.instance == NONE || self.prepare_first(next) {
            self.next.window_ticks = mission_window::<B>(self.shortest_period_us);
        }
        true
    }

    /// Prepares the first task of an occurrence. False if it cannot be executed.
    #[inline(never)]
    fn prepare_first(&mut self, next: dispatcher::Occurrence) -> bool {
        if let Some(mission) = &self.mission {
            let period_us = self.dispatcher.period_us(next.slot);
            self.executor.begin(
                mission.t_us(next.start_us),
                mission.robot_us(next.start_us),
                period_us,
            );
        }
        self.prepare_task(self.next.instance)
    }

    /// What was looked up is so no more.
    pub(super) fn forget_next(&mut self) {
        self.next = Next::NOTHING;
    }

    /// Executes an occurrence that began at `began_ticks`; its nominal start was at `start_ticks`.
    pub(super) fn execute<B: Board>(
        &mut self,
        board: &mut B,
        occurrence: &Occurrence,
        began_ticks: u64,
        start_ticks: u64,
    ) {
        let delay_ticks = u32::try_from(began_ticks - start_ticks).unwrap_or(u32::MAX);
        let Some(mission) = &self.mission else {
            return;
        };
        let start_us = mission.robot_us(occurrence.start_us);
        let t_us = mission.t_us(occurrence.start_us);
        let start = OccurrenceStart {
            slot: occurrence.slot,
            number: occurrence.number,
            start_us,
            start_ticks,
            previous_end_us: self.previous_end_us.min(start_us),
            interpreter: occurrence.interpreter,
        };
        let slot = self.tasks.lists.slots.get(occurrence.slot);
        let duration_us = slot.map_or(0, SlotEntry::duration_us);
        self.end(occurrence.start_us, duration_us);
        self.count_delay::<B>(delay_ticks);
        if self.mode == Mode::EmergencyStopped {
            self.hold_still(board);
        }
        if let Err(reason) = board.begin_occurrence(&start)
            && self.mode == Mode::Running
        {
            self.fail_safe(board, reason);
        }
        self.take_job_back(Some(occurrence));
        if occurrence.interpreter {
            self.send_answered();
            self.listen(start_us);
            if self.mode == Mode::Running {
                self.macro_step(board, start_us);
            } else {
                board.motors_off();
            }
        }
        if self.mode == Mode::Running {
            let period_us = self.dispatcher.period_us(occurrence.slot);
            self.executor.begin(t_us, start_us, period_us);
            let now_ticks = board.now_low_ticks();
            let slot = self.tasks.lists.slots.get(occurrence.slot);
            let first = slot.map_or(NONE, SlotEntry::first_enabled);
            if first != NONE {
                self.prepare_task(first);
            }
            self.execute_tasks(board, first, now_ticks, duration_us);
            if self.tasks.look_for_jobs() {
                self.start_job(occurrence.start_us, occurrence.number);
            }
            let took_ticks = board.now_low_ticks().wrapping_sub(began_ticks as u32);
            self.count_execution(board, occurrence.slot, delay_ticks, took_ticks);
            self.look_for_failure(board);
        }
        if occurrence.interpreter {
            self.tell_health();
        }
    }

    #[inline(never)]
    fn macro_step(&mut self, board: &mut impl Board, robot_us: u64) {
        let Some(mission) = &mut self.mission else {
            return;
        };
        mission.step_us = robot_us;
        let mut observer = StepObserver {
            tasks: &mut self.tasks,
            trace: &mut self.trace,
            black_box: self.kept.map(|kept| &kept.black_box),
            robot_us,
        };
        self.record.before_step(&mission.interpreter);
        let ended = mission.interpreter.macro_step(&mut observer);
        self.record.after_step(&mission.interpreter);
        match ended {
            Ok(summary) => {
                mission.next_step = summary.step + 1;
                self.health.steps = mission.next_step;
                self.health.t_us = summary.t_us();
                self.sampler.after_step(&self.executor, summary.t_us());
                self.trace.step(&summary, &mission.interpreter);
            }
            Err(fault) => {
                self.trace.fault(mission.next_step, fault);
                let reason = match fault {
                    Fault::EventQueueOverflow => SafeReason::EventQueueOverflow,
                    Fault::MacroStepLimit => SafeReason::MacroStepLimit,
                };
                self.fail_safe(board, reason);
            }
        }
    }
}
