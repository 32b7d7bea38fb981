//! How fast robot time may run against the wall clock.
//!
//! Robot time of an emulated board runs as fast as the machine can. That is wrong in two cases:
//! where a person watches, and while a request over the serial line is open, since the line's bytes
//! are paced by the wall clock, and a robot that raced ahead meanwhile would see an upload of a
//! second take a minute.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Lateness that is caught up. Beyond it, robot time has stood still (a busy machine, a suspended
/// laptop) and starts from there, since catching up would be a burst of robot time faster than the
/// wall clock.
const CATCH_UP_LIMIT: Duration = Duration::from_millis(20);

/// The clock of a run, shared by the board, the plant and the link client.
#[derive(Debug)]
pub struct Pace {
    always_realtime: bool,
    holds: AtomicUsize,
    /// Where wall and robot time were last seen equal; `None` while robot time runs freely.
    anchor: Mutex<Option<Anchor>>,
    /// From this robot time on, in microseconds, robot time is held as by [`Pace::hold`].
    hold_from_us: AtomicU64,
    robot_us: AtomicU64,
    exchanges: AtomicU64,
}

#[derive(Clone, Copy, Debug)]
struct Anchor {
    wall: Instant,
    robot_us: u64,
}

impl Pace {
    /// A clock that runs freely but for [`Pace::hold`]; or, with `realtime`, never faster than the
    /// wall clock.
    pub fn new(realtime: bool) -> Arc<Self> {
        Arc::new(Pace {
            always_realtime: realtime,
            holds: AtomicUsize::new(0),
            anchor: Mutex::new(None),
            hold_from_us: AtomicU64::new(u64::MAX),
            robot_us: AtomicU64::new(0),
            exchanges: AtomicU64::new(0),
        })
    }

    /// Holds robot time from `robot_us` on, or with `None` no more: for something that is to happen
    /// then, by someone who looks at the clock only now and then.
    pub fn hold_from(&self, robot_us: Option<u64>) {
        self.hold_from_us
            .store(robot_us.unwrap_or(u64::MAX), Relaxed);
    }

    /// Keeps robot time from running faster than the wall clock for as long as the answer lives.
    pub fn hold(self: &Arc<Self>) -> Hold {
        self.holds.fetch_add(1, Relaxed);
        Hold {
            pace: Arc::clone(self),
        }
    }

    /// Robot time has reached `robot_us`; waits for the wall clock where it must.
    pub fn reach(&self, robot_us: u64) {
        let held = self.always_realtime
            || self.holds.load(Relaxed) > 0
            || robot_us >= self.hold_from_us.load(Relaxed);
        if held {
            if let Some(wait) = self.wait_until(robot_us, Instant::now()) {
                std::thread::sleep(wait);
            }
        } else {
            *self.anchor.lock().unwrap_or_else(PoisonError::into_inner) = None;
        }
        self.robot_us.store(robot_us, Relaxed);
        self.exchanges.fetch_add(1, Relaxed);
    }

    /// How long the wall clock still needs, at `now`, to be where robot time is.
    fn wait_until(&self, robot_us: u64, now: Instant) -> Option<Duration> {
        let mut anchor = self.anchor.lock().unwrap_or_else(PoisonError::into_inner);
        let here = Anchor {
            wall: now,
            robot_us,
        };
        let from = *anchor.get_or_insert(here);
        let due = from.wall + Duration::from_micros(robot_us.saturating_sub(from.robot_us));
        let wait = due.checked_duration_since(now);
        if wait.is_none() && now.duration_since(due) > CATCH_UP_LIMIT {
            *anchor = Some(here);
        }
        wait
    }

    /// Robot time in microseconds since the first macro step of the first mission.
    pub fn robot_us(&self) -> u64 {
        self.robot_us.load(Relaxed)
    }

    /// Number of slot activations so far. Whoever sees it stand still sees a board that does.
    pub fn exchanges(&self) -> u64 {
        self.exchanges.load(Relaxed)
    }
}

/// Keeps robot time at the wall clock's pace until it is dropped.
#[derive(Debug)]
pub struct Hold {
    pace: Arc<Pace>,
}

impl Drop for Hold {
    fn drop(&mut self) {
        self.pace.holds.fetch_sub(1, Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SLOT_US: u64 = 10_000;
    /// Slots that are so seldom that nobody could wait for them.
    const SELDOM_US: u64 = 60_000_000;

    #[test]
    fn robot_time_runs_freely_but_while_a_request_is_open() {
        let pace = Pace::new(false);
        let freely = Instant::now();
        for step in 0..1000 {
            pace.reach(step * SELDOM_US);
        }
        let hold = pace.hold();
        let held = Instant::now();
        for step in 0..=10 {
            pace.reach(1000 * SELDOM_US + step * SLOT_US);
        }
        assert!(
            held.elapsed() >= Duration::from_millis(100),
            "{:?}",
            held.elapsed()
        );
        drop(hold);
        for step in 1001..2000 {
            pace.reach(step * SELDOM_US);
        }
        let hour = Duration::from_secs(3_600);
        assert!(freely.elapsed() < hour, "33 hours of robot time");
        let reached = (pace.robot_us(), pace.exchanges());
        assert_eq!(reached, (1999 * SELDOM_US, 2010));
    }

    #[test]
    fn a_board_that_stood_still_does_not_make_up_for_it() {
        let pace = Pace::new(true);
        let start = Instant::now();
        let at = |ms| start + Duration::from_millis(ms);
        let cases = [
            // wall ms, robot ms, wait in ms
            (0, 0, Some(0)),
            (4, 10, Some(6)),
            (12, 20, Some(8)),
            (35, 30, None),
            (36, 40, Some(4)),
            (500, 50, None),
            (501, 60, Some(9)),
        ];
        for (wall_ms, robot_ms, wait_ms) in cases {
            assert_eq!(
                pace.wait_until(robot_ms * 1000, at(wall_ms)),
                wait_ms.map(Duration::from_millis),
                "wall {wall_ms} ms, robot {robot_ms} ms"
            );
        }
    }
}
