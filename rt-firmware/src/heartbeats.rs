//! What the sides of a runtime show of themselves: to supervision, and to each other.

use core::sync::atomic::{
    AtomicBool, AtomicU32,
    Ordering::{Acquire, Relaxed, Release},
};

use crate::signal::Signal;
use crate::stops::Stops;
use crate::task_word::TaskWord;

/// What sides that are not the real-time side show of themselves.
pub(crate) struct Heartbeats {
    /// The link had its turn.
    pub(crate) link: AtomicBool,
    /// The idle loop went round.
    pub(crate) background: AtomicBool,
    /// Requests that arrived whole; wraps.
    pub(crate) requests: AtomicU32,
    /// How long slots have run, in microseconds; wraps. What came after that was settled is
    /// counted in ticks. Both are the real-time side's; others ask [`slots_us`](Self::slots_us).
    pub(crate) slots_us: AtomicU32,
    pub(crate) slots_ticks: AtomicU32,
    ticks_per_us: AtomicU32,
    /// How long the link has worked, in microseconds, the time that slots took from it not
    /// included; wraps. The link's.
    pub(crate) link_us: AtomicU32,
    /// The real-time side is to look, at the end of a slot, at more than the next one: a background
    /// run has ended or may begin, a command has come, or a task has failed.
    pub(crate) attention: Signal,
    /// Wishes that the robot stops.
    pub(crate) stops: Stops,
    /// An emergency stop is latched. Set by whoever wants one, cleared by the real-time side alone,
    /// which looks before each exchange with the body.
    pub(crate) emergency_stop: AtomicBool,
    /// The button that latches one is pressed; looked at while one is latched.
    pub(crate) stop_pressed: AtomicBool,
    /// The link prepares a mission, or has asked for one to take over.
    pub(crate) mission_is_coming: AtomicBool,
    /// The task that is executed, where no RAM outlasts a reset: so slots write it down without a
    /// question.
    pub(crate) task: TaskWord,
}

impl Heartbeats {
    pub(crate) const fn new() -> Self {
        Heartbeats {
            link: AtomicBool::new(false),
            background: AtomicBool::new(false),
            requests: AtomicU32::new(0),
            slots_us: AtomicU32::new(0),
            slots_ticks: AtomicU32::new(0),
            ticks_per_us: AtomicU32::new(0),
            link_us: AtomicU32::new(0),
            attention: Signal::new(),
            stops: Stops::new(),
            emergency_stop: AtomicBool::new(false),
            stop_pressed: AtomicBool::new(false),
            mission_is_coming: AtomicBool::new(false),
            task: TaskWord::new(),
        }
    }

    /// How long slots have run, in microseconds; wraps.
    pub(crate) fn slots_us(&self) -> u32 {
        loop {
            let settled_us = self.slots_us.load(Acquire);
            let ticks = self.slots_ticks.load(Acquire);
            // Settled meanwhile: the ticks may be in what was read first, or not. The next attempt
            // meets nothing of the kind, since slots are further apart than this takes.
            if self.slots_us.load(Relaxed) == settled_us {
                return settled_us.wrapping_add(ticks / self.ticks_per_us.load(Relaxed).max(1));
            }
        }
    }

    /// Moves the ticks that were counted of slots to their microseconds. For the real-time side.
    pub(crate) fn settle_slots(&self, ticks_per_us: u32) {
        let ticks = self.slots_ticks.load(Relaxed);
        let us = ticks.checked_div(ticks_per_us).unwrap_or(0);
        self.ticks_per_us.store(ticks_per_us, Relaxed);
        self.slots_us
            .store(self.slots_us.load(Relaxed).wrapping_add(us), Relaxed);
        self.slots_ticks
            .store(ticks.wrapping_sub(us * ticks_per_us), Release);
    }

    /// Whether an emergency stop is latched.
    pub(crate) fn is_emergency_stopped(&self) -> bool {
        self.emergency_stop.load(Acquire)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_of_slots_is_told_whole_before_and_after_it_is_settled() {
        let heartbeats = Heartbeats::new();
        heartbeats.settle_slots(50);
        let mut ticks: u32 = 0;
        for took in [49, 1, 120, 49, 1_000_000] {
            ticks += took;
            heartbeats
                .slots_ticks
                .store(heartbeats.slots_ticks.load(Relaxed) + took, Relaxed);
            assert_eq!(heartbeats.slots_us(), ticks / 50);
            heartbeats.settle_slots(50);
            assert_eq!(heartbeats.slots_us(), ticks / 50);
            assert!(heartbeats.slots_ticks.load(Relaxed) < 50);
        }
    }
}
