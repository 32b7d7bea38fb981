//! What a machine says of itself: transitions, tasks that begin and end, faults.

/// Why a machine was stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// A transition sent an event for which the queue had no room. The queue's capacity is too
    /// small, or events cause each other in a circle.
    EventQueueOverflow,
    /// A macro step had more than [`MAX_MICRO_STEPS`] events. Events cause each other in a circle.
    MacroStepLimit,
}

impl Fault {
    /// The name of the fault in traces and messages.
    #[must_use]
    pub const fn code(self) -> &'static str {
        match self {
            Self::EventQueueOverflow => "event-queue-overflow",
            Self::MacroStepLimit => "macro-step-limit",
        }
    }
}

/// The most micro steps of a macro step.
pub const MAX_MICRO_STEPS: u8 = 255;

/// A transition that was taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TransitionTaken {
    /// The micro step, from 0 in each macro step.
    pub micro: u8,
    /// The region instance that took it.
    pub region_instance: u16,
    /// The transition in the tables.
    pub transition: u16,
}

/// Watches a macro step from inside. Its methods do nothing unless implemented.
pub trait Observer {
    /// A transition was taken: its actions are done, its target is current.
    fn transition(&mut self, taken: TransitionTaken) {
        let _ = taken;
    }

    /// A task state was entered: its task is enabled anew. For a background task the run of an
    /// earlier activation may still go on.
    fn enabled(&mut self, task_instance: u16) {
        let _ = task_instance;
    }

    /// A task that was enabled is so no more, because its state or one around it was left. Not
    /// called for background tasks.
    fn disabled(&mut self, task_instance: u16) {
        let _ = task_instance;
    }
}

/// Watches nothing.
impl Observer for () {}

/// What a macro step did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepSummary {
    /// Its number, from 0.
    pub step: u64,
    /// Microseconds from one macro step to the next.
    pub period_us: u32,
    /// Events that were handled, the pulse included.
    pub micro_steps: u8,
    /// Whether any transition was taken.
    pub changed: bool,
    /// Whether a region of the machine has reached `final`, now or before.
    pub finished: bool,
}

impl StepSummary {
    /// Its time: microseconds since the first macro step. Where that is more than 64 bits can hold,
    /// after half a million years, time stands still there.
    #[must_use]
    #[inline]
    pub fn t_us(&self) -> u64 {
        self.step.saturating_mul(u64::from(self.period_us))
    }
}
