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

use core::sync::atomic::Ordering;

use esm_core::dispatcher::Near;
use esm_core::{Fault, dispatcher};

use super::running::{Activation, Next, Origin};
use super::slots::SlotEntry;
use super::tasks::NONE;
use super::trace::StepObserver;
use super::{IDLE_POLL_US, RealTime};
use crate::board::{ActivationStart, Board, ticks, ticks_between};
use crate::features::{SPEED, WARM};
use esm_link::message::{Mode, SafeReason};

/// How long activations may follow one another, each looked up after the one before, without a look
/// at the whole clock.
const LOOK_US: u32 = 100_000;
/// What starts later than this after the activation before is not looked up: who waits for so long
/// is looked at meanwhile.
const NEAR_US: u32 = 2 * IDLE_POLL_US;

/// For how long an activation is on time, where this is the shortest period of all slots. What
/// begins later than that may have been missed.
#[cfg_attr(feature = "speed", inline(always))]
fn mission_window<B: Board>(shortest_period_us: u32) -> u32 {
    /// Less than half a round of the clock, so that one that has gone half around is not taken for
    /// one that is late.
    const LONGEST_WINDOW_US: u32 = i32::MAX as u32 / u16::MAX as u32;
    // A start lies so far ahead at most, and the timer may ask for it early.
    const {
        assert!(
            1u64 << B::COUNT_BITS > 4 * IDLE_POLL_US as u64 * B::TICKS_PER_US as u64,
            "the counter of the clock comes round too soon: see `Board::COUNT_BITS`"
        );
    }
    let window_ticks = shortest_period_us.min(LONGEST_WINDOW_US) * B::TICKS_PER_US;
    window_ticks.min(1 << (B::COUNT_BITS - 1))
}

impl RealTime<'_, '_> {
    /// Executes all that is due, and returns when to be called again, in ticks of the board's
    /// clock. To be called from the slot timer's interrupt, first at any time. Being called early
    /// does no harm.
    #[cfg_attr(feature = "speed", inline(always))]
    pub fn on_timer<B: Board>(&mut self, board: &mut B) -> u64 {
        // Nothing comes before this: it is what the delay of a slot is made of.
        let began_count = board.count();
        let delay_ticks = ticks_between::<B>(self.next.start_ticks, began_count);
        if delay_ticks >= self.next.window_ticks || self.is_stop_wanted(board) {
            return self.go_on(board, false);
        }
        let start = self.next_start::<B>();
        if let Err(reason) = board.begin_activation(&start) {
            return self.begin_in_vain(board, &start, delay_ticks, reason);
        }
        if self.executor.is_prepared() {
            self.execute_near(board, began_count);
        }
        let both = if SPEED {
            self.dispatcher.take_near()
        } else {
            None
        };
        let Some((taken, next)) = both else {
            return self.end_far(board, began_count, delay_ticks);
        };
        self.next.ended += 1;
        self.next.before = taken;
        let took_ticks = if self.heartbeats.attention.is_set() {
            match self.end_attentively(board, began_count, delay_ticks, taken) {
                Some(took_ticks) => took_ticks,
                None => return self.go_on(board, true),
            }
        } else {
            let took_ticks = ticks_between::<B>(began_count, board.count());
            self.count_near(board, taken, delay_ticks, took_ticks);
            took_ticks
        };
        if !self.look_up_near(board, taken, next, delay_ticks.wrapping_add(took_ticks)) {
            return self.go_on(board, true);
        }
        self.next_start_ticks::<B>()
    }

    /// Executes the tasks of an activation that was looked up.
    #[cfg_attr(feature = "speed", inline(always))]
    fn execute_near<B: Board>(&mut self, board: &mut B, began_count: u32) {
        let slot = |this: &Self| this.dispatcher.next().slot;
        self.execute_tasks(board, self.next.instance, began_count, slot);
        // A background run may lack what a task has just published.
        if self.tasks.look_for_runs() || self.failure.is_some() {
            self.next.has_executed = true;
            self.heartbeats.attention.set();
        }
    }

    /// Ends and counts an activation that was looked up, after which more is to be looked at than
    /// the next one. Returns what it took; `None` if there is a command.
    #[cold]
    #[inline(never)]
    fn end_attentively<B: Board>(
        &mut self,
        board: &mut B,
        began_count: u32,
        delay_ticks: u32,
        taken: Near,
    ) -> Option<u32> {
        self.heartbeats.attention.take_back();
        let has_executed = core::mem::take(&mut self.next.has_executed);
        if self.from_background.ready() || has_executed && self.tasks.look_for_runs() {
            self.settle();
            let start_us = self.dispatcher.base_us() + u64::from(taken.since_us());
            self.change_runs(taken.slot(), start_us);
        }
        let took_ticks = ticks_between::<B>(began_count, board.count());
        self.count_near(board, taken, delay_ticks, took_ticks);
        self.look_for_failure(board);
        (!self.from_link.ready()).then_some(took_ticks)
    }

    /// Counts an activation that was looked up.
    #[cfg_attr(feature = "speed", inline(always))]
    fn count_near(
        &mut self,
        board: &mut impl Board,
        taken: Near,
        delay_ticks: u32,
        took_ticks: u32,
    ) {
        self.count_time(took_ticks);
        self.count_execution(board, taken.slot(), delay_ticks, took_ticks);
    }

    /// Duration of a slot in microseconds.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn duration_us(&self, slot: usize) -> u32 {
        let slot = self.tasks.lists.slots.get(slot);
        slot.map_or(0, SlotEntry::duration_us)
    }

    /// When the activation starts that was looked up. A board that asks for the low half alone does
    /// no arithmetic for it.
    #[cfg_attr(feature = "speed", inline(always))]
    fn next_start_ticks<B: Board>(&self) -> u64 {
        const LOW: u64 = u32::MAX as u64;
        let whole = match &self.mission {
            Some(mission) => mission.origin.ticks + ticks::<B>(self.dispatcher.next().start_us),
            None => 0,
        };
        whole & !LOW | u64::from(self.next.start_ticks)
    }

    /// Ends an activation of a slot whose next start is far away.
    #[cold]
    #[inline(never)]
    fn end_far<B: Board>(&mut self, board: &mut B, began_count: u32, delay_ticks: u32) -> u64 {
        self.settle();
        let taken = self.dispatcher.next();
        self.dispatcher.take_on_time();
        self.end(taken.start_us, self.duration_us(taken.slot));
        if self.from_background.ready() || self.tasks.look_for_runs() {
            self.change_runs(taken.slot, taken.start_us);
        }
        let took_ticks = ticks_between::<B>(began_count, board.count());
        self.count_time(took_ticks);
        self.count_execution(board, taken.slot, delay_ticks, took_ticks);
        self.look_for_failure(board);
        self.go_on(board, true)
    }

    /// What a board is told of the next activation.
    #[cfg_attr(feature = "speed", inline(always))]
    fn next_start<B: Board>(&self) -> ActivationStart {
        let dispatcher::Activation { slot, start_us } = self.dispatcher.next();
        let (origin, number) =
            self.mission
                .as_ref()
                .map_or((Origin { ticks: 0, us: 0 }, 0), |mission| {
                    (
                        mission.origin,
                        mission.activations + u64::from(self.next.ended),
                    )
                });
        let since_us = origin.us + start_us;
        let previous_end_us = match self.next.ended {
            0 => self.previous_end_us,
            _ => origin.us + self.before_end_us(),
        };
        ActivationStart {
            slot,
            number,
            start_us: since_us,
            start_ticks: origin.ticks + ticks::<B>(start_us),
            previous_end_us: previous_end_us.min(since_us),
            interpreter: false,
        }
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
        self.settle();
        let taken = self.dispatcher.next();
        self.dispatcher.take_on_time();
        self.end(taken.start_us, self.duration_us(taken.slot));
        self.count_delay::<B>(delay_ticks);
        self.fail_safe(board, reason);
        self.count_time(
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

    /// An activation is over, as far as whoever asks for the time is concerned.
    #[cfg_attr(feature = "speed", inline(always))]
    fn end(&mut self, start_us: u64, duration_us: u32) {
        if let Some(mission) = &mut self.mission {
            mission.activations += 1;
            self.previous_end_us = mission.robot_us(start_us) + u64::from(duration_us);
        }
    }

    /// Nominal end of the activation before the one that was looked up, since the origin.
    #[cfg_attr(feature = "speed", inline(always))]
    fn before_end_us(&self) -> u64 {
        let before = self.next.before;
        let start_us = self.dispatcher.base_us() + u64::from(before.since_us());
        start_us + u64::from(self.duration_us(before.slot()))
    }

    /// Works out what was counted in 32 bits of the activations that were looked up: as long as the
    /// dispatcher's next one is what they left.
    pub(super) fn settle(&mut self) {
        let ended = core::mem::take(&mut self.next.ended);
        if SPEED && ended != 0 {
            let end_us = self.before_end_us();
            if let Some(mission) = &mut self.mission {
                mission.activations += u64::from(ended);
                self.previous_end_us = mission.robot_us(end_us);
            }
        }
    }

    /// Looks up the next activation after this one, which was on time, was looked up itself, and
    /// ended so many ticks after its nominal start. False if the next is due already or far away,
    /// or may be the first of another mission.
    #[cfg_attr(feature = "speed", inline(always))]
    fn look_up_near<B: Board>(
        &mut self,
        board: &mut B,
        taken: Near,
        next: Near,
        ended_ticks: u32,
    ) -> bool {
        let since_us = next.since_us();
        let wait_us = since_us - taken.since_us();
        if wait_us > NEAR_US
            || wait_us * B::TICKS_PER_US <= ended_ticks
            || since_us >= self.next.look_us && !self.look_at_clock(board, since_us)
        {
            return false;
        }
        let since_ticks = since_us.wrapping_mul(B::TICKS_PER_US);
        let start_ticks = self.next.base_ticks.wrapping_add(since_ticks);
        self.next.start_ticks = start_ticks;
        let slot = next.slot();
        if slot == self.next.interpreter_slot {
            self.next.window_ticks = 0;
            return !self.may_change_mission();
        }
        let Some(entry) = self.tasks.lists.slots.get(slot) else {
            return false;
        };
        let instance = entry.first_enabled();
        if instance != NONE {
            self.prepare_first(slot, instance);
        }
        true
    }

    /// Looks at the whole clock, which was not looked at for long, before the activation that
    /// starts so long after the dispatcher's base. False if there is more to be done.
    #[cold]
    #[inline(never)]
    fn look_at_clock<B: Board>(&mut self, board: &mut B, since_us: u32) -> bool {
        let began_count = board.count();
        let now_ticks = board.now_ticks();
        self.settle();
        self.look_for_stops(board);
        if self.waiting.is_some() || !self.is_running() {
            return false;
        }
        self.feed_watchdog(board, now_ticks);
        self.next.look_us = since_us + LOOK_US;
        self.count_time(ticks_between::<B>(began_count, board.count()));
        self.heartbeats.settle_slots(B::TICKS_PER_US);
        true
    }

    /// Whether the interpreter's next activation may be the first of another mission.
    #[inline(never)]
    fn may_change_mission(&self) -> bool {
        WARM && (self.waiting.is_some()
            || self.trial.is_some()
            || self.heartbeats.mission_is_coming.load(Ordering::Relaxed))
    }

    /// Looks up the dispatcher's next activation, which starts at this time, after a look at the
    /// whole clock.
    pub(super) fn look_up<B: Board>(&mut self, next: dispatcher::Activation, start_ticks: u64) {
        let Some(mission) = &self.mission else {
            return;
        };
        if next.slot == mission.interpreter_slot || !self.is_running() {
            return;
        }
        let Some(entry) = self.tasks.lists.slots.get(next.slot) else {
            return;
        };
        let base_us = self.dispatcher.base_us();
        let base_ticks = mission.origin.ticks + ticks::<B>(base_us);
        // The look was at most a few milliseconds ago, and the next one starts soon.
        let near_us = (next.start_us - base_us) as u32;
        let instance = entry.first_enabled();
        self.next = Next {
            start_ticks: start_ticks as u32,
            window_ticks: mission_window::<B>(self.shortest_period_us),
            base_ticks: base_ticks as u32,
            look_us: near_us + LOOK_US,
            interpreter_slot: mission.interpreter_slot,
            ..Next::NOTHING
        };
        self.executor.forget();
        if instance != NONE {
            self.prepare_first(next.slot, instance);
        }
    }

    /// Prepares the first task of an activation. Where it cannot be executed, the activation is not
    /// looked up.
    #[inline(never)]
    fn prepare_first(&mut self, slot: usize, instance: u16) {
        self.next.instance = instance;
        if let Some(mission) = &self.mission {
            let start_us = self.dispatcher.next().start_us;
            let period_us = self.dispatcher.period_us(slot);
            self.executor.begin(
                mission.t_us_of_activation(start_us),
                mission.robot_us(start_us),
                period_us,
            );
        }
        if !self.prepare_task(instance) {
            self.next.window_ticks = 0;
        }
    }

    /// What was looked up is so no more.
    pub(super) fn forget_next(&mut self) {
        self.settle();
        self.pass_over_next();
    }

    /// The same, with what was counted to be [settled](Self::settle) later: each instruction here
    /// makes a macro step later.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn pass_over_next(&mut self) {
        self.next.window_ticks = 0;
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
        let Some(mission) = &self.mission else {
            return;
        };
        let start_us = mission.robot_us(activation.start_us);
        let t_us = mission.t_us(activation.start_us);
        let start = ActivationStart {
            slot: activation.slot,
            number: activation.number,
            start_us,
            start_ticks,
            previous_end_us: self.previous_end_us.min(start_us),
            interpreter: activation.interpreter,
        };
        let duration_us = self.duration_us(activation.slot);
        self.end(activation.start_us, duration_us);
        self.count_delay::<B>(delay_ticks);
        if self.mode == Mode::EmergencyStopped {
            self.hold_still(board);
        }
        if let Err(reason) = board.begin_activation(&start)
            && self.is_running()
        {
            self.fail_safe(board, reason);
        }
        self.take_run_back(Some(activation));
        if activation.interpreter {
            self.send_answered();
            self.listen(start_us);
            if self.is_running() {
                self.macro_step(board, start_us);
            } else {
                board.motors_off();
            }
        }
        if self.is_running() {
            let period_us = self.dispatcher.period_us(activation.slot);
            self.executor.begin(t_us, start_us, period_us);
            let now_ticks = board.now_low_ticks();
            let slot = self.tasks.lists.slots.get(activation.slot);
            let first = slot.map_or(NONE, SlotEntry::first_enabled);
            if first != NONE {
                self.prepare_task(first);
                self.execute_tasks(board, first, now_ticks, |_| activation.slot);
            }
            if self.tasks.look_for_runs() {
                self.start_run(activation.start_us, activation.number);
            }
            let took_ticks = board.now_low_ticks().wrapping_sub(began_ticks as u32);
            self.count_execution(board, activation.slot, delay_ticks, took_ticks);
            self.look_for_failure(board);
        }
        if activation.interpreter {
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
