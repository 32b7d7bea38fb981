//! Where the activations of a schedule are: which stretch of it is worth looking at, what is in it,
//! and what is free.
//!
//! Slots come with their starts. Time is looked at in **frames** as long as the shortest period. A
//! hyperperiod may be too long to be built or even to be counted, so whatever is asked for names
//! how much of it is looked at, and [`MAX_SEARCHED`] bounds the rest.
//!
//! ```
//! use esm_toolkit::timetable::{TimedSlot, Timetable};
//!
//! let slot = |number, start_us, period_us, duration_us| TimedSlot { number, start_us, period_us, duration_us };
//! let timetable = Timetable::new(vec![slot(1, 0, 20_000, 2_000), slot(3, 6_000, 40_000, 2_000)]);
//! let window = timetable.window(50);
//! assert_eq!((window.start_us, window.length_us, window.busy_us), (0, 40_000, 6_000));
//! let activations = timetable.activations(window.start_us, window.end_us());
//! assert_eq!(activations.iter().map(|one| one.start_us).collect::<Vec<_>>(), [0, 6_000, 20_000]);
//! ```

use std::cmp::Reverse;
use std::collections::BTreeMap;

use crate::duration;
use crate::schedule::{Report, gcd};

/// As many activations are looked at to find the busiest window, about: the schedule behind them is
/// not searched.
pub const MAX_SEARCHED: u64 = 100_000;

/// A slot with its place in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimedSlot {
    /// The number that it was declared with.
    pub number: u32,
    /// Start of its first activation in microseconds, below its period.
    pub start_us: u32,
    /// Its period in microseconds, above 0.
    pub period_us: u32,
    /// Its duration in microseconds, at most its period.
    pub duration_us: u32,
}

/// One activation of a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Activation {
    /// Index of the slot.
    pub slot: usize,
    /// Which activation of its slot it is, from 0. What reaches over the end of a hyperperiod is
    /// seen at its beginning too: that one has -1.
    pub number: i64,
    /// When it starts, in microseconds from the origin.
    pub start_us: i64,
    /// When it ends.
    pub end_us: i64,
}

/// A stretch of time in which no slot runs: it belongs to slot 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gap {
    /// Where it begins, in microseconds from the origin.
    pub start_us: u64,
    /// How long it is.
    pub length_us: u64,
}

/// Which part of a schedule a [`Window`] is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// One whole hyperperiod.
    Hyperperiod,
    /// The busiest of all that begin with a frame, of a hyperperiod.
    BusiestOfHyperperiod,
    /// The busiest of all that begin with a frame, of so many microseconds from the origin; the
    /// schedule goes on behind them.
    BusiestOfFirst(u64),
}

/// A stretch of a schedule.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Where it begins, in microseconds from the origin.
    pub start_us: u64,
    /// How long it is.
    pub length_us: u64,
    /// How much of it slots take.
    pub busy_us: u64,
    /// Which part of the schedule it is.
    pub extent: Extent,
}

impl Window {
    /// Where it ends.
    pub fn end_us(&self) -> u64 {
        self.start_us.saturating_add(self.length_us)
    }
}

/// Slots that are shown as one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Row {
    /// Indices of the slots.
    pub slots: Vec<usize>,
    /// The period of all of them; `None` where they have several.
    pub period_us: Option<u32>,
}

/// Slots with their starts.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Timetable {
    slots: Vec<TimedSlot>,
    /// The shortest period; 0 without slots.
    frame_us: u64,
    hyperperiod_us: Option<u64>,
}

impl Timetable {
    /// Takes slots. Those of one processor do not overlap; of several, what a window is busy with
    /// is the sum. One without a period is left out.
    pub fn new(mut slots: Vec<TimedSlot>) -> Self {
        slots.retain(|slot| slot.period_us > 0);
        let periods = || slots.iter().map(|slot| u64::from(slot.period_us));
        let hyperperiod_us = periods().try_fold(1_u64, |multiple, period_us| {
            multiple.checked_mul(period_us / gcd(multiple, period_us))
        });
        Timetable {
            frame_us: periods().min().unwrap_or(0),
            hyperperiod_us,
            slots,
        }
    }

    /// The schedule that a report tells.
    pub fn of_report(report: &Report) -> Self {
        let timed = report.slots.iter().map(|slot| TimedSlot {
            number: slot.slot,
            start_us: slot.start_us,
            period_us: slot.period_us,
            duration_us: slot.duration_us,
        });
        Timetable::new(timed.collect())
    }

    /// The slots.
    pub fn slots(&self) -> &[TimedSlot] {
        &self.slots
    }

    /// The slots in rows: each alone where they are at most `most`, else those of one period
    /// together, and the longest periods in one where these are still too many.
    pub fn rows(&self, most: usize) -> Vec<Row> {
        let alone = |(index, slot): (usize, &TimedSlot)| Row {
            slots: vec![index],
            period_us: Some(slot.period_us),
        };
        if self.slots.len() <= most {
            return self.slots.iter().enumerate().map(alone).collect();
        }
        let mut of_period: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for (index, slot) in self.slots.iter().enumerate() {
            of_period.entry(slot.period_us).or_default().push(index);
        }
        let mut rows: Vec<Row> = of_period
            .into_iter()
            .map(|(period_us, slots)| Row {
                slots,
                period_us: Some(period_us),
            })
            .collect();
        if rows.len() > most {
            let rest = rows.split_off(most.saturating_sub(1));
            rows.push(Row {
                slots: rest.into_iter().flat_map(|row| row.slots).collect(),
                period_us: None,
            });
        }
        rows
    }

    /// What a window is, in words.
    pub fn describe(&self, window: &Window) -> String {
        let whole = self.hyperperiod_us.map_or_else(
            || "a hyperperiod of more than 64 bits".to_owned(),
            |us| format!("a hyperperiod of {}", duration::time(us)),
        );
        let busiest = |of: String| {
            format!(
                "the busiest {} of {of}, from {} on, of those that begin at a multiple of {}",
                duration::time(window.length_us),
                duration::time(window.start_us),
                duration::time(self.frame_us)
            )
        };
        match window.extent {
            Extent::Hyperperiod => {
                format!("one hyperperiod of {}", duration::time(window.length_us))
            }
            Extent::BusiestOfHyperperiod => busiest(whole),
            Extent::BusiestOfFirst(us) => {
                busiest(format!("the first {} of {whole}", duration::time(us)))
            }
        }
    }

    /// Length of a frame, the shortest period, in microseconds; 0 without slots.
    pub fn frame_us(&self) -> u64 {
        self.frame_us
    }

    /// Greatest common divisor of the periods in microseconds; 0 without slots.
    pub fn common_divisor_us(&self) -> u64 {
        self.slots
            .iter()
            .fold(0, |divisor, slot| gcd(divisor, slot.period_us.into()))
    }

    /// Least common multiple of the periods in microseconds; `None` where it exceeds 64 bits.
    pub fn hyperperiod_us(&self) -> Option<u64> {
        self.hyperperiod_us
    }

    /// The most frames in which at most `most` activations begin, or a hyperperiod if that is
    /// shorter; at least one.
    pub fn frames_with(&self, most: u64) -> u64 {
        if self.frame_us == 0 {
            return 1;
        }
        // One activation a slot, and what the rates bring: exact enough for a limit.
        let most_begun = most.saturating_sub(self.slots.len() as u64);
        let per_frame: f64 = self
            .slots
            .iter()
            .map(|slot| self.frame_us as f64 / f64::from(slot.period_us))
            .sum();
        let frames = (most_begun as f64 / per_frame) as u64;
        frames.min(self.frames_of_hyperperiod()).max(1)
    }

    fn frames_of_hyperperiod(&self) -> u64 {
        self.hyperperiod_us.map_or(u64::MAX, |hyperperiod_us| {
            hyperperiod_us / self.frame_us.max(1)
        })
    }

    /// A hyperperiod, if it has at most so many frames; else the busiest window of so many frames,
    /// the first of several: of all that begin with a frame, the one of which slots take most. It
    /// is looked for in as much of the schedule as [`MAX_SEARCHED`] activations are.
    pub fn window(&self, most_frames: u64) -> Window {
        let most_frames = most_frames.clamp(1, MAX_SEARCHED);
        let whole_frames = self.frames_of_hyperperiod();
        let loads = self.loads_us(most_frames.min(whole_frames));
        if self.frame_us == 0 || whole_frames <= most_frames {
            return Window {
                start_us: 0,
                length_us: self.hyperperiod_us.unwrap_or(1),
                busy_us: loads.iter().sum(),
                extent: Extent::Hyperperiod,
            };
        }
        let frames = loads.len();
        let in_window = usize::try_from(most_frames).map_or(frames, |most| most.min(frames));
        let is_hyperperiod = frames as u64 == whole_frames;
        let beginnings = if is_hyperperiod {
            frames
        } else {
            frames - in_window + 1
        };
        let load = |frame: usize| loads.get(frame % frames.max(1)).copied().unwrap_or(0);
        let mut busy_us: u64 = (0..in_window).map(load).sum();
        let mut best = (busy_us, Reverse(0));
        for first in 1..beginnings {
            busy_us = busy_us + load(first + in_window - 1) - load(first - 1);
            best = best.max((busy_us, Reverse(first)));
        }
        let (busy_us, Reverse(first)) = best;
        Window {
            start_us: first as u64 * self.frame_us,
            length_us: in_window as u64 * self.frame_us,
            busy_us,
            extent: if is_hyperperiod {
                Extent::BusiestOfHyperperiod
            } else {
                Extent::BusiestOfFirst(frames as u64 * self.frame_us)
            },
        }
    }

    /// How much of each frame slots take, in microseconds, from the origin on: over a hyperperiod,
    /// or over the part of it that [`MAX_SEARCHED`] activations are; at least over so many frames.
    pub fn loads_us(&self, least_frames: u64) -> Vec<u64> {
        let frames = self.frames_with(MAX_SEARCHED).max(least_frames);
        if self.frame_us == 0 {
            return Vec::new();
        }
        let mut loads = vec![0; usize::try_from(frames).unwrap_or(0)];
        let end_us = frames.saturating_mul(self.frame_us);
        for slot in 0..self.slots.len() {
            for one in self.of_slot(slot, 0, end_us) {
                let mut from_us = u64::try_from(one.start_us).unwrap_or(0);
                let to_us = u64::try_from(one.end_us).unwrap_or(0).min(end_us);
                while from_us < to_us {
                    let frame = from_us / self.frame_us;
                    let part_end_us = to_us.min((frame + 1) * self.frame_us);
                    if let Some(load) = usize::try_from(frame).ok().and_then(|at| loads.get_mut(at))
                    {
                        *load += part_end_us - from_us;
                    }
                    from_us = part_end_us;
                }
            }
        }
        loads
    }

    /// All activations of which a part is in a stretch of time, by their starts. Their number is
    /// the caller's concern.
    pub fn activations(&self, from_us: u64, to_us: u64) -> Vec<Activation> {
        let mut found: Vec<Activation> = (0..self.slots.len())
            .flat_map(|slot| self.of_slot(slot, from_us, to_us))
            .collect();
        found.sort_by_key(|one| (one.start_us, one.slot));
        found
    }

    /// The activations of one slot of which a part is in a stretch of time.
    pub fn of_slot(
        &self,
        slot: usize,
        from_us: u64,
        to_us: u64,
    ) -> impl Iterator<Item = Activation> + use<> {
        let signed = |us: u64| i64::try_from(us).unwrap_or(i64::MAX);
        let (from_us, to_us) = (signed(from_us), signed(to_us));
        let timed = self.slots.get(slot).copied();
        let first = timed.map_or(0, |timed| {
            let ended_us = from_us - i64::from(timed.start_us) - i64::from(timed.duration_us);
            ended_us.div_euclid(timed.period_us.into()) + 1
        });
        timed
            .into_iter()
            .flat_map(move |timed| (first..).map(move |number| (timed, number)))
            .map(move |(timed, number)| {
                let start_us = number
                    .saturating_mul(timed.period_us.into())
                    .saturating_add(timed.start_us.into());
                Activation {
                    slot,
                    number,
                    start_us,
                    end_us: start_us.saturating_add(timed.duration_us.into()),
                }
            })
            .take_while(move |one| one.start_us < to_us)
    }
}

/// What activations, in the order of their starts, leave free of a stretch of time.
pub fn gaps(activations: &[Activation], from_us: u64, to_us: u64) -> Vec<Gap> {
    let mut gaps = Vec::new();
    let mut free_from_us = from_us;
    let mut note = |start_us: u64, end_us: u64| {
        if start_us < end_us {
            gaps.push(Gap {
                start_us,
                length_us: end_us - start_us,
            });
        }
    };
    for one in activations {
        note(
            free_from_us,
            u64::try_from(one.start_us).unwrap_or(0).min(to_us),
        );
        free_from_us = free_from_us.max(u64::try_from(one.end_us).unwrap_or(0));
    }
    note(free_from_us, to_us);
    gaps
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::timetable;
    use proptest::prelude::*;

    #[test]
    fn a_short_hyperperiod_is_shown_whole() {
        let window = timetable(&[(0, 20, 2), (2, 20, 4), (36, 40, 6)]).window(2);
        assert_eq!(
            window,
            Window {
                start_us: 0,
                length_us: 40,
                busy_us: 18,
                extent: Extent::Hyperperiod
            }
        );
    }

    #[test]
    fn the_busiest_window_is_the_first_that_holds_most() {
        // Frames of 10: the slots of period 60 make the frames at 30 and 50 heavy.
        let slots = timetable(&[(0, 10, 1), (32, 60, 3), (55, 60, 4)]);
        for (frames, start_us, busy_us) in [(1, 50, 5), (2, 40, 6), (3, 30, 10), (5, 10, 12)] {
            let window = slots.window(frames);
            let expected = Window {
                start_us,
                length_us: frames * 10,
                busy_us,
                extent: Extent::BusiestOfHyperperiod,
            };
            assert_eq!(window, expected, "{frames} frames");
        }
    }

    #[test]
    fn the_busiest_window_may_reach_over_the_end_of_the_hyperperiod() {
        let window = timetable(&[(0, 10, 1), (2, 40, 6), (35, 40, 5)]).window(2);
        assert_eq!((window.start_us, window.busy_us), (30, 13));
    }

    #[test]
    fn a_hyperperiod_that_cannot_be_counted_is_searched_from_its_beginning() {
        let primes = [999_983, 999_979, 999_961, 999_959, 999_953, 999_931];
        let slots: Vec<_> = primes
            .iter()
            .zip(0..)
            .map(|(&period, at)| (at * 10, period, 5))
            .collect();
        let slots = timetable(&slots);
        assert_eq!(slots.hyperperiod_us(), None);
        let window = slots.window(4);
        let Extent::BusiestOfFirst(searched_us) = window.extent else {
            panic!("{window:?}");
        };
        assert_eq!(window.length_us, 4 * 999_931);
        let begun = slots.activations(0, searched_us).len() as u64;
        assert!(begun <= MAX_SEARCHED && begun > MAX_SEARCHED / 2, "{begun}");
    }

    #[test]
    fn no_slots_are_a_timetable_of_nothing() {
        let nothing = timetable(&[]);
        assert_eq!(nothing.window(10).busy_us, 0);
        assert_eq!(nothing.activations(0, 100), []);
        assert_eq!(nothing.loads_us(3), [0; 0]);
        assert_eq!(
            gaps(&[], 0, 100),
            [Gap {
                start_us: 0,
                length_us: 100
            }]
        );
    }

    #[test]
    fn what_reaches_over_the_end_of_a_period_is_seen_at_the_origin() {
        let slots = timetable(&[(36, 40, 6)]);
        let starts: Vec<_> = slots
            .activations(0, 80)
            .iter()
            .map(|one| (one.number, one.start_us, one.end_us))
            .collect();
        assert_eq!(starts, [(-1, -4, 2), (0, 36, 42), (1, 76, 82)]);
    }

    /// Slots of periods that divide each other or not, laid out one behind the other in a first
    /// frame.
    fn any_timetable() -> impl Strategy<Value = Timetable> {
        let slot = (1_u32..=6, 1_u32..=4, 0_u32..3);
        prop::collection::vec(slot, 1..6).prop_map(|slots| {
            let mut start = 0;
            let timed: Vec<_> = slots
                .iter()
                .map(|&(factor, duration, gap)| {
                    start += gap + duration;
                    (start - duration, factor * 40, duration)
                })
                .collect();
            timetable(&timed)
        })
    }

    proptest! {
        /// Microsecond by microsecond, which is what the other functions must not do.
        #[test]
        fn occurrences_and_gaps_share_out_every_microsecond(slots in any_timetable(), from in 0_u64..300, length in 1_u64..300) {
            let to = from + length;
            let found = slots.activations(from, to);
            let free = gaps(&found, from, to);
            for us in from..to {
                let is_busy = slots.slots().iter().any(|slot| {
                    let (period, start) = (i64::from(slot.period_us), i64::from(slot.start_us));
                    (us as i64 - start).rem_euclid(period) < i64::from(slot.duration_us)
                });
                let is_in = |start: i64, end: i64| (start..end).contains(&(us as i64));
                prop_assert_eq!(found.iter().any(|one| is_in(one.start_us, one.end_us)), is_busy);
                let is_free = free.iter().any(|gap| is_in(gap.start_us as i64, (gap.start_us + gap.length_us) as i64));
                prop_assert_eq!(is_free, !is_busy);
            }
        }

        #[test]
        fn no_window_is_busier_than_the_busiest(slots in any_timetable(), frames in 1_u64..5) {
            let window = slots.window(frames);
            let busy_us = |from: u64, to: u64| to - from - gaps(&slots.activations(from, to), from, to).iter().map(|gap| gap.length_us).sum::<u64>();
            prop_assert_eq!(busy_us(window.start_us, window.end_us()), window.busy_us);
            let hyperperiod_us = slots.hyperperiod_us().unwrap();
            for start in (0..hyperperiod_us).step_by(slots.frame_us() as usize) {
                prop_assert!(busy_us(start, start + window.length_us) <= window.busy_us);
            }
        }
    }
}
