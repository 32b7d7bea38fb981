//! Who must show signs of life so that the watchdog is fed.
//!
//! While a mission runs, each of its slots must be executed once in a window of twice the longest period of them, and [`MIN_WINDOW_US`] more. The link
//! must get its turn once in [`LINK_BOUND_US`], the idle loop, which runs slot-0 tasks, once in [`SLOT_0_BOUND_US`]. If one of them is silent for longer, the watchdog is fed no more,
//! and the board resets; who it was is kept. A task of a real-time slot that never returns needs no watching: nothing is fed meanwhile.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

use serde::{Deserialize, Serialize};

/// What a window has beyond twice the longest period, in µs: interrupts that were masked for long make slots late, and are no reason to reset.
pub const MIN_WINDOW_US: u32 = 1_000_000;
/// How long the link may go without a turn, in µs.
pub const LINK_BOUND_US: u32 = 5_000_000;
/// How long a step of a slot-0 task may take, the time that slots take from it included, in µs.
pub const SLOT_0_BOUND_US: u32 = 10_000_000;

/// Who was silent for too long.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Silent {
    /// The slot with this index in the mission's blob was executed no more; 255 stands for more, too.
    Slot(u8),
    /// The link got no turn.
    Link,
    /// A slot-0 task did not return, or slots left it no time.
    Slot0,
}

impl Silent {
    /// Its number, as it is kept across a reset: 0 stands for nobody.
    pub(crate) fn number(self) -> u32 {
        match self {
            Silent::Link => 1,
            Silent::Slot0 => 2,
            Silent::Slot(slot) => 3 + u32::from(slot),
        }
    }

    /// Who has this number.
    pub(crate) fn from_number(number: u32) -> Option<Silent> {
        match number {
            0 => None,
            1 => Some(Silent::Link),
            2 => Some(Silent::Slot0),
            slot => u8::try_from(slot - 3).ok().map(Silent::Slot),
        }
    }
}

/// What sides that are not the real-time side show of themselves.
pub(crate) struct Signs {
    /// The link had its turn.
    pub(crate) link: AtomicBool,
    /// The idle loop went round.
    pub(crate) slot_0: AtomicBool,
    /// Requests that arrived whole; wraps.
    pub(crate) requests: AtomicU32,
    /// An emergency stop is latched. Set by whoever wants one, cleared by the real-time side alone, which looks before each exchange with the body.
    pub(crate) emergency_stop: AtomicBool,
    /// The emergency stop that is latched may be released, since nobody wanted another one after that was asked for. The link sets it, and whoever wants a stop clears it.
    pub(crate) release: AtomicBool,
    /// The button that latches one is pressed; looked at while one is latched.
    pub(crate) stop_pressed: AtomicBool,
    /// The link prepares a mission, or has asked for one to take over.
    pub(crate) mission_is_coming: AtomicBool,
}

impl Signs {
    pub(crate) const fn new() -> Self {
        Signs {
            link: AtomicBool::new(false),
            slot_0: AtomicBool::new(false),
            requests: AtomicU32::new(0),
            emergency_stop: AtomicBool::new(false),
            release: AtomicBool::new(false),
            stop_pressed: AtomicBool::new(false),
            mission_is_coming: AtomicBool::new(false),
        }
    }
}

/// Decides whether the watchdog is fed. Times are of any clock that never goes back.
pub(crate) struct Supervision {
    /// Length of a window in µs, while a mission runs.
    window_us: u64,
    /// When the window began that is open, if one is.
    began: Option<u64>,
    link_at: u64,
    slot_0_at: u64,
    silent: Option<Silent>,
}

impl Supervision {
    pub(crate) const fn new() -> Self {
        Supervision {
            window_us: 0,
            began: None,
            link_at: 0,
            slot_0_at: 0,
            silent: None,
        }
    }

    /// Another mission runs from now on.
    pub(crate) fn begin_mission(&mut self, longest_period_us: u32) {
        self.window_us = u64::from(longest_period_us) * 2 + u64::from(MIN_WINDOW_US);
        self.began = None;
    }

    /// Whether the watchdog may be fed now. `first_silent_slot` says which slot was not executed since it was asked last; it is asked at the end
    /// of each window, and once before the first. No window is open where no mission runs.
    pub(crate) fn allows_food(
        &mut self,
        now: u64,
        ticks_per_us: u32,
        signs: &Signs,
        runs: bool,
        first_silent_slot: impl FnOnce() -> Option<usize>,
    ) -> Result<(), Silent> {
        let ticks = |us: u32| u64::from(us) * u64::from(ticks_per_us);
        let window = self.window_us * u64::from(ticks_per_us);
        for (sign, at, bound_us, who) in [
            (&signs.link, &mut self.link_at, LINK_BOUND_US, Silent::Link),
            (
                &signs.slot_0,
                &mut self.slot_0_at,
                SLOT_0_BOUND_US,
                Silent::Slot0,
            ),
        ] {
            if sign.load(Relaxed) {
                sign.store(false, Relaxed);
                *at = now;
            } else if now.saturating_sub(*at) > ticks(bound_us) {
                self.silent.get_or_insert(who);
            }
        }
        match self.began {
            _ if !runs => self.began = None,
            None => {
                first_silent_slot();
                self.began = Some(now);
            }
            Some(began) if now.saturating_sub(began) > window => {
                if let Some(slot) = first_silent_slot() {
                    let slot = u8::try_from(slot).unwrap_or(u8::MAX);
                    self.silent.get_or_insert(Silent::Slot(slot));
                }
                self.began = Some(now);
            }
            Some(_) => {}
        }
        match self.silent {
            None => Ok(()),
            Some(who) => Err(who),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICKS_PER_US: u32 = 3;
    const PERIODS_US: [u32; 3] = [10_000, 40_000, 400_000];
    const WINDOW_US: u64 = 2 * 400_000 + MIN_WINDOW_US as u64;

    /// A robot whose parts do what they are told to, until a time; who is found silent, and when.
    struct Made {
        ends_us: [u64; 3],
        link_ends_us: u64,
        slot_0_ends_us: u64,
        runs: bool,
    }

    impl Made {
        const ALL_WELL: Made = Made {
            ends_us: [u64::MAX; 3],
            link_ends_us: u64::MAX,
            slot_0_ends_us: u64::MAX,
            runs: true,
        };

        fn watched_for(&self, time_us: u64) -> Option<(u64, Silent)> {
            let signs = Signs::new();
            let mut supervision = Supervision::new();
            supervision.begin_mission(400_000);
            let mut executed = [false; 3];
            for now_us in (0..time_us).step_by(10_000) {
                for ((executed, period_us), end_us) in
                    executed.iter_mut().zip(PERIODS_US).zip(self.ends_us)
                {
                    *executed |= now_us < end_us && now_us % u64::from(period_us) == 0;
                }
                signs.link.store(now_us < self.link_ends_us, Relaxed);
                signs.slot_0.store(now_us < self.slot_0_ends_us, Relaxed);
                let now = now_us * u64::from(TICKS_PER_US);
                let asked = supervision.allows_food(now, TICKS_PER_US, &signs, self.runs, || {
                    let silent = executed.iter().position(|executed| !executed);
                    executed = [false; 3];
                    silent
                });
                if let Err(who) = asked {
                    return Some((now_us, who));
                }
            }
            None
        }
    }

    #[test]
    fn who_does_all_that_it_should_is_fed() {
        assert_eq!(Made::ALL_WELL.watched_for(60_000_000), None);
    }

    #[test]
    fn a_dispatcher_that_leaves_a_slot_out_starves_the_watchdog() {
        for slot in 0..3 {
            let mut made = Made::ALL_WELL;
            made.ends_us[slot] = 5_000_000;
            let (at_us, who) = made.watched_for(60_000_000).expect("it is found");
            assert_eq!(who, Silent::Slot(slot as u8));
            let after_us = at_us - 5_000_000;
            assert!(
                after_us <= 2 * WINDOW_US + 20_000,
                "slot {slot}: after {after_us} us"
            );
        }
    }

    #[test]
    fn a_link_or_a_slot_0_without_a_turn_starves_the_watchdog_after_its_bound() {
        for (made, bound_us, expected) in [
            (
                Made {
                    link_ends_us: 1_000_000,
                    ..Made::ALL_WELL
                },
                LINK_BOUND_US,
                Silent::Link,
            ),
            (
                Made {
                    slot_0_ends_us: 1_000_000,
                    runs: false,
                    ..Made::ALL_WELL
                },
                SLOT_0_BOUND_US,
                Silent::Slot0,
            ),
        ] {
            let (at_us, who) = made.watched_for(60_000_000).expect("it is found");
            assert_eq!(who, expected);
            let late_us = at_us - 1_000_000 - u64::from(bound_us);
            assert!(late_us <= 10_000, "{expected:?}: {late_us} us late");
        }
    }

    #[test]
    fn slots_owe_nothing_while_no_mission_runs() {
        let made = Made {
            ends_us: [0; 3],
            runs: false,
            ..Made::ALL_WELL
        };
        assert_eq!(made.watched_for(60_000_000), None);
    }

    #[test]
    fn numbers_tell_who_was_silent() {
        assert_eq!(Silent::from_number(0), None);
        for who in [
            Silent::Link,
            Silent::Slot0,
            Silent::Slot(0),
            Silent::Slot(255),
        ] {
            assert_eq!(Silent::from_number(who.number()), Some(who));
        }
        assert_eq!(Silent::from_number(u32::MAX), None);
    }
}
