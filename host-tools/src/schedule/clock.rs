//! How long a search may go on.

use std::time::Duration;

use crate::work_time;

/// Looks at the time now and then: at that which this thread has worked, so that a search finds on a loaded machine what it finds on an idle one.
#[derive(Debug)]
pub(super) struct Clock {
    end: Option<Duration>,
    ticks: u32,
    /// As much work may still be done.
    ticks_left: u64,
    is_over: bool,
}

impl Clock {
    /// A clock that runs out after `limit`, and never, where that is beyond what can be told.
    pub(super) fn new(limit: Duration) -> Self {
        Clock {
            end: work_time::taken().checked_add(limit),
            ticks: 0,
            ticks_left: u64::MAX,
            is_over: false,
        }
    }

    /// The clock, which also runs out after so many small pieces of work: the same ones in every run.
    pub(super) fn with_ticks(self, ticks_left: u64) -> Self {
        Clock { ticks_left, ..self }
    }

    /// As many small pieces of work may still be done.
    pub(super) fn ticks_left(&self) -> u64 {
        self.ticks_left
    }

    /// Whether the time had run out when it was last looked at.
    pub(super) fn is_over(&self) -> bool {
        self.is_over
    }

    /// Counts a small piece of work. Gives whether the time has run out.
    pub(super) fn tick(&mut self) -> bool {
        self.tick_many(1)
    }

    /// Counts work worth as many small pieces.
    pub(super) fn tick_many(&mut self, pieces: u32) -> bool {
        const TICKS_PER_LOOK: u32 = 4_096;
        self.ticks = self.ticks.saturating_add(pieces);
        self.ticks_left = self.ticks_left.saturating_sub(pieces.into());
        self.is_over |= self.ticks_left == 0;
        if self.ticks >= TICKS_PER_LOOK {
            self.ticks = 0;
            self.is_over |= (self.end).is_some_and(|end| work_time::taken() >= end);
        }
        self.is_over
    }
}
