//! When slots start: the dispatcher, the activation that was looked up ahead, and what the time of
//! robot, mission and tasks is then.
//!
//! It knows times and numbers of slots, and nothing of what is in them.

use esm_core::dispatcher::{self, Near, SlotQueue};
use esm_core::tables::Tables;

use super::limits::IDLE_POLL_US;
use crate::board::{ActivationStart, Board, microseconds, ticks, ticks_between};
use crate::features::SPEED;

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

/// What the starts of slots are counted from: the first macro step of a mission that started from
/// standing still. It stays where it is as long as missions follow one another whose interpreter
/// slots have one period.
#[derive(Clone, Copy)]
pub(crate) struct Origin {
    /// On the board's clock.
    pub(super) ticks: u64,
    /// Since the first macro step of the first mission.
    pub(super) us: u64,
}

/// An activation that is being executed.
#[derive(Clone, Copy)]
pub(super) struct Activation {
    pub(super) slot: usize,
    /// Nominal start since the origin.
    pub(super) start_us: u64,
    pub(super) number: u64,
    pub(super) interpreter: bool,
}

/// The next activation, where it was looked up after the one before. It never is one of the
/// interpreter's, which begins with a macro step.
///
/// All that the timer's entry needs of a mission is bound here when the whole clock is looked at.
/// From one activation to the next only 32-bit numbers change. What has 64 bits is worked out from
/// them by [`settle`](Timetable::settle).
#[derive(Clone, Copy)]
struct Next {
    /// Nominal start on the board's clock, low half.
    start_ticks: u32,
    /// For how long from then it is on time; 0 where nothing is looked up.
    window_ticks: u32,
    /// The activation before; where [`ended`](Self::ended) is not 0.
    before: Near,
    /// Activations that have ended since this was settled.
    ended: u32,
    /// The base of the dispatcher's queue on the board's clock, low half.
    base_ticks: u32,
    /// Starts from here on, counted from that base, wait for a look at the whole clock.
    look_us: u32,
    /// Starts from here on may wait for that look, or be the interpreter's. No earlier one does.
    rare_us: u32,
}

impl Next {
    const NOTHING: Next = Next {
        start_ticks: 0,
        window_ticks: 0,
        before: Near::BASE,
        ended: 0,
        base_ticks: 0,
        look_us: 0,
        rare_us: 0,
    };
}

/// The starts of the mission's slots, and its time.
pub(crate) struct Timetable<'m> {
    dispatcher: &'m mut SlotQueue,
    next: Next,
    origin: Origin,
    /// The mission's first macro step, since the origin.
    began_us: u64,
    /// What the time of the mission's tasks would have been at the origin. It is 0 in its first
    /// macro step, or what it was in the mission that it took over from.
    tasks_us: u64,
    /// Nominal start of the mission's last macro step, on the robot's clock; of the first one,
    /// before that.
    step_us: u64,
    /// Activations of all slots of the mission so far.
    activations: u64,
    /// Nominal end of the last activation, since the first macro step of the first mission.
    previous_end_us: u64,
    /// The slot that runs the interpreter.
    interpreter_slot: usize,
    /// Its next start is not before this, since the origin.
    interpreter_next_us: u64,
    /// Shortest period of the mission's slots, in microseconds.
    shortest_period_us: u32,
}

impl<'m> Timetable<'m> {
    pub(crate) fn new(dispatcher: &'m mut SlotQueue) -> Self {
        Timetable {
            dispatcher,
            next: Next::NOTHING,
            origin: Origin { ticks: 0, us: 0 },
            began_us: 0,
            tasks_us: 0,
            step_us: 0,
            activations: 0,
            previous_end_us: 0,
            interpreter_slot: 0,
            interpreter_next_us: 0,
            shortest_period_us: 0,
        }
    }

    /// A mission with these slots has its first macro step `at` this time. `running` is what was in
    /// its place until now: origin and interpreter's period, which the slots go on with if it is
    /// the new interpreter's, too. Its tasks' time is `tasks_us` then. Returns the longest period.
    pub(super) fn begin_mission(
        &mut self,
        tables: &Tables<'_>,
        running: Option<(Origin, u32)>,
        at: Origin,
        tasks_us: u64,
    ) -> u32 {
        self.interpreter_slot = tables.interpreter_slot();
        let period_us = tables.slot(self.interpreter_slot);
        let period_us = period_us.map_or(0, |slot| slot.period_us);
        let follows = running.filter(|(_, before_us)| *before_us == period_us);
        self.origin = follows.map_or(at, |(origin, _)| origin);
        self.began_us = at.us - self.origin.us;
        self.interpreter_next_us = self.began_us;
        self.tasks_us = tasks_us.wrapping_sub(self.began_us);
        self.step_us = at.us;
        self.activations = 0;
        // It was checked before that there is room for the slots, and verified that they have
        // periods.
        let refused = self.dispatcher.restart_at(tables.slots(), self.began_us);
        debug_assert!(refused.is_ok());
        // What starts with the interpreter, and before it in the order of the slots, has been.
        while follows.is_some()
            && self.dispatcher.next().slot != self.interpreter_slot
            && self.dispatcher.take(self.began_us).is_some()
        {}
        let longest = tables.slots().map(|slot| slot.period_us).max();
        let shortest = tables.slots().map(|slot| slot.period_us).min();
        self.shortest_period_us = shortest.unwrap_or(0);
        longest.unwrap_or(0)
    }

    /// The origin of the mission's slots, and its interpreter's period: what the slots of another
    /// mission go on with.
    pub(super) fn running(&self) -> (Origin, u32) {
        let period_us = self.dispatcher.period_us(self.interpreter_slot);
        (self.origin, period_us)
    }

    /// The activation that is next.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn next(&self) -> dispatcher::Activation {
        self.dispatcher.next()
    }

    /// The same, counted from the dispatcher's base.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn next_near(&self) -> Near {
        self.dispatcher.next_near()
    }

    /// What the time is at a nominal start since the origin.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn at<B: Board>(&self, start_us: u64) -> Origin {
        Origin {
            ticks: self.origin.ticks + ticks::<B>(start_us),
            us: self.robot_us(start_us),
        }
    }

    /// The robot time at a time of the board's clock, which is not before the origin.
    pub(super) fn robot_us_at<B: Board>(&self, clock_ticks: u64) -> u64 {
        let since_ticks = clock_ticks.saturating_sub(self.origin.ticks);
        self.robot_us(microseconds(since_ticks, B::TICKS_PER_US))
    }

    /// Whether this slot runs the interpreter.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn is_interpreters(&self, slot: usize) -> bool {
        slot == self.interpreter_slot
    }

    /// Activations of a slot that did not start within their period.
    pub(super) fn missed(&self, slot: usize) -> u32 {
        self.dispatcher.missed(slot)
    }

    /// Activations of the mission that were executed.
    pub(super) fn activations(&self) -> u64 {
        self.activations
    }

    /// Nominal end of the last activation, on the robot's clock.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn previous_end_us(&self) -> u64 {
        self.previous_end_us
    }

    /// Nominal start of the mission's last macro step, on the robot's clock.
    pub(super) fn step_us(&self) -> u64 {
        self.step_us
    }

    /// A macro step starts at this robot time.
    pub(super) fn begin_step(&mut self, robot_us: u64) {
        self.step_us = robot_us;
    }

    /// The time of the mission's tasks at a nominal start since the origin.
    pub(super) fn t_us(&self, start_us: u64) -> u64 {
        start_us.max(self.began_us).wrapping_add(self.tasks_us)
    }

    /// The same on the robot's clock.
    pub(super) fn t_us_at(&self, robot_us: u64) -> u64 {
        self.t_us(robot_us.saturating_sub(self.origin.us))
    }

    /// The time of the mission's tasks at the dispatcher's base, as long as that is counted from
    /// which is not before its first macro step, and the robot's.
    pub(super) fn base_times_us(&self) -> (u64, u64) {
        let base_us = self.dispatcher.base_us();
        (base_us.wrapping_add(self.tasks_us), self.robot_us(base_us))
    }

    /// The time on the robot's clock at a nominal start since the origin.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn robot_us(&self, start_us: u64) -> u64 {
        self.origin.us + start_us
    }

    /// The macro step, on the robot's clock, that notes the end of a background run that is taken
    /// back in this activation: its own, or else the next one.
    pub(super) fn noting_step_us(&self, activation: &Activation) -> u64 {
        let robot_us = self.robot_us(activation.start_us);
        if activation.interpreter {
            return robot_us;
        }
        let (_, period_us) = self.running();
        let since_us = u32::try_from(robot_us.saturating_sub(self.step_us)).unwrap_or(u32::MAX);
        let steps = u64::from(since_us.checked_div(period_us).unwrap_or(0)) + 1;
        self.step_us + steps * u64::from(period_us)
    }

    /// Takes the next activation from the dispatcher, so many microseconds late, and says how many
    /// before it were missed. None where none is due.
    pub(super) fn take(&mut self, late_us: u64) -> Option<(Activation, u32)> {
        let next = self.dispatcher.next();
        let missed_before = self.dispatcher.missed(next.slot);
        let taken = self.dispatcher.take(next.start_us + late_us)?;
        let missed = self
            .dispatcher
            .missed(taken.slot)
            .wrapping_sub(missed_before);
        let interpreter = self.is_interpreters(taken.slot);
        if interpreter {
            let period_us = self.dispatcher.period_us(taken.slot);
            self.interpreter_next_us = taken.start_us + u64::from(period_us);
        }
        let activation = Activation {
            slot: taken.slot,
            start_us: taken.start_us,
            number: self.activations,
            interpreter,
        };
        Some((activation, missed))
    }

    /// Takes an activation whose nominal start is before this time, if there is one, without that
    /// it is executed. Answers its slot, and how many were missed with it.
    pub(super) fn give_up_before(&mut self, start_us: u64) -> Option<(usize, u32)> {
        let last_us = start_us.checked_sub(1)?;
        let owed = self.dispatcher.next().slot;
        let before = self.dispatcher.missed(owed);
        self.dispatcher.take(last_us)?;
        let skipped = self.dispatcher.missed(owed).wrapping_sub(before);
        // It was handed out, but is not executed.
        Some((owed, skipped.saturating_add(1)))
    }

    /// How late the activation that was looked up begins, in ticks, and whether that is on time.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn delay<B: Board>(&self, began_count: u32) -> (u32, bool) {
        let delay_ticks = ticks_between::<B>(self.next.start_ticks, began_count);
        (delay_ticks, delay_ticks < self.next.window_ticks)
    }

    /// What a board is told of the activation that was looked up. `duration_us` gives that of a
    /// slot, here and below.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn next_start<B: Board>(
        &self,
        duration_us: impl FnOnce(usize) -> u32,
    ) -> ActivationStart {
        let dispatcher::Activation { slot, start_us } = self.dispatcher.next();
        let at = self.at::<B>(start_us);
        let previous_end_us = match self.next.ended {
            0 => self.previous_end_us,
            _ => self.robot_us(self.before_end_us(duration_us)),
        };
        ActivationStart {
            slot,
            number: self.activations + u64::from(self.next.ended),
            start_us: at.us,
            start_ticks: at.ticks,
            previous_end_us: previous_end_us.min(at.us),
            interpreter: false,
        }
    }

    /// When the next activation starts, whose low half is this. A board that asks for the low half
    /// alone does no arithmetic for it.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn whole_ticks<B: Board>(&self, start_ticks: u32) -> u64 {
        const LOW: u64 = u32::MAX as u64;
        let whole = self.at::<B>(self.dispatcher.next().start_us).ticks;
        whole & !LOW | u64::from(start_ticks)
    }

    /// Takes the activation that was looked up, which has ended. Returns it and the one after it;
    /// none, and nothing is done, where that one is [far](Self::take_far).
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn take_near(&mut self) -> Option<(Near, Near)> {
        if !SPEED {
            return None;
        }
        let both = self.dispatcher.take_near()?;
        self.next.ended += 1;
        self.next.before = both.0;
        Some(both)
    }

    /// Takes the activation that was looked up, whenever its slot starts next.
    pub(super) fn take_far(
        &mut self,
        duration_us: impl Fn(usize) -> u32,
    ) -> dispatcher::Activation {
        self.settle(&duration_us);
        let taken = self.dispatcher.next();
        self.dispatcher.take_on_time();
        self.end(taken.start_us, duration_us(taken.slot));
        taken
    }

    /// Nominal start, since the origin, of an activation that was looked up.
    pub(super) fn start_us(&self, taken: Near) -> u64 {
        self.dispatcher.base_us() + u64::from(taken.since_us())
    }

    /// An activation is over, as far as whoever asks for the time is concerned.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn end(&mut self, start_us: u64, duration_us: u32) {
        self.activations += 1;
        self.previous_end_us = self.robot_us(start_us) + u64::from(duration_us);
    }

    /// Nominal end of the activation before the one that was looked up, since the origin.
    #[cfg_attr(feature = "speed", inline(always))]
    fn before_end_us(&self, duration_us: impl FnOnce(usize) -> u32) -> u64 {
        let before = self.next.before;
        self.start_us(before) + u64::from(duration_us(before.slot()))
    }

    /// Works out what was counted in 32 bits of the activations that were looked up: as long as the
    /// dispatcher's next one is what they left.
    pub(super) fn settle(&mut self, duration_us: impl FnOnce(usize) -> u32) {
        let ended = core::mem::take(&mut self.next.ended);
        if SPEED && ended != 0 {
            self.activations += u64::from(ended);
            self.previous_end_us = self.robot_us(self.before_end_us(duration_us));
        }
    }

    /// Start of the activation after the one that was looked up, on the board's clock, low half.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn start_ticks<B: Board>(&self, next: Near) -> u32 {
        let since_ticks = next.since_us().wrapping_mul(B::TICKS_PER_US);
        self.next.base_ticks.wrapping_add(since_ticks)
    }

    /// Whether the activation with this start, after one that ended at this count, can be looked
    /// up: it is neither due nor far away.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn is_near<B: Board>(&self, start_ticks: u32, ended_count: u32) -> bool {
        let wait_ticks = ticks_between::<B>(ended_count, start_ticks);
        wait_ticks.wrapping_sub(1) < NEAR_US * B::TICKS_PER_US
    }

    /// Whether this activation may be the interpreter's, or wait for a look at the whole clock. No
    /// other is.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn is_rare(&self, next: Near) -> bool {
        next.since_us() >= self.next.rare_us
    }

    /// Whether the whole clock is to be looked at before this activation.
    pub(super) fn is_look_due(&self, next: Near) -> bool {
        next.since_us() >= self.next.look_us
    }

    /// The whole clock was looked at before this activation.
    pub(super) fn looked(&mut self, next: Near) {
        self.look_from(next.since_us() + LOOK_US);
    }

    /// The whole clock is to be looked at from here on, counted from the dispatcher's base.
    fn look_from(&mut self, look_us: u32) {
        let interpreter_us = self
            .interpreter_next_us
            .saturating_sub(self.dispatcher.base_us());
        self.next.look_us = look_us;
        self.next.rare_us = u64::from(look_us).min(interpreter_us) as u32;
    }

    /// The activation with this start is looked up.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn look_up_near(&mut self, start_ticks: u32) {
        self.next.start_ticks = start_ticks;
    }

    /// The dispatcher's next activation, which starts at this time, is looked up, after a look at
    /// the whole clock.
    pub(super) fn look_up<B: Board>(&mut self, start_ticks: u64) {
        let base_us = self.dispatcher.base_us();
        let base_ticks = self.origin.ticks + ticks::<B>(base_us);
        // The look was at most a few milliseconds ago, and the next one starts soon.
        let near_us = (self.dispatcher.next().start_us - base_us) as u32;
        self.next = Next {
            start_ticks: start_ticks as u32,
            window_ticks: mission_window::<B>(self.shortest_period_us),
            base_ticks: base_ticks as u32,
            ..Next::NOTHING
        };
        self.look_from(near_us + LOOK_US);
    }

    /// What was looked up is so no more. What was counted is [settled](Self::settle) later: each
    /// instruction here makes a macro step later.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn pass_over_next(&mut self) {
        self.next.window_ticks = 0;
    }
}
