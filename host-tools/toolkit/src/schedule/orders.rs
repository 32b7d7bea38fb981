//! Orders: an exact search for a few slots of any periods.
//!
//! For two slots i and j with g = gcd(Tᵢ, Tⱼ), the difference sⱼ − sᵢ lies in one of the stretches
//! from Cᵢ + k·g to (k + 1)·g − Cⱼ, k whole: *which* says in what order their activations come.
//! Once k is chosen for each pair, what is left are bounds of differences, and whether these agree
//! is a question of shortest paths (Bellman; Dechter, Meiri and Pearl 1991). So the search chooses
//! stretches, keeps the tightest bounds of all differences, and moves bounds that lie between two
//! stretches to the next one, which often leaves a pair but one stretch, or none. How finely time
//! is divided does not matter, nor how long the periods are.
//!
//! Not all differences need be looked at. All slots of a schedule can start later together, and
//! each start counts modulo its period. So the first slot starts at 0; turned by multiples of its
//! period, the second one starts before gcd(T₂, T₁); turned by multiples of both periods, the third
//! one before gcd(T₃, lcm(T₁, T₂)); and so on. Where two equal slots have equally many starts to
//! choose from, the first one comes first.
//!
//! It says nothing of given starts: what has no schedule without them has none with them.

use super::clock::Clock;
use super::{SlotSpec, gcd};

/// The most slots: each bound that moves compares all pairs. The depth of the recursion is at most
/// the number of pairs.
pub(super) const MAX_SLOTS: usize = 24;

/// What a search came to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum End {
    /// Starts in microseconds, in the order of the slots given.
    Found(Vec<u32>),
    /// There is no schedule.
    Exhausted,
    /// The limit of steps, the clock or the number of slots ended it.
    GivenUp,
}

/// Searches for starts of slots whose durations are above 0 and at most their periods. It counts
/// the steps down that it makes: bounds that move.
pub(super) fn search(slots: &[SlotSpec], steps_left: &mut u64, clock: &mut Clock) -> End {
    if slots.len() > MAX_SLOTS {
        return End::GivenUp;
    }
    let mut members: Vec<(usize, &SlotSpec)> = slots.iter().enumerate().collect();
    members.sort_by_key(|(_, slot)| (slot.period_us, std::cmp::Reverse(slot.duration_us)));
    let many = members.len();
    let mut pairs = Vec::new();
    let mut bounds = Bounds {
        many,
        most_us: vec![0; many * many],
    };
    let mut previous_us = 0;
    for (second, (_, b)) in members.iter().enumerate() {
        // gcd(T, lcm(T₁, T₂, …)) = lcm(gcd(T, T₁), gcd(T, T₂), …), which never exceeds T.
        let mut starts_us = 1;
        for (first, (_, a)) in members.iter().enumerate().take(second) {
            let divisor_us = gcd(a.period_us.into(), b.period_us.into());
            starts_us = starts_us / gcd(starts_us, divisor_us) * divisor_us;
            pairs.push(Pair {
                first,
                second,
                divisor_us: i64::try_from(divisor_us).unwrap_or(i64::MAX),
                first_us: a.duration_us.into(),
                second_us: b.duration_us.into(),
                failures: 1,
            });
        }
        let last_us = i64::try_from(starts_us).unwrap_or(i64::MAX) - 1;
        for other in (0..many).filter(|&other| other != second) {
            bounds.most_us[other * many + second] = last_us;
        }
        if let Some((_, a)) = second.checked_sub(1).and_then(|first| members.get(first)) {
            let is_equal = (a.period_us, a.duration_us) == (b.period_us, b.duration_us);
            if is_equal && previous_us == last_us {
                bounds.most_us[second * many + second - 1] = -i64::from(a.duration_us);
            }
        }
        previous_us = last_us;
    }
    bounds.close();
    let mut search = Search {
        pairs,
        steps_left,
        clock,
        is_cut: false,
    };
    match search.extend(bounds) {
        Some(found) => {
            let mut starts_us = vec![0; many];
            for (position, (index, _)) in members.iter().enumerate() {
                starts_us[*index] = u32::try_from(-found.most_us[position * many]).unwrap_or(0);
            }
            End::Found(starts_us)
        }
        None if search.is_cut => End::GivenUp,
        None => End::Exhausted,
    }
}

/// Two slots by their positions, the second one behind the first.
#[derive(Clone, Copy, Debug)]
struct Pair {
    first: usize,
    second: usize,
    divisor_us: i64,
    /// Durations.
    first_us: i64,
    second_us: i64,
    /// How often it had no stretch left, and 1: such pairs are decided early (Boussemart and others
    /// 2004).
    failures: u64,
}

impl Pair {
    /// The first and the last difference in a range with which the two do not overlap; `None` where
    /// there is none.
    fn clipped(&self, (mut low_us, mut high_us): (i64, i64)) -> Option<(i64, i64)> {
        let last_us = self.divisor_us - self.second_us;
        if self.first_us > last_us {
            return None;
        }
        let phase_us = low_us.rem_euclid(self.divisor_us);
        if phase_us < self.first_us {
            low_us += self.first_us - phase_us;
        } else if phase_us > last_us {
            low_us += self.divisor_us - phase_us + self.first_us;
        }
        let phase_us = high_us.rem_euclid(self.divisor_us);
        if phase_us > last_us {
            high_us -= phase_us - last_us;
        } else if phase_us < self.first_us {
            high_us -= phase_us + self.second_us;
        }
        (low_us <= high_us).then_some((low_us, high_us))
    }

    /// The first and the last stretch of a clipped range.
    fn stretches(&self, (low_us, high_us): (i64, i64)) -> (i64, i64) {
        let stretch = |us: i64| us.div_euclid(self.divisor_us);
        (stretch(low_us), stretch(high_us))
    }
}

/// How much later than another each slot starts at most.
#[derive(Clone, Debug)]
struct Bounds {
    many: usize,
    /// `[a * many + b]`: sᵦ − sₐ in microseconds at most; no sum of others is less.
    most_us: Vec<i64>,
}

impl Bounds {
    /// The least and the greatest difference of a pair.
    fn range(&self, pair: &Pair) -> (i64, i64) {
        let Pair { first, second, .. } = *pair;
        (
            -self.most_us[second * self.many + first],
            self.most_us[first * self.many + second],
        )
    }

    /// Makes each bound the least sum of bounds from one slot to the other (Floyd, Warshall).
    fn close(&mut self) {
        for over in 0..self.many {
            for from in 0..self.many {
                for to in 0..self.many {
                    let sum_us =
                        self.most_us[from * self.many + over] + self.most_us[over * self.many + to];
                    let most_us = &mut self.most_us[from * self.many + to];
                    *most_us = sum_us.min(*most_us);
                }
            }
        }
    }

    /// Adds that a slot starts at most so much later than another, and all that follows. Bounds the
    /// other way are not below that.
    fn tighten(&mut self, earlier: usize, later: usize, most_us: i64) {
        let many = self.many;
        if self.most_us[earlier * many + later] <= most_us {
            return;
        }
        for from in 0..many {
            let to_earlier_us = self.most_us[from * many + earlier] + most_us;
            for to in 0..many {
                let sum_us = to_earlier_us + self.most_us[later * many + to];
                let bound_us = &mut self.most_us[from * many + to];
                *bound_us = sum_us.min(*bound_us);
            }
        }
    }

    /// Gives a pair a range within its own.
    fn narrow(&mut self, pair: &Pair, (low_us, high_us): (i64, i64)) {
        self.tighten(pair.second, pair.first, -low_us);
        self.tighten(pair.first, pair.second, high_us);
    }
}

struct Search<'s> {
    pairs: Vec<Pair>,
    steps_left: &'s mut u64,
    clock: &'s mut Clock,
    is_cut: bool,
}

impl Search<'_> {
    /// Decides the pairs that are open in every way. Gives bounds that agree.
    fn extend(&mut self, mut bounds: Bounds) -> Option<Bounds> {
        if !self.settle(&mut bounds) {
            return None;
        }
        let Some(pair) = self.choose(&bounds) else {
            return Some(bounds);
        };
        let (low_us, high_us) = bounds.range(&pair);
        let (first, last) = pair.stretches((low_us, high_us));
        for stretch in first..=last {
            let begin_us = stretch * pair.divisor_us;
            let range_us = (
                low_us.max(begin_us + pair.first_us),
                high_us.min(begin_us + pair.divisor_us - pair.second_us),
            );
            let mut chosen = bounds.clone();
            chosen.narrow(&pair, range_us);
            let found = self.extend(chosen);
            if found.is_some() || self.is_cut {
                return found;
            }
        }
        None
    }

    /// Moves all bounds to stretches, until none has to move. Gives whether each pair has a stretch
    /// left.
    fn settle(&mut self, bounds: &mut Bounds) -> bool {
        let work = u32::try_from(self.pairs.len()).unwrap_or(u32::MAX);
        let mut is_settled = false;
        while !is_settled {
            is_settled = true;
            for position in 0..self.pairs.len() {
                let pair = self.pairs[position];
                let range_us = bounds.range(&pair);
                let Some(clipped_us) = pair.clipped(range_us) else {
                    self.pairs[position].failures += 1;
                    return false;
                };
                if clipped_us != range_us {
                    if *self.steps_left == 0 || self.clock.tick_many(work) {
                        self.is_cut = true;
                        return false;
                    }
                    *self.steps_left -= 1;
                    bounds.narrow(&pair, clipped_us);
                    is_settled = false;
                }
            }
        }
        true
    }

    /// The pair to decide next: of few stretches, and often in the way. `None` where each has but
    /// one.
    fn choose(&self, bounds: &Bounds) -> Option<Pair> {
        let mut best: Option<(u64, &Pair)> = None;
        for pair in &self.pairs {
            let (first, last) = pair.stretches(bounds.range(pair));
            if first == last {
                continue;
            }
            let count = last.abs_diff(first) + 1;
            let is_better = best.is_none_or(|(best_count, best)| {
                let [ours, theirs] = [(count, best), (best_count, pair)]
                    .map(|(count, other)| count * other.failures);
                let free_us = |pair: &Pair| pair.divisor_us - pair.first_us - pair.second_us;
                (ours, free_us(pair)) < (theirs, free_us(best))
            });
            if is_better {
                best = Some((count, pair));
            }
        }
        best.map(|(_, pair)| *pair)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::super::check;
    use super::super::oracle::{has_schedule, random_set};
    use super::*;
    use crate::schedule::tests::slots;

    fn search_all(slots: &[SlotSpec]) -> End {
        let mut clock = Clock::new(Duration::MAX);
        search(slots, &mut 1_000_000, &mut clock)
    }

    #[test]
    fn it_agrees_with_trying_all_starts() {
        let (mut found, mut exhausted) = (0, 0);
        for seed in 0..600 {
            let mut slots = random_set(seed);
            for slot in &mut slots {
                slot.fixed_start_us = None;
            }
            match search_all(&slots) {
                End::Found(starts_us) => {
                    assert_eq!(check(&slots, &starts_us), Ok(()), "seed {seed}");
                    found += 1;
                }
                End::Exhausted => {
                    assert!(!has_schedule(&slots), "seed {seed}: {slots:?}");
                    exhausted += 1;
                }
                End::GivenUp => panic!("seed {seed} is small: {slots:?}"),
            }
        }
        assert!(found > 100 && exhausted > 100, "{found} {exhausted}");
    }

    #[test]
    fn sets_that_just_fit_and_just_do_not() {
        /// Name, periods with durations, and whether they have a schedule.
        type Case = (&'static str, &'static [(u32, u32)], bool);
        let cases: &[Case] = &[
            ("no slots", &[], true),
            ("one", &[(7, 7)], true),
            ("twins that fill all", &[(9, 3), (9, 3), (9, 3)], true),
            ("twins that are too many", &[(9, 3), (9, 3), (9, 4)], false),
            ("pair by pair they fit", &[(4, 1), (6, 1), (10, 1)], false),
            (
                "slots of 2 ms and 5 ms leave two gaps of 930 us",
                &[(2_000, 90), (2_000, 480), (5_000, 500), (20_000, 1_000)],
                false,
            ),
            (
                "and of 930 us they do",
                &[(2_000, 90), (2_000, 480), (5_000, 500), (20_000, 930)],
                true,
            ),
        ];
        for (name, times_us, is_found) in cases {
            let slots = slots(times_us);
            match search_all(&slots) {
                End::Found(starts_us) => {
                    assert!(is_found, "{name}");
                    assert_eq!(check(&slots, &starts_us), Ok(()), "{name}");
                }
                end => assert_eq!((end, *is_found), (End::Exhausted, false), "{name}"),
            }
        }
    }

    #[test]
    fn it_ends_where_steps_or_slots_are_too_many() {
        let mut clock = Clock::new(Duration::MAX);
        let odd = slots(&[(4, 1), (6, 1), (10, 1)]);
        assert_eq!(search(&odd, &mut 1, &mut clock), End::GivenUp);
        let many = slots(&[(1_000, 1); MAX_SLOTS + 1]);
        assert_eq!(search(&many, &mut 1_000, &mut clock), End::GivenUp);
    }
}
