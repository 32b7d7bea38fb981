//! How long a search may go on.

use std::fmt;
use std::time::Duration;

/// A function that tells how much time has passed, of a clock that the caller chooses, from any
/// moment on.
pub type Now = fn() -> Duration;

/// How long a search may last, and by which clock. Where none is at hand, there is
/// [`Limit::pieces`].
#[derive(Clone, Copy, Debug)]
pub struct Limit {
    time: Duration,
    now: Option<Now>,
    pieces: u64,
}

impl Limit {
    /// So much time by this clock: that of the thread's work finds on a loaded machine what it
    /// finds on an idle one, that on the wall is for a person who waits.
    pub fn new(time: Duration, now: Now) -> Self {
        Limit {
            time,
            now: Some(now),
            pieces: u64::MAX,
        }
    }

    /// So many small pieces of work: the same ones in every run, whatever the machine.
    pub fn pieces(pieces: u64) -> Self {
        Limit {
            time: Duration::MAX,
            now: None,
            pieces,
        }
    }

    /// The time; [`Duration::MAX`] where work is counted instead.
    pub fn time(self) -> Duration {
        self.time
    }

    /// The same clock with another time.
    pub(super) fn with_time(self, time: Duration) -> Self {
        Limit { time, ..self }
    }

    /// What its clock tells.
    pub(super) fn passed(self) -> Duration {
        self.now.map_or(Duration::ZERO, |now| now())
    }
}

impl fmt::Display for Limit {
    /// `in 10 s`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.now {
            Some(_) => write!(f, "in {} s", self.time.as_secs_f32()),
            None => write!(f, "in {} steps", self.pieces),
        }
    }
}

/// Tests measure the work of their thread.
#[cfg(test)]
impl From<Duration> for Limit {
    fn from(work: Duration) -> Self {
        Limit::new(work, crate::work_time::taken)
    }
}

/// Small pieces of work between two looks at the time.
const TICKS_PER_LOOK: u32 = 4_096;

/// Looks at the time now and then.
#[derive(Debug)]
pub(super) struct Clock {
    /// The clock, and what it tells when the time has run out.
    end: Option<(Now, Duration)>,
    ticks: u32,
    /// As much work may still be done.
    ticks_left: u64,
    is_over: bool,
}

impl Clock {
    /// A clock that runs out after `limit`, and never, where that is beyond what can be told.
    pub(super) fn new(limit: impl Into<Limit>) -> Self {
        let limit = limit.into();
        let end = (limit.now).and_then(|now| Some((now, now().checked_add(limit.time)?)));
        Clock {
            end,
            ticks: 0,
            ticks_left: limit.pieces,
            is_over: false,
        }
    }

    /// A clock that runs out after so many small pieces of work.
    pub(super) fn of_pieces(pieces: u64) -> Self {
        Self::new(Limit::pieces(pieces))
    }

    /// The clock, which also runs out after so many small pieces of work: the same ones in every
    /// run.
    #[cfg(test)]
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
            self.is_over |= self.end.is_some_and(|(now, end)| now() >= end);
        }
        self.is_over
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    thread_local! {
        static TOLD: Cell<Duration> = const { Cell::new(Duration::ZERO) };
    }

    fn told() -> Duration {
        TOLD.get()
    }

    #[test]
    fn a_limit_is_over_when_its_clock_says_so_or_its_work_is_done() {
        const LIMIT: Duration = Duration::from_millis(200);
        let is_over = |limit: Limit, passed: Duration| {
            TOLD.set(Duration::from_secs(1));
            let mut clock = Clock::new(limit);
            TOLD.set(Duration::from_secs(1) + passed);
            clock.tick_many(TICKS_PER_LOOK)
        };
        let timed = Limit::new(LIMIT, told);
        assert!(!is_over(timed, LIMIT - Duration::from_nanos(1)));
        assert!(is_over(timed, LIMIT));
        assert!(!is_over(Limit::new(Duration::MAX, told), LIMIT));
        let pieces = u64::from(TICKS_PER_LOOK);
        assert!(is_over(Limit::pieces(pieces), Duration::ZERO));
        assert!(!is_over(Limit::pieces(pieces + 1), LIMIT));
    }
}
