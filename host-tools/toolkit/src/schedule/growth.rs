//! How much longer slots may last in a schedule that stands.
//!
//! Slot i ends before slot j begins if and only if C_i ≤ d_ij, with d_ij = (s_j − s_i) mod gcd(T_i,
//! T_j). So what it may last is the smallest d_ij over all others, and its period where it is
//! alone: exact, and nothing of it depends on the other durations. All slots may therefore grow
//! together by the smallest of these ratios (the margin of evolution of Al Sheikh, Brun, Hladik,
//! Prabhu 2011), and one alone by the difference.

use std::collections::BTreeMap;

use super::{SlotSpec, gcd};

/// What a schedule leaves for longer durations.
#[derive(Clone, Debug, PartialEq)]
pub struct Growth {
    /// By how many microseconds each slot may last longer while all others stay as they are, in the
    /// order of the slots.
    pub alone_us: Vec<u32>,
    /// By which factor all durations may be multiplied, each then cut to whole microseconds. `None`
    /// without a slot that lasts.
    pub together: Option<f64>,
}

/// The growth that a schedule leaves. Starts are right for the slots ([`super::check`]) and in
/// their order.
pub fn growth(slots: &[SlotSpec], starts_us: &[u32]) -> Growth {
    let mut by_period: BTreeMap<u64, Vec<(usize, u64)>> = BTreeMap::new();
    for (index, (slot, &start_us)) in slots.iter().zip(starts_us).enumerate() {
        by_period
            .entry(slot.period_us.into())
            .or_default()
            .push((index, start_us.into()));
    }
    // What each may last at most.
    let is_point = |index: usize| slots.get(index).is_some_and(|slot| slot.duration_us == 0);
    let mut longest_us: Vec<u64> = slots.iter().map(|slot| slot.period_us.into()).collect();
    for (&other_period_us, others) in &by_period {
        for (&period_us, members) in &by_period {
            let divisor = gcd(period_us, other_period_us).max(1);
            let mut begins: Vec<(u64, usize)> = others
                .iter()
                .map(|&(other, start_us)| (start_us % divisor, other))
                .collect();
            begins.sort_unstable();
            for &(index, start_us) in members {
                if let (Some(longest_us), Some(until_us)) = (
                    longest_us.get_mut(index),
                    next_begin(&begins, index, start_us % divisor, divisor, is_point(index)),
                ) {
                    *longest_us = until_us.min(*longest_us);
                }
            }
        }
    }
    let together = slots
        .iter()
        .zip(&longest_us)
        .filter(|(slot, _)| slot.duration_us > 0)
        .map(|(slot, &longest_us)| longest_us as f64 / f64::from(slot.duration_us))
        .min_by(f64::total_cmp);
    let alone_us = slots
        .iter()
        .zip(&longest_us)
        .map(|(slot, &longest_us)| {
            u32::try_from(longest_us)
                .unwrap_or(u32::MAX)
                .saturating_sub(slot.duration_us)
        })
        .collect();
    Growth { alone_us, together }
}

/// How long after `start` the next of the sorted begins comes around a circle of `divisor`, the
/// slot's own one left out. What begins with a slot that lasts has no duration, and comes a whole
/// circle later; a slot without duration that begins with another has no room at all.
fn next_begin(
    begins: &[(u64, usize)],
    index: usize,
    start: u64,
    divisor: u64,
    is_point: bool,
) -> Option<u64> {
    let from = begins.partition_point(|&(begin, _)| begin < start || (begin == start && !is_point));
    let is_other = |&&(_, other): &&(u64, usize)| other != index;
    let after = begins.get(from..)?.iter().find(is_other);
    let around = || begins.iter().find(is_other);
    let until = after
        .or_else(around)
        .map(|&(begin, _)| (begin + divisor - start) % divisor)?;
    Some(if until == 0 && !is_point {
        divisor
    } else {
        until
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::{Outcome, check, solve};
    use super::*;
    use crate::schedule::tests::slots;

    #[test]
    fn each_slot_may_grow_until_the_next_one_begins() {
        // 0..2 and 3..6 of 10, 7..8 of every second 10.
        let slots = slots(&[(10, 2), (10, 3), (20, 1)]);
        let growth = growth(&slots, &[0, 3, 17]);
        assert_eq!(growth.alone_us, [1, 1, 2]);
        assert_eq!(growth.together, Some(4.0 / 3.0));
    }

    #[test]
    fn a_slot_without_duration_takes_nothing_from_the_one_that_starts_with_it() {
        let growth = growth(&slots(&[(8, 0), (4, 3)]), &[0, 0]);
        assert_eq!(growth.alone_us, [0, 1]);
        assert_eq!(growth.together, Some(4.0 / 3.0));
    }

    #[test]
    fn a_slot_that_is_alone_may_fill_its_period() {
        let alone = growth(&slots(&[(10, 2)]), &[9]);
        assert_eq!((alone.alone_us, alone.together), (vec![8], Some(5.0)));
        let none = growth(&[], &[]);
        assert_eq!((none.alone_us, none.together), (vec![], None));
    }

    proptest! {
        /// The checker accepts what a slot may last, and not a microsecond more.
        #[test]
        fn growth_is_exact(
            times_us in proptest::collection::vec((prop::sample::select(vec![20_u32, 30, 40, 60, 90]), 1..6_u32), 1..7),
        ) {
            let slots = slots(&times_us);
            let Outcome::Feasible(schedule) = solve(&slots, std::time::Duration::from_secs(5)) else {
                return Ok(());
            };
            let growth = growth(&slots, &schedule.starts_us);
            for (index, &more_us) in growth.alone_us.iter().enumerate() {
                let mut grown = slots.clone();
                grown[index].duration_us += more_us;
                prop_assert_eq!(check(&grown, &schedule.starts_us), Ok(()));
                grown[index].duration_us += 1;
                prop_assert!(check(&grown, &schedule.starts_us).is_err());
            }
            let factor = growth.together.expect("slots that last");
            let mut grown = slots.clone();
            for slot in &mut grown {
                // A ratio of whole numbers below a hundred, times one of them: what is rounded is
                // far smaller than this.
                slot.duration_us = (f64::from(slot.duration_us) * factor + 1e-9) as u32;
            }
            prop_assert_eq!(check(&grown, &schedule.starts_us), Ok(()));
        }
    }
}
