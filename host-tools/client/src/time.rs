//! Clocks that searches are limited by.

use std::sync::OnceLock;
use std::time::{Duration, Instant};

use esm_toolkit::schedule::Limit;
use nix::time::{ClockId, clock_gettime};

/// Processor time that this thread has taken so far. A machine that is loaded, or stands still for
/// a while, makes work last longer, and does not make it more: so what is limited by this ends at
/// the same place on both.
pub fn work_taken() -> Duration {
    // Every thread has this clock.
    clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID).map_or(Duration::ZERO, Duration::from)
}

/// Time on the wall since this was first asked.
pub fn wall() -> Duration {
    static BEGAN: OnceLock<Instant> = OnceLock::new();
    BEGAN.get_or_init(Instant::now).elapsed()
}

/// At most so much work by the thread that searches.
pub fn work_limit(time: Duration) -> Limit {
    Limit::new(time, work_taken)
}

/// At most so much time on the wall, for a person who waits.
pub fn wall_limit(time: Duration) -> Limit {
    Limit::new(time, wall)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sleep_takes_time_on_the_wall_and_is_no_work() {
        const NAP: Duration = Duration::from_millis(100);
        let (work, time) = (work_taken(), wall());
        std::thread::sleep(NAP);
        assert!(wall() - time >= NAP);
        assert!(work_taken() - work < NAP);
    }
}
