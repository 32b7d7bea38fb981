//! The mission that runs, its trial, the activation that is executed, and the next one.

use esm_core::dispatcher::Near;
use esm_core::tables::Tables;
use esm_core::{BlobBuffer, Interpreter};

use super::staging::StoppedMission;
use super::tasks::NONE;
use esm_link::message::SafeReason;
use esm_link::trial::FallBackReason;

/// The mission that runs.
pub(super) struct Mission<'m> {
    pub(super) interpreter: Interpreter<'m, BlobBuffer<'m>>,
    /// What the starts of its slots are counted from.
    pub(super) origin: Origin,
    /// Its first macro step, which its own time is counted from, since the origin.
    pub(super) began_us: u64,
    /// What the time of its tasks was then: 0, or what it was in the mission that it took over
    /// from.
    pub(super) tasks_us: u64,
    /// Activations of all slots so far.
    pub(super) activations: u64,
    /// Number of the next macro step.
    pub(super) next_step: u64,
    /// Nominal start of the last macro step, on the robot's clock; of the first one, before that.
    pub(super) step_us: u64,
    /// The slot that runs the interpreter.
    pub(super) interpreter_slot: usize,
}

impl Mission<'_> {
    /// The time of the mission's tasks at a nominal start since the origin.
    pub(super) fn t_us(&self, start_us: u64) -> u64 {
        self.tasks_us + start_us.saturating_sub(self.began_us)
    }

    /// The same, of an activation of this mission: none starts before its first macro step.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn t_us_of_activation(&self, start_us: u64) -> u64 {
        start_us
            .wrapping_sub(self.began_us)
            .wrapping_add(self.tasks_us)
    }

    /// The time on the robot's clock at a nominal start since the origin.
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
        let period_us = interpreter_period_us(&self.interpreter.tables());
        let since_us = u32::try_from(robot_us.saturating_sub(self.step_us)).unwrap_or(u32::MAX);
        let steps = u64::from(since_us.checked_div(period_us).unwrap_or(0)) + 1;
        self.step_us + steps * u64::from(period_us)
    }

    /// Its origin, and the interpreter's period: what the slots of another mission go on with.
    pub(super) fn running(&self) -> (Origin, u32) {
        (
            self.origin,
            interpreter_period_us(&self.interpreter.tables()),
        )
    }
}

/// What the starts of slots are counted from: the first macro step of a mission that started from
/// standing still. It stays where it is as long as missions follow one another whose interpreter
/// slots have one period.
#[derive(Clone, Copy)]
pub(super) struct Origin {
    /// On the board's clock.
    pub(super) ticks: u64,
    /// Since the first macro step of the first mission.
    pub(super) us: u64,
}

/// Period of the interpreter's slot in microseconds.
pub(super) fn interpreter_period_us(tables: &Tables<'_>) -> u32 {
    tables
        .slot(tables.interpreter_slot())
        .map_or(0, |slot| slot.period_us)
}

/// What is known of the mission that runs while it is on trial.
pub(super) struct Trial<'m> {
    /// The mission before, to fall back to.
    pub(super) before: Option<StoppedMission<'m>>,
    /// Why the robot was in its safe state then, if it was.
    pub(super) safe: Option<SafeReason>,
    /// When it ends, in microseconds since the first macro step of the first mission.
    pub(super) until_us: u64,
    /// Why it has failed: the robot falls back at the interpreter's next activation.
    pub(super) failed: Option<SafeReason>,
}

impl Trial<'_> {
    /// Why the robot falls back now, if it does.
    pub(super) fn end_at(&self, now_us: u64) -> Option<FallBackReason> {
        match self.failed {
            Some(reason) => Some(FallBackReason::Failed(reason)),
            None => (now_us >= self.until_us).then_some(FallBackReason::NotConfirmed),
        }
    }

    pub(super) fn is_over(&self, now_us: u64) -> bool {
        self.end_at(now_us).is_some()
    }
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
/// them by [`settle`](super::RealTime::settle).
#[derive(Clone, Copy)]
pub(super) struct Next {
    /// Nominal start on the board's clock, low half.
    pub(super) start_ticks: u32,
    /// For how long from then it is on time; 0 where nothing is looked up.
    pub(super) window_ticks: u32,
    /// The activation before; where [`ended`](Self::ended) is not 0.
    pub(super) before: Near,
    /// Activations that have ended since this was settled.
    pub(super) ended: u32,
    /// The base of the dispatcher's queue on the board's clock, low half.
    pub(super) base_ticks: u32,
    /// Starts from here on, counted from that base, wait for a look at the whole clock.
    pub(super) look_us: u32,
    /// The slot that runs the interpreter.
    pub(super) interpreter_slot: usize,
    /// The slot's first enabled task instance, which was prepared; where one was.
    pub(super) instance: u16,
    /// Tasks were executed, after which a background run may begin or the robot may have to stop.
    pub(super) has_executed: bool,
}

impl Next {
    pub(super) const NOTHING: Next = Next {
        start_ticks: 0,
        window_ticks: 0,
        before: Near::BASE,
        ended: 0,
        base_ticks: 0,
        look_us: 0,
        interpreter_slot: 0,
        instance: NONE,
        has_executed: false,
    };
}
