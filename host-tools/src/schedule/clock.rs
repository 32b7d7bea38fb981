//! How long a search may go on.

use std::time::{Duration, Instant};

use crate::work_time;

/// How long a search may last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// So much time of work by its thread, so that it finds on a loaded machine what it finds on an
    /// idle one.
    Work(Duration),
    /// So much time on the wall clock, for a person who waits.
    Wall(Duration),
}

impl Limit {
    /// The time, of whichever clock.
    pub fn time(self) -> Duration {
        let (Limit::Work(time) | Limit::Wall(time)) = self;
        time
    }
}

impl From<Duration> for Limit {
    fn from(work: Duration) -> Self {
        Limit::Work(work)
    }
}

/// Small pieces of work between two looks at the time.
const TICKS_PER_LOOK: u32 = 4_096;

/// When a search is to end.
#[derive(Clone, Copy, Debug)]
enum End {
    Work(Duration),
    Wall(Instant),
    Never,
}

impl End {
    fn is_reached(self) -> bool {
        match self {
            End::Work(end) => work_time::taken() >= end,
            End::Wall(end) => Instant::now() >= end,
            End::Never => false,
        }
    }
}

/// Looks at the time now and then.
#[derive(Debug)]
pub(super) struct Clock {
    end: End,
    ticks: u32,
    /// As much work may still be done.
    ticks_left: u64,
    is_over: bool,
}

impl Clock {
    /// A clock that runs out after `limit`, and never, where that is beyond what can be told.
    pub(super) fn new(limit: impl Into<Limit>) -> Self {
        let end = match limit.into() {
            Limit::Work(limit) => work_time::taken().checked_add(limit).map(End::Work),
            Limit::Wall(limit) => Instant::now().checked_add(limit).map(End::Wall),
        };
        Clock {
            end: end.unwrap_or(End::Never),
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
        self.ticks = self.ticks.saturating_add(pieces);
        self.ticks_left = self.ticks_left.saturating_sub(pieces.into());
        self.is_over |= self.ticks_left == 0;
        if self.ticks >= TICKS_PER_LOOK {
            self.ticks = 0;
            self.is_over |= self.end.is_reached();
        }
        self.is_over
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_on_the_wall_ends_a_search_that_gets_no_processor() {
        const LIMIT: Duration = Duration::from_millis(200);
        let is_over = |limit: Limit| {
            let mut clock = Clock::new(limit);
            // As on a machine that gives its time to others.
            std::thread::sleep(LIMIT * 2);
            clock.tick_many(TICKS_PER_LOOK)
        };
        assert!(is_over(Limit::Wall(LIMIT)));
        assert!(!is_over(Limit::Work(LIMIT)));
        assert!(!is_over(Limit::Wall(Duration::MAX)));
    }
}
