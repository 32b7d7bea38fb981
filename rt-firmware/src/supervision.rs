//! Who must show heartbeats so that the watchdog is fed.
//!
//! While a mission runs, each of its slots must be executed once in a window of twice the longest
//! period of them, and [`MIN_WINDOW_US`] more. The link must get its turn once in
//! [`LINK_BOUND_US`], the idle loop, which runs background tasks, once in [`BACKGROUND_BOUND_US`].
//! If one of them is silent for longer, the watchdog is fed no more, and the board resets; who it
//! was is kept. A task of a real-time slot that never returns needs no watching: nothing is fed
//! meanwhile.

use core::sync::atomic::Ordering::Relaxed;

use esm_link::message::Silent;

use crate::board::microseconds;
use crate::heartbeats::Heartbeats;

/// What a window has beyond twice the longest period, in µs: interrupts that were masked for long
/// make slots late, and are no reason to reset.
pub const MIN_WINDOW_US: u32 = 1_000_000;
/// How long the link may go without a turn, in µs.
pub const LINK_BOUND_US: u32 = 5_000_000;
/// How long a step of a background task may take, the time that slots take from it included, in µs.
pub const BACKGROUND_BOUND_US: u32 = 10_000_000;

/// Decides whether the watchdog is fed. Times are of any clock that never goes back.
pub(crate) struct Supervision {
    /// Length of a window in µs, while a mission runs.
    window_us: u64,
    /// When the window began that is open, if one is.
    began: Option<u64>,
    link_at: u64,
    slot_0_at: u64,
    /// How long link and slots had run when slot 0 showed itself last, in microseconds.
    taken_us: Taken,
    silent: Option<Silent>,
}

/// How long link and slots have run, in microseconds; wraps.
#[derive(Clone, Copy)]
struct Taken {
    link: u32,
    slots: u32,
}

impl Taken {
    fn now(heartbeats: &Heartbeats) -> Self {
        Taken {
            link: heartbeats.link_us.load(Relaxed),
            slots: heartbeats.slots_us(),
        }
    }

    /// Whether the link has taken, of a time that began with these, nearly all that slots left:
    /// more than [its share](crate::LinkPort::LINK_PERCENT), which leaves slot 0 some. Where slots
    /// leave next to nothing, they are what slot 0 lacks time for.
    fn is_starved_by_link(self, heartbeats: &Heartbeats, elapsed_us: u64) -> bool {
        let now = Taken::now(heartbeats);
        let link_us = u64::from(now.link.wrapping_sub(self.link));
        let slots_us = u64::from(now.slots.wrapping_sub(self.slots));
        let left_us = elapsed_us.saturating_sub(slots_us);
        const MOST_EIGHTHS: u64 = 7;
        link_us * 8 > left_us * MOST_EIGHTHS && left_us * 8 > elapsed_us
    }
}

impl Supervision {
    pub(crate) const fn new() -> Self {
        Supervision {
            window_us: 0,
            began: None,
            link_at: 0,
            slot_0_at: 0,
            taken_us: Taken { link: 0, slots: 0 },
            silent: None,
        }
    }

    /// Another mission runs from now on.
    pub(crate) fn begin_mission(&mut self, longest_period_us: u32) {
        self.window_us = u64::from(longest_period_us) * 2 + u64::from(MIN_WINDOW_US);
        self.began = None;
    }

    /// Whether the watchdog may be fed now. `first_silent_slot` says which slot was not executed
    /// since it was asked last; it is asked at the end of each window, and once before the first.
    /// No window is open where no mission runs.
    pub(crate) fn may_feed(
        &mut self,
        now: u64,
        ticks_per_us: u32,
        heartbeats: &Heartbeats,
        runs: bool,
        first_silent_slot: impl FnOnce() -> Option<usize>,
    ) -> Result<(), Silent> {
        let ticks = |us: u32| u64::from(us) * u64::from(ticks_per_us);
        let window = self.window_us * u64::from(ticks_per_us);
        if heartbeats.link.load(Relaxed) {
            heartbeats.link.store(false, Relaxed);
            self.link_at = now;
        } else if now.saturating_sub(self.link_at) > ticks(LINK_BOUND_US) {
            self.silent.get_or_insert(Silent::Link);
        }
        let slot_0_silent = now.saturating_sub(self.slot_0_at);
        if heartbeats.background.load(Relaxed) {
            heartbeats.background.store(false, Relaxed);
            self.slot_0_at = now;
            self.taken_us = Taken::now(heartbeats);
        } else if slot_0_silent > ticks(BACKGROUND_BOUND_US) {
            let silent_us = microseconds(slot_0_silent, ticks_per_us);
            let is_starved = self.taken_us.is_starved_by_link(heartbeats, silent_us);
            self.silent.get_or_insert(match is_starved {
                true => Silent::BackgroundForLink,
                false => Silent::Background,
            });
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
            let heartbeats = Heartbeats::new();
            let mut supervision = Supervision::new();
            supervision.begin_mission(400_000);
            let mut executed = [false; 3];
            for now_us in (0..time_us).step_by(10_000) {
                for ((executed, period_us), end_us) in
                    executed.iter_mut().zip(PERIODS_US).zip(self.ends_us)
                {
                    *executed |= now_us < end_us && now_us % u64::from(period_us) == 0;
                }
                heartbeats.link.store(now_us < self.link_ends_us, Relaxed);
                heartbeats
                    .background
                    .store(now_us < self.slot_0_ends_us, Relaxed);
                let now = now_us * u64::from(TICKS_PER_US);
                let asked = supervision.may_feed(now, TICKS_PER_US, &heartbeats, self.runs, || {
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
                BACKGROUND_BOUND_US,
                Silent::Background,
            ),
        ] {
            let (at_us, who) = made.watched_for(60_000_000).expect("it is found");
            assert_eq!(who, expected);
            let late_us = at_us - 1_000_000 - u64::from(bound_us);
            assert!(late_us <= 10_000, "{expected:?}: {late_us} us late");
        }
    }

    #[test]
    fn a_slot_0_whose_time_the_link_took_is_told_from_one_that_hangs() {
        // Percent of the time that link and slots take, and who is silent.
        for (link, slots, expected) in [
            (0, 0, Silent::Background),
            (0, 100, Silent::Background),
            // Its share, beside a task that hangs.
            (50, 0, Silent::Background),
            (30, 40, Silent::Background),
            (1, 99, Silent::Background),
            (100, 0, Silent::BackgroundForLink),
            (65, 35, Silent::BackgroundForLink),
            (90, 5, Silent::BackgroundForLink),
        ] {
            let heartbeats = Heartbeats::new();
            let mut supervision = Supervision::new();
            let found = (0..2_000).find_map(|step| {
                let step_us = 10_000;
                // They wrap on the way.
                let took_us = |percent: u32| {
                    (u32::MAX - 3_000_000).wrapping_add(step * (step_us / 100) * percent)
                };
                heartbeats.link_us.store(took_us(link), Relaxed);
                heartbeats.slots_us.store(took_us(slots), Relaxed);
                heartbeats.link.store(true, Relaxed);
                heartbeats.background.store(step == 0, Relaxed);
                let now = u64::from(step * step_us * TICKS_PER_US);
                supervision
                    .may_feed(now, TICKS_PER_US, &heartbeats, false, || None)
                    .err()
            });
            assert_eq!(found, Some(expected), "link {link} %, slots {slots} %");
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
            Silent::Background,
            Silent::Slot(0),
            Silent::Slot(255),
            Silent::BackgroundForLink,
        ] {
            assert_eq!(Silent::from_number(who.number()), Some(who));
        }
        assert_eq!(Silent::from_number(u32::MAX), None);
    }
}
