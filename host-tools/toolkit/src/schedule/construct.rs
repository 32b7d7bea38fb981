//! Construction: one slot after another gets a place in the time that is still free.
//!
//! For a slot of period T, time is a circle of length T. A slot that has its place takes it there
//! again and again, after each gcd(T, T') of its own period T'. What is left is a list of gaps, and
//! a new slot fits wherever a gap is long enough. Slots are placed period by period, so each circle
//! is laid out once and then only filled: the work is that of sorting what repeats on it. Where
//! that is too much, a circle is laid out up to a horizon only, and slots that find no gap before
//! it jump from clash to clash.
//!
//! Short periods come first, in each period long durations. A slot that finds no place is moved
//! forward, and all begins anew (squeaky wheel).

use std::cmp::Reverse;
use std::collections::BTreeMap;

use super::clock::Clock;
use super::{SlotSpec, gcd};

/// How often the construction begins anew, where it does.
const MAX_ATTEMPTS: usize = 8;

/// The most stretches that are laid out on a circle at a time.
const MAX_STRETCHES: u64 = 1 << 18;

/// The most stretches that are laid out on the circles of all periods, once on each.
const MAX_ALL_STRETCHES: u64 = 1 << 22;

/// The most looks at others to jump from clash to clash to a start behind the horizon. Where no
/// start is left, that would go on for the whole period.
const MAX_LOOKS: u64 = 1 << 20;

/// A slot with its start.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placed {
    pub(super) index: usize,
    pub(super) period_us: u64,
    pub(super) duration_us: u64,
    pub(super) start_us: u64,
}

impl Placed {
    pub(super) fn new(index: usize, slot: &SlotSpec, start_us: u64) -> Self {
        Placed {
            index,
            period_us: slot.period_us.into(),
            duration_us: slot.duration_us.into(),
            start_us,
        }
    }
}

/// Gives each slot a start that clashes with none of the others. `fixed` have theirs, and fit each
/// other; `free` are all others with their indices. `None` where that does not work out or the time
/// has run out: it proves nothing.
pub(super) fn construct(
    fixed: &[Placed],
    free: &[(usize, &SlotSpec)],
    taste: Taste,
    clock: &mut Clock,
) -> Option<Vec<Placed>> {
    let mut order = free.to_vec();
    order.sort_by_key(|(index, slot)| (slot.period_us, Reverse(slot.duration_us), *index));
    let mut periods_us: Vec<u64> = order
        .iter()
        .map(|(_, slot)| slot.period_us.into())
        .collect();
    periods_us.dedup();
    let attempts = match taste {
        Taste::Widest => 1,
        Taste::Shared => MAX_ATTEMPTS,
    };
    for _ in 0..attempts {
        let mut layout = Layout::new(fixed, &periods_us, taste);
        let stuck = order
            .iter()
            .position(|&(index, slot)| !layout.place(index, slot, clock));
        let Some(stuck) = stuck else {
            return Some(layout.into_placed());
        };
        if clock.is_over() {
            return None;
        }
        // Half the way to the front: straight to it, those that squeak take turns for ever.
        order.get_mut(stuck / 2..=stuck)?.rotate_right(1);
    }
    None
}

/// Length in microseconds of the frames in which the slots of a period stand one below the other:
/// that in which longer periods, of which it is no divisor, meet them. So they leave as much of it
/// as can be to those.
fn frame_us(period_us: u64, periods_us: &[u64]) -> u64 {
    periods_us
        .iter()
        .filter(|longer_us| **longer_us > period_us)
        .map(|longer_us| gcd(*longer_us, period_us))
        .min()
        .unwrap_or(period_us)
}

/// Which gap a slot takes, of all that are long enough.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Taste {
    /// The longest: so the load is spread, and each frame keeps some time.
    Widest,
    /// The one nearest to the beginning of a frame: so long gaps are kept for long slots.
    Shared,
}

/// Slots that have their places.
pub(super) struct Layout<'p> {
    placed: Vec<Placed>,
    /// By period in microseconds.
    circles: BTreeMap<u64, Circle>,
    taste: Taste,
    /// All periods that free slots have.
    periods_us: &'p [u64],
    /// What has no duration needs no time, and yet must not stand within another: circles know
    /// nothing of it.
    is_plain: bool,
}

impl<'p> Layout<'p> {
    /// `fixed` have their starts; the first of them is where frames begin. `periods_us` in order.
    pub(super) fn new(fixed: &[Placed], periods_us: &'p [u64], taste: Taste) -> Self {
        Layout {
            placed: fixed.to_vec(),
            circles: BTreeMap::new(),
            taste,
            periods_us,
            is_plain: fixed.iter().all(|placed| placed.duration_us > 0),
        }
    }

    /// Gives a slot its place, if it finds one.
    pub(super) fn place(&mut self, index: usize, slot: &SlotSpec, clock: &mut Clock) -> bool {
        let (period_us, duration_us) = (u64::from(slot.period_us), u64::from(slot.duration_us));
        self.is_plain &= duration_us > 0;
        let start_us = if self.placed.is_empty() {
            // As good as any: a schedule can be moved as a whole.
            Some(0)
        } else if self.is_plain {
            let origin_us = self.placed.first().map_or(0, |placed| placed.start_us);
            let (taste, periods_us) = (self.taste, self.periods_us);
            let circle = self.circles.entry(period_us).or_insert_with(|| {
                let frame_us = match (taste, periods_us.first()) {
                    (Taste::Widest, Some(&shortest_us)) => gcd(shortest_us, period_us),
                    _ => frame_us(period_us, periods_us),
                };
                let max_stretches = MAX_ALL_STRETCHES / (periods_us.len() as u64).max(1);
                Circle {
                    max_stretches: max_stretches.clamp(1, MAX_STRETCHES),
                    ..Circle::new(period_us, origin_us, frame_us, taste)
                }
            });
            circle.catch_up(&self.placed, clock);
            match circle.take(duration_us, clock) {
                None if circle.is_whole() => None,
                None => first_fit_within(&self.placed, slot, MAX_LOOKS, clock),
                found => found,
            }
        } else {
            first_fit(&self.placed, slot, clock)
        };
        let Some(start_us) = start_us.filter(|_| !clock.is_over()) else {
            return false;
        };
        self.placed.push(Placed::new(index, slot, start_us));
        true
    }

    /// All slots in the order in which they were placed.
    pub(super) fn into_placed(self) -> Vec<Placed> {
        self.placed
    }
}

/// Free time from `start` up to `end`, in microseconds after the origin.
#[derive(Clone, Copy, Debug)]
struct Gap {
    start: u64,
    end: u64,
}

/// What is free for the slots of one period.
struct Circle {
    period_us: u64,
    /// Where the circle begins: at the start of the first slot that was placed, so that no gap goes
    /// over its end.
    origin_us: u64,
    /// Length of its frames in microseconds. Gaps end where a frame does, unless nothing fits
    /// otherwise.
    frame_us: u64,
    taste: Taste,
    /// It is laid out up to here, in microseconds after the origin.
    horizon_us: u64,
    /// Ends of the gaps by rank and start: in the order in which they are looked at.
    gaps: BTreeMap<(u64, u64), u64>,
    /// Some gaps end where a frame does, and go on as others.
    is_cut: bool,
    /// The most stretches that are laid out at a time.
    max_stretches: u64,
    /// As many of those placed are on it.
    seen: usize,
    /// Among the gaps before this one, there is none as long as this, in microseconds.
    searched: ((u64, u64), u64),
}

impl Circle {
    fn new(period_us: u64, origin_us: u64, frame_us: u64, taste: Taste) -> Self {
        let mut circle = Circle {
            period_us,
            origin_us,
            frame_us,
            taste,
            horizon_us: period_us,
            gaps: BTreeMap::new(),
            is_cut: false,
            max_stretches: MAX_STRETCHES,
            seen: 0,
            searched: ((0, 0), 0),
        };
        circle.insert(Gap {
            start: 0,
            end: period_us,
        });
        circle
    }

    /// Whether it is laid out to its end.
    fn is_whole(&self) -> bool {
        self.horizon_us == self.period_us
    }

    /// Lays out what was placed since.
    fn catch_up(&mut self, placed: &[Placed], clock: &mut Clock) {
        let new = placed.get(self.seen..).unwrap_or(&[]);
        if new.is_empty() {
            return;
        }
        self.seen = placed.len();
        self.searched = ((0, 0), 0);
        // Slots of one period mostly follow each other.
        let mut last = (0, 1);
        let divisors: Vec<u64> = new
            .iter()
            .map(|placed| {
                if last.0 != placed.period_us {
                    last = (placed.period_us, gcd(placed.period_us, self.period_us));
                }
                last.1
            })
            .collect();
        let stretches: u64 = divisors
            .iter()
            .map(|divisor| self.horizon_us / divisor + 1)
            .sum();
        if stretches > self.max_stretches {
            self.horizon_us /= stretches.div_ceil(self.max_stretches);
        }
        let mut busy: Vec<Gap> = Vec::new();
        for (placed, divisor) in new.iter().zip(divisors) {
            let first = (placed.start_us + divisor - self.origin_us % divisor) % divisor;
            // What began before the origin and lasts beyond it.
            if first + placed.duration_us > divisor {
                busy.push(Gap {
                    start: 0,
                    end: first + placed.duration_us - divisor,
                });
            }
            let mut start = first;
            while start < self.horizon_us {
                busy.push(Gap {
                    start,
                    end: start + placed.duration_us,
                });
                start += divisor;
            }
        }
        busy.sort_unstable_by_key(|stretch| stretch.start);
        clock.tick_many(u32::try_from(busy.len() + self.gaps.len()).unwrap_or(u32::MAX));
        self.take_away(&busy);
    }

    /// Takes busy stretches, which may overlap, in order of their starts, out of the gaps.
    fn take_away(&mut self, busy: &[Gap]) {
        let mut left: Vec<Gap> = Vec::new();
        let mut busy = busy.iter().peekable();
        // All before this is busy or looked at.
        let mut from = 0;
        for gap in self.in_order() {
            let end = gap.end.min(self.horizon_us);
            from = from.max(gap.start);
            while let Some(stretch) = busy.next_if(|stretch| stretch.start < end) {
                if from < stretch.start {
                    left.push(Gap {
                        start: from,
                        end: stretch.start,
                    });
                }
                from = from.max(stretch.end);
            }
            if from < end {
                left.push(Gap { start: from, end });
            }
        }
        self.gaps.clear();
        for gap in left {
            self.insert(gap);
        }
    }

    /// Puts a gap in its place in the order. What lies beyond the end of its frame begins a frame
    /// of its own.
    fn insert(&mut self, gap: Gap) {
        let column = gap.start % self.frame_us;
        let next = gap.start + (self.frame_us - column);
        if next < gap.end {
            self.is_cut = true;
            self.rank_in(Gap { start: next, ..gap });
        }
        self.rank_in(Gap {
            end: gap.end.min(next),
            ..gap
        });
    }

    fn rank_in(&mut self, gap: Gap) {
        let rank = match self.taste {
            Taste::Widest => u64::MAX - (gap.end - gap.start),
            Taste::Shared => gap.start % self.frame_us,
        };
        let key = (rank, gap.start);
        self.gaps.insert(key, gap.end);
        // What is left of a gap that went over the end of a frame may come before it.
        let (searched, without_us) = self.searched;
        if key < searched && gap.end - gap.start >= without_us {
            self.searched.0 = key;
        }
    }

    /// Joins gaps that were cut at the end of a frame. Gives whether there are any.
    fn join(&mut self) -> bool {
        if !std::mem::replace(&mut self.is_cut, false) {
            return false;
        }
        let mut joined: Vec<Gap> = Vec::new();
        for gap in self.in_order() {
            match joined.last_mut() {
                Some(last) if last.end == gap.start => last.end = gap.end,
                _ => joined.push(gap),
            }
        }
        self.gaps.clear();
        for gap in joined {
            self.rank_in(gap);
        }
        self.searched = ((0, 0), 0);
        true
    }

    /// The gaps in the order of their starts.
    fn in_order(&self) -> Vec<Gap> {
        let gaps = self.gaps.iter();
        let mut gaps: Vec<Gap> = gaps.map(|(&(_, start), &end)| Gap { start, end }).collect();
        gaps.sort_unstable_by_key(|gap| gap.start);
        gaps
    }

    /// Takes the time for a slot from the first gap that is long enough. Gives its start in
    /// microseconds.
    fn take(&mut self, duration_us: u64, clock: &mut Clock) -> Option<u64> {
        let found = self.find(duration_us, clock);
        let key = match found {
            // It may fit over the end of a frame.
            None if self.join() => self.find(duration_us, clock)?,
            found => found?,
        };
        let (_, start) = key;
        let end = self.gaps.remove(&key)?;
        if start + duration_us < end {
            self.insert(Gap {
                start: start + duration_us,
                end,
            });
        }
        self.seen += 1;
        Some((start + self.origin_us) % self.period_us)
    }

    /// The first gap that is long enough.
    fn find(&mut self, duration_us: u64, clock: &mut Clock) -> Option<(u64, u64)> {
        let (searched, without_us) = self.searched;
        let from = if duration_us >= without_us {
            searched
        } else {
            (0, 0)
        };
        let mut looked_at = 0;
        let found = self
            .gaps
            .range(from..)
            .inspect(|_| looked_at += 1)
            .find(|((_, start), end)| *end - start >= duration_us)
            .map(|(key, _)| *key);
        clock.tick_many(looked_at / 4);
        self.searched = (found.unwrap_or((u64::MAX, 0)), duration_us);
        found
    }
}

// ─── One place at a time ─────────────────────────────────────────────────────────────────────────

/// Whether a start fits beside a slot that is placed.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Fit {
    /// It does.
    Free,
    /// It does not; the first later one that does is this, in microseconds.
    Later(u64),
    /// No start does.
    Never,
}

/// Whether a slot fits at a start beside one that is placed.
pub(super) fn fit(other: &Placed, start_us: u64, period_us: u64, duration_us: u64) -> Fit {
    let divisor = gcd(other.period_us, period_us);
    if other.duration_us + duration_us > divisor {
        return Fit::Never;
    }
    // How long before the start the other one began, modulo the divisor.
    let since = (start_us + divisor - other.start_us % divisor) % divisor;
    // What has no duration may start where another slot does.
    let is_point = since == 0 && duration_us == 0;
    if since < other.duration_us && !is_point {
        Fit::Later(start_us + other.duration_us - since)
    } else if since + duration_us > divisor {
        Fit::Later(start_us + divisor - since + other.duration_us)
    } else {
        Fit::Free
    }
}

/// The first start below the period that clashes with nothing placed. `None` also where the time
/// has run out.
pub(super) fn first_fit(layout: &[Placed], slot: &SlotSpec, clock: &mut Clock) -> Option<u64> {
    first_fit_within(layout, slot, u64::MAX, clock)
}

/// The same in at most so many looks at others; `None` where they do not suffice.
fn first_fit_within(
    layout: &[Placed],
    slot: &SlotSpec,
    max_looks: u64,
    clock: &mut Clock,
) -> Option<u64> {
    let period_us = u64::from(slot.period_us);
    let duration_us = u64::from(slot.duration_us);
    let mut start_us = 0;
    // As many others in a row fit this start.
    let mut fitting = 0;
    let mut others = layout.iter().cycle();
    let mut looks_left = max_looks;
    while fitting < layout.len() {
        if looks_left == 0 || clock.tick() {
            return None;
        }
        looks_left -= 1;
        match fit(others.next()?, start_us, period_us, duration_us) {
            Fit::Free => fitting += 1,
            Fit::Later(later_us) if later_us < period_us => {
                start_us = later_us;
                fitting = 1;
            }
            Fit::Later(_) | Fit::Never => return None,
        }
    }
    Some(start_us)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use proptest::prelude::*;

    use super::*;
    use crate::schedule::{Outcome, check, solve};

    fn slot(number: u32, period_us: u32, duration_us: u32) -> SlotSpec {
        SlotSpec {
            number,
            period_us,
            duration_us,
            fixed_start_us: None,
        }
    }

    #[test]
    fn a_period_of_an_hour_beside_one_of_a_millisecond_is_laid_out_up_to_a_horizon() {
        let slots = [
            slot(1, 1_000, 400),
            slot(2, 3_600_000_000, 300),
            slot(3, 3_600_000_000, 300),
            slot(4, 3_599_000_000, 200),
        ];
        let placed = [Placed::new(0, &slots[0], 0)];
        let mut circle = Circle::new(3_600_000_000, 0, 3_600_000_000, Taste::Shared);
        let mut clock = Clock::new(Duration::from_secs(10));
        circle.catch_up(&placed, &mut clock);
        assert!(!circle.is_whole() && circle.gaps.len() > 100_000);
        let Outcome::Feasible(schedule) = solve(&slots, Duration::from_secs(10)) else {
            panic!("there is much room");
        };
        assert_eq!(check(&slots, &schedule.starts_us), Ok(()));
    }

    #[test]
    fn slots_that_meet_in_a_short_frame_leave_it_to_others() {
        // Each of the first two takes half of its 10 us, and both meet the third in every 5 us:
        // they must stand one below the other there.
        let slots = [slot(1, 10, 2), slot(2, 10, 2), slot(3, 15, 3)];
        let free: Vec<(usize, &SlotSpec)> = slots.iter().enumerate().collect();
        let mut layout = Layout::new(&[], &[10, 15], Taste::Shared);
        let mut clock = Clock::new(Duration::from_secs(10));
        for (index, slot) in free {
            assert!(
                layout.place(index, slot, &mut clock),
                "slot {}",
                slot.number
            );
        }
    }

    #[test]
    fn what_is_left_of_a_gap_over_the_end_of_a_frame_is_found_again() {
        // In frames of 3 us, the second slot fits over an end of one alone; the last goes behind
        // the third, into a frame that was looked through before.
        let slots = [
            slot(1, 6, 2),
            slot(2, 12, 4),
            slot(3, 12, 1),
            slot(4, 12, 1),
        ];
        let mut layout = Layout::new(&[], &[6, 12, 15], Taste::Shared);
        let mut clock = Clock::new(Duration::from_secs(10));
        for (index, slot) in slots.iter().enumerate() {
            assert!(
                layout.place(index, slot, &mut clock),
                "slot {}",
                slot.number
            );
        }
    }

    #[test]
    fn many_periods_with_little_in_common_share_the_work() {
        // 300 multiples of 12 ms, no two alike: side by side in 12 ms they all have room.
        let slots: Vec<SlotSpec> = (1..=300)
            .map(|number| slot(number, 12_000 * (number + 9), 2 + number % 3))
            .collect();
        let free: Vec<(usize, &SlotSpec)> = slots.iter().enumerate().collect();
        let mut clock = Clock::new(Duration::MAX).with_ticks(10_000_000);
        let layout = construct(&[], &free, Taste::Widest, &mut clock).expect("there is much room");
        let mut starts_us = vec![0; slots.len()];
        for placed in layout {
            starts_us[placed.index] = placed.start_us as u32;
        }
        assert_eq!(check(&slots, &starts_us), Ok(()));
    }

    #[test]
    fn a_search_for_a_start_that_there_is_not_gives_up() {
        // Half of every 2 us is taken from each side, in two periods of more than an hour.
        let slots = [slot(1, 3_999_999_998, 1), slot(2, 3_999_999_998, 1)];
        let placed = [Placed::new(0, &slots[0], 0), Placed::new(1, &slots[1], 3)];
        let mut layout = Layout::new(&placed, &[4_000_000_000], Taste::Widest);
        let mut clock = Clock::new(Duration::MAX).with_ticks(10_000_000);
        assert!(!layout.place(2, &slot(3, 4_000_000_000, 1), &mut clock));
        assert!(!clock.is_over());
    }

    proptest! {
        /// What finds no gap on its circle finds none by jumping from clash to clash either, and
        /// what finds one clashes with nothing.
        #[test]
        fn gaps_are_all_there_is(
            times_us in proptest::collection::vec((prop::sample::select(vec![6_u32, 10, 12, 15, 20, 30, 60, 90]), 1..5_u32), 1..20),
            given_us in proptest::option::of(0..6_u32),
            taste in prop::sample::select(vec![Taste::Widest, Taste::Shared]),
        ) {
            let slots: Vec<SlotSpec> = times_us
                .iter()
                .zip(1..)
                .map(|(&(period_us, duration_us), number)| slot(number, period_us, duration_us))
                .collect();
            let periods_us = [6, 10, 12, 15, 20, 30, 60, 90];
            let mut clock = Clock::new(Duration::from_secs(10));
            let fixed: Vec<Placed> = given_us.map(|start_us| Placed::new(0, &slots[0], start_us.into())).into_iter().collect();
            let mut layout = Layout::new(&fixed, &periods_us, taste);
            for (index, slot) in slots.iter().enumerate().skip(fixed.len()) {
                let before = layout.placed.clone();
                let jumped = first_fit(&before, slot, &mut clock);
                prop_assert_eq!(layout.place(index, slot, &mut clock), jumped.is_some());
                if let Some(new) = layout.placed.get(before.len()) {
                    let fits = |other: &Placed| fit(other, new.start_us, new.period_us, new.duration_us) == Fit::Free;
                    prop_assert!(before.iter().all(fits));
                }
            }
        }
    }
}
