//! Proofs that there is no schedule, by counting.

use std::collections::{BTreeMap, BTreeSet};

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

/// Slots that ask for more time than there is, those with the greatest shares named until the others fit.
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

/// Slots that crowd a window.
///
/// Two slots do not overlap if and only if they do not overlap modulo the greatest common divisor of their periods; then they do not
/// overlap modulo any multiple of it either. So slots whose common divisors, pair by pair, all divide one number W have one
/// occurrence each in a circle of W, side by side: their durations must sum up to at most W. Pairs are the smallest case.
pub(super) fn windows(slots: &[SlotSpec]) -> Option<Infeasibility> {
    // Longest first: of slots of one period that exclude each other in the window, the longest counts.
    let mut by_period: BTreeMap<u64, Vec<&SlotSpec>> = BTreeMap::new();
    for slot in slots {
        by_period
            .entry(slot.period_us.into())
            .or_default()
            .push(slot);
    }
    for group in by_period.values_mut() {
        group.sort_by_key(|slot| (std::cmp::Reverse(slot.duration_us), slot.number));
    }
    let periods: Vec<u64> = by_period.keys().copied().take(MAX_PERIODS).collect();
    let mut windows: BTreeSet<u64> = BTreeSet::new();
    for (position, &a) in periods.iter().enumerate() {
        for &b in periods.iter().skip(position) {
            windows.insert(gcd(a, b));
        }
    }
    windows
        .into_iter()
        .take(MAX_WINDOWS)
        .find_map(|window_us| crowded(window_us, &by_period))
}

/// Gathers slots that meet in a window, greedily, and looks whether they fit.
fn crowded(window_us: u64, by_period: &BTreeMap<u64, Vec<&SlotSpec>>) -> Option<Infeasibility> {
    let meets = |a: u64, b: u64| window_us.is_multiple_of(gcd(a, b));
    // All slots of a period that divides the window meet there with each other; of another period one alone counts.
    let mut candidates: Vec<(u64, &[&SlotSpec])> = by_period
        .iter()
        .map(|(&period_us, group)| {
            let counted = if window_us.is_multiple_of(period_us) {
                group.len()
            } else {
                1
            };
            (period_us, group.get(..counted).unwrap_or(group))
        })
        .collect();
    let sum =
        |group: &[&SlotSpec]| -> u64 { group.iter().map(|slot| u64::from(slot.duration_us)).sum() };
    candidates.sort_by_key(|(period_us, group)| (std::cmp::Reverse(sum(group)), *period_us));
    // The greatest sum may need a smaller group first, so each of the first few leads once.
    const MAX_LEADERS: usize = 16;
    for leader in 0..candidates.len().min(MAX_LEADERS) {
        let mut chosen: Vec<u64> = Vec::new();
        let mut members: Vec<&SlotSpec> = Vec::new();
        let ordered = candidates.get(leader).into_iter().chain(
            candidates
                .iter()
                .enumerate()
                .filter(|(at, _)| *at != leader)
                .map(|(_, c)| c),
        );
        for (period_us, group) in ordered {
            if chosen.iter().all(|&other| meets(*period_us, other)) {
                chosen.push(*period_us);
                members.extend(group.iter());
            }
        }
        // A slot may last longer than a window in which it meets no other: one alone proves nothing.
        if members.len() > 1 && sum(&members) > window_us {
            return Some(smallest_proof(window_us, members));
        }
    }
    None
}

/// As few of the slots as crowd the window already, longest first; never one alone, which crowds nobody.
fn smallest_proof(window_us: u64, mut members: Vec<&SlotSpec>) -> Infeasibility {
    members.sort_by_key(|slot| (std::cmp::Reverse(slot.duration_us), slot.number));
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
