//! The timer's entry, and the next occurrence, which is made ready before its time: so its first task starts a constant number of instructions after the timer.
//!
//! *Invariant:* what is ready does not change before it is executed. Nothing but occurrences changes what it depends on; who changes mode or mission besides takes it back.

use core::num::NonZeroU64;
use core::sync::atomic::Ordering;

use esm_core::dispatcher;
use esm_core::tables::TaskPlaces;

use super::mission::Origin;
use super::tasks::NONE;
use super::{IDLE_POLL_US, RealTime};
use crate::board::{Board, OccurrenceStart, ticks};
use crate::features::WARM;
use crate::task::Step;
use esm_link::message::{Mode, SafeReason};

/// How long occurrences may follow one another, each made ready after the one before, without a look at the whole clock.
const LOOK_US: u32 = 100_000;

/// The next occurrence, where all that it needs was made ready after the one before. If one of its slot's tasks is enabled, the executor has the first
/// that is.
///
/// It never is one of the interpreter's, which begins with a macro step, and nothing happens between that it depends on: flags, enabled tasks and nets
/// change in occurrences alone.
#[derive(Clone, Copy)]
pub(super) struct Ready {
    /// Nominal start on the board's clock, low half.
    start_ticks: u32,
    /// For how long from then it is on time; 0 where nothing is ready.
    window_ticks: u32,
    duration_us: u32,
    /// The slot's first enabled task instance, or [`NONE`].
    instance: u16,
    /// Of the task that the executor has.
    pub(super) places: TaskPlaces,
}

impl Ready {
    pub(super) const NOTHING: Ready = Ready {
        start_ticks: 0,
        window_ticks: 0,
        duration_us: 0,
        instance: NONE,
        places: TaskPlaces {
            region: 0,
            first_flag: 0,
            flags: 0,
            first_param: 0,
            first_connection: 0,
        },
    };
}

impl<const SLOTS: usize> RealTime<'_, '_, SLOTS> {
    /// Executes all that is due, and returns when to be called again, in ticks of the board's clock. To be called from the slot timer's
    /// interrupt, first at any time. Being called early does no harm.
    #[inline]
    pub fn on_timer<B: Board>(&mut self, board: &mut B) -> u64 {
        // Nothing comes before this: it is what the delay of a slot is made of.
        let now = board.now_low_ticks();
        let delay_ticks = now.wrapping_sub(self.ready.start_ticks);
        if delay_ticks >= self.ready.window_ticks || self.is_stop_wanted(board) {
            return self.go_on(board, false);
        }
        let start = self.ready_start::<B>();
        let begun = board.begin_occurrence(&start);
        let step = if begun.is_ok() {
            self.execute_ready(self.ready.instance)
        } else {
            None
        };
        match self.end_ready(board, delay_ticks, begun, step) {
            Some(at_ticks) => at_ticks.get(),
            None => self.go_on(board, true),
        }
    }

    /// What is told of the occurrence that is ready.
    #[inline(always)]
    fn ready_start<B: Board>(&self) -> OccurrenceStart {
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

    /// Does what comes after the first task of an occurrence that was ready. Returns when to be called again, unless there is something else to do now.
    // Most of a robot's occurrences have no task, or one: what only those with a task need stands elsewhere.
    #[inline(never)]
    fn end_ready<B: Board>(
        &mut self,
        board: &mut B,
        delay_ticks: u32,
        begun: Result<(), SafeReason>,
        step: Option<Step>,
    ) -> Option<NonZeroU64> {
        let taken = self.dispatcher.next();
        self.dispatcher.take_on_time();
        let Ready {
            start_ticks,
            duration_us,
            instance,
            ..
        } = self.ready;
        self.begin(taken.start_us, duration_us, delay_ticks, B::TICKS_PER_US);
        if instance != NONE || begun.is_err() {
            self.end_tasks(board, &taken, delay_ticks, begun, step);
        }
        if self.from_background.ready() || self.tasks.look_for_jobs() {
            self.change_jobs(taken.slot, taken.start_us);
        }
        let now_ticks = board.now_low_ticks();
        let took_ticks = now_ticks
            .wrapping_sub(start_ticks)
            .wrapping_sub(delay_ticks);
        self.count_time::<B>(took_ticks);
        if self.mode == Mode::Running {
            let duration_ticks = duration_us.saturating_mul(B::TICKS_PER_US);
            self.count_execution(board, taken.slot, delay_ticks, took_ticks, duration_ticks);
        }
        self.make_next_ready::<B>(taken.start_us, now_ticks)
    }

    /// Does what comes after the execution of a slot's first enabled task: takes over what it did, and executes those that follow. There was no
    /// execution if the occurrence could not begin.
    #[inline(never)]
    fn end_tasks<B: Board>(
        &mut self,
        board: &mut B,
        taken: &dispatcher::Occurrence,
        delay_ticks: u32,
        begun: Result<(), SafeReason>,
        step: Option<Step>,
    ) {
        if let Err(reason) = begun {
            self.fail_safe(board, reason);
            return;
        }
        let Ready {
            start_ticks,
            duration_us,
            instance,
            ..
        } = self.ready;
        let duration_ticks = duration_us.saturating_mul(B::TICKS_PER_US);
        self.end_task(
            board,
            instance,
            step,
            start_ticks.wrapping_add(delay_ticks),
            duration_ticks,
        );
        if let Some(next) = self.tasks.next_in_slot(instance) {
            let period_us = self.dispatcher.period_us(taken.slot);
            self.execute_tasks(board, Some(next), taken.start_us, period_us, duration_ticks);
        }
    }

    /// Makes the next occurrence ready after one that was on time, and returns its start, which is when to be called again. `None` if it is
    /// due already or far away, or if there is something else to do first: a letter waits, or the whole clock was not looked at for long.
    #[inline(always)]
    fn make_next_ready<B: Board>(&mut self, start_us: u64, now_ticks: u32) -> Option<NonZeroU64> {
        const NEAR_US: u64 = 2 * IDLE_POLL_US as u64;
        let look_ticks = LOOK_US.saturating_mul(B::TICKS_PER_US);
        if self.from_link.ready() || now_ticks.wrapping_sub(self.looked_ticks) >= look_ticks {
            return None;
        }
        let next = self.dispatcher.next();
        if next.start_us - start_us > NEAR_US {
            return None;
        }
        let mission = self.mission.as_ref()?;
        if WARM
            && next.slot == mission.interpreter_slot
            && (self.waiting.is_some()
                || self.trial.is_some()
                || self.signs.mission_is_coming.load(Ordering::Relaxed))
        {
            return None;
        }
        let start_ticks = mission.origin.ticks + ticks::<B>(next.start_us);
        let wait_ticks = (start_ticks as u32).wrapping_sub(now_ticks) as i32;
        if wait_ticks <= 0 {
            return None;
        }
        self.make_ready::<B>(next, start_ticks as u32);
        NonZeroU64::new(start_ticks)
    }

    /// Makes the dispatcher's next occurrence ready, if it is one to be ready for: not the interpreter's, and the first enabled task of its slot, if
    /// there is one, can be executed. Its start is near, so that the low half of the clock tells whether it is due.
    #[inline(always)]
    pub(super) fn make_ready<B: Board>(&mut self, next: dispatcher::Occurrence, start_ticks: u32) {
        /// Less than half a round of the clock, so that one that has gone half around is not taken for one that is late.
        const LONGEST_WINDOW_US: u32 = i32::MAX as u32 / u16::MAX as u32;
        self.ready.window_ticks = 0;
        let Some(mission) = &self.mission else { return };
        let Some(entry) = self.tasks.lists.slots.get(next.slot) else {
            return;
        };
        if self.mode != Mode::Running || next.slot == mission.interpreter_slot {
            return;
        }
        let duration_us = entry.duration_us();
        let first = entry.first_task();
        let period_us = self.dispatcher.period_us(next.slot);
        self.ready.instance = NONE;
        if let Some(first) = first
            && !self.make_first_task_ready(first, next.start_us, period_us)
        {
            return;
        }
        self.ready.start_ticks = start_ticks;
        self.ready.duration_us = duration_us;
        self.ready.window_ticks = period_us.min(LONGEST_WINDOW_US) * B::TICKS_PER_US;
    }

    /// Makes the first enabled task of a slot ready, from this one on, if there is one. False if it cannot be executed.
    #[inline(never)]
    fn make_first_task_ready(&mut self, first: u16, start_us: u64, period_us: u32) -> bool {
        let Some(instance) = self.first_enabled(first) else {
            return true;
        };
        self.ready.instance = instance;
        self.make_task_ready(instance, start_us, period_us)
    }
}
