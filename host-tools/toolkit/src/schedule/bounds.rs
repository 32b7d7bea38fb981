//! Proofs that there is no schedule, by counting.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use super::clock::Clock;
use super::{Infeasibility, SlotSpec, exceeds_one, gcd, utilisation};

/// Slots that cannot be at all, or ask for too much together.
pub(super) fn single_slots(slots: &[SlotSpec]) -> Option<Infeasibility> {
    for slot in slots {
        if slot.duration_us > slot.period_us || slot.period_us == 0 {
            return Some(Infeasibility::TooLong {
                slot: slot.number,
                duration_us: slot.duration_us,
                period_us: slot.period_us,
            });
        }
    }
    overcommitted(slots)
}

/// Slots that ask for more time than there is, those with the greatest shares named until the
/// others fit.
pub(super) fn overcommitted(slots: &[SlotSpec]) -> Option<Infeasibility> {
    let times_us = |slots: &[SlotSpec]| -> Vec<(u32, u32)> {
        slots
            .iter()
            .map(|slot| (slot.period_us, slot.duration_us))
            .collect()
    };
    let exceeds = |slots: &[SlotSpec]| exceeds_one(times_us(slots).into_iter());
    if !exceeds(slots) {
        return None;
    }
    let mut by_share = slots.to_vec();
    by_share.sort_by(|a, b| {
        let shares = [(a, b), (b, a)]
            .map(|(of, other)| u64::from(of.duration_us) * u64::from(other.period_us));
        shares[1].cmp(&shares[0]).then(a.number.cmp(&b.number))
    });
    // Without so many the others fit: without all of them, they do.
    let (mut fails, mut works) = (0, by_share.len());
    while fails + 1 < works {
        let middle = fails + (works - fails) / 2;
        if by_share.get(middle..).is_some_and(exceeds) {
            fails = middle;
        } else {
            works = middle;
        }
    }
    Some(Infeasibility::Utilisation {
        utilisation: utilisation(times_us(slots).into_iter()),
        heaviest: by_share
            .iter()
            .take(works)
            .map(|slot| slot.number)
            .collect(),
    })
}

/// As many different periods are compared each with each.
const MAX_PERIODS: usize = 512;

/// As many windows are looked at.
const MAX_WINDOWS: usize = 4_096;

/// As many looks are taken at a period, or at whether two of them meet in a window, for all windows
/// together. The shortest windows, which are crowded soonest, come first.
const MAX_LOOKS: u64 = 1 << 23;

/// Slots that crowd a window.
///
/// Two slots do not overlap if and only if they do not overlap modulo the greatest common divisor
/// of their periods; then they do not overlap modulo any multiple of it either. So slots whose
/// common divisors, pair by pair, all divide one number W have one activation each in a circle of
/// W, side by side: their durations must sum up to at most W. Pairs are the smallest case.
pub(super) fn windows(slots: &[SlotSpec], clock: &mut Clock) -> Option<Infeasibility> {
    let mut by_period: BTreeMap<u64, Vec<&SlotSpec>> = BTreeMap::new();
    for slot in slots {
        by_period
            .entry(slot.period_us.into())
            .or_default()
            .push(slot);
    }
    let groups: Vec<Group<'_>> = by_period
        .into_iter()
        .map(|(period_us, mut slots)| {
            // Longest first: of slots of one period that exclude each other in the window, the
            // longest counts.
            slots.sort_by_key(|slot| (Reverse(slot.duration_us), slot.number));
            Group {
                period_us,
                sum_us: sum_us(&slots),
                slots,
            }
        })
        .collect();
    let compared = groups.get(..MAX_PERIODS).unwrap_or(&groups);
    let mut windows: BTreeSet<u64> = BTreeSet::new();
    for (position, a) in compared.iter().enumerate() {
        for b in compared.iter().skip(position) {
            windows.insert(gcd(a.period_us, b.period_us));
        }
        clock.tick_many(u32::try_from(compared.len() - position).unwrap_or(u32::MAX));
    }
    let mut looks_left = MAX_LOOKS.min(clock.ticks_left());
    for window_us in windows.into_iter().take(MAX_WINDOWS) {
        let before = looks_left;
        if let Some(reason) = crowded(window_us, &groups, &mut looks_left) {
            return Some(reason);
        }
        let looks = u32::try_from(before - looks_left).unwrap_or(u32::MAX);
        if looks_left == 0 || clock.tick_many(looks) {
            break;
        }
    }
    None
}

/// The slots of a period.
struct Group<'s> {
    period_us: u64,
    /// Longest first.
    slots: Vec<&'s SlotSpec>,
    /// Of all their durations, in microseconds.
    sum_us: u64,
}

fn sum_us(slots: &[&SlotSpec]) -> u64 {
    slots.iter().map(|slot| u64::from(slot.duration_us)).sum()
}

/// Gathers slots that meet in a window, greedily, and looks whether they fit. It counts the looks
/// down at one period or two.
fn crowded(window_us: u64, groups: &[Group<'_>], looks_left: &mut u64) -> Option<Infeasibility> {
    *looks_left = looks_left.saturating_sub(groups.len() as u64);
    // All slots of a period that divides the window meet there with each other; of another period
    // one alone counts.
    let mut candidates: Vec<(u64, u64, &[&SlotSpec])> = groups
        .iter()
        .filter_map(|group| {
            let (sum_us, counted) = if window_us.is_multiple_of(group.period_us) {
                (group.sum_us, group.slots.len())
            } else {
                (group.slots.first()?.duration_us.into(), 1)
            };
            Some((sum_us, group.period_us, group.slots.get(..counted)?))
        })
        .collect();
    let all_us: u64 = candidates.iter().map(|(sum_us, ..)| sum_us).sum();
    if all_us <= window_us {
        return None;
    }
    candidates.sort_by_key(|&(sum_us, period_us, _)| (Reverse(sum_us), period_us));
    // The greatest sum may need a smaller group first, so each of the first few leads once.
    const MAX_LEADERS: usize = 16;
    for leader in 0..candidates.len().min(MAX_LEADERS) {
        let mut chosen: Vec<u64> = Vec::new();
        let mut members: Vec<&SlotSpec> = Vec::new();
        let mut chosen_us = 0;
        let others = (0..candidates.len()).filter(|at| *at != leader);
        for at in [leader].into_iter().chain(others) {
            if *looks_left == 0 {
                return None;
            }
            let Some(&(sum_us, period_us, group)) = candidates.get(at) else {
                continue;
            };
            let meets = |other: &u64| {
                *looks_left = looks_left.saturating_sub(1);
                window_us.is_multiple_of(gcd(period_us, *other))
            };
            if chosen.iter().all(meets) {
                chosen.push(period_us);
                members.extend(group.iter());
                chosen_us += sum_us;
            }
        }
        // A slot may last longer than a window in which it meets no other: one alone proves
        // nothing.
        if members.len() > 1 && chosen_us > window_us {
            return Some(smallest_proof(window_us, members));
        }
    }
    None
}

/// As few of the slots as crowd the window already, longest first; never one alone, which crowds
/// nobody.
fn smallest_proof(window_us: u64, mut members: Vec<&SlotSpec>) -> Infeasibility {
    members.sort_by_key(|slot| (Reverse(slot.duration_us), slot.number));
    let mut sum_us = 0;
    let mut numbers = Vec::new();
    for slot in members {
        numbers.push(slot.number);
        sum_us += u64::from(slot.duration_us);
        if numbers.len() > 1 && sum_us > window_us {
            break;
        }
    }
    numbers.sort_unstable();
    Infeasibility::Crowded {
        slots: numbers,
        window_us,
        sum_us,
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::schedule::{Outcome, check, solve};

    fn slots(count: u32, period_us: impl Fn(u32) -> u32, duration_us: u32) -> Vec<SlotSpec> {
        (1..=count)
            .map(|number| SlotSpec {
                number,
                period_us: period_us(number),
                duration_us,
                fixed_start_us: None,
            })
            .collect()
    }

    #[test]
    fn looks_at_thousands_of_periods_are_counted() {
        // No two of these periods are alike, and the common divisors of many are.
        let slots = slots(4_096, |number| 12_000 * (number + 9), 4);
        let mut clock = Clock::new(Duration::MAX).with_ticks(MAX_LOOKS * 2);
        assert_eq!(windows(&slots, &mut clock), None);
        assert!(!clock.is_over(), "it ends by itself");
        let mut short = Clock::new(Duration::MAX).with_ticks(1_000);
        assert_eq!(windows(&slots, &mut short), None);
        assert!(short.is_over(), "what it does is counted");
    }

    #[test]
    fn hundreds_of_periods_leave_the_search_its_time() {
        let slots = slots(200, |number| 12_000 * (number + 9), 4);
        let Outcome::Feasible(schedule) = solve(&slots, Duration::from_secs(60)) else {
            panic!("there is much room");
        };
        assert_eq!(check(&slots, &schedule.starts_us), Ok(()));
    }
}
