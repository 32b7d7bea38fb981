//! Chains that a set of slots implies, for proofs.
//!
//! Slots that do not overlap modulo the greatest common divisor of their periods do not overlap modulo any multiple of it. So let some of the slots
//! count with other periods m_i that form a chain, such that for each two of them gcd(T_i, T_j) divides the smaller of m_i and m_j: whatever
//! schedule the slots have is one of the chain too. If the chain has none, nor have they. Longer periods ask for less, so each slot takes the
//! shortest that fits.

use std::collections::BTreeMap;

use super::chain::{MAX_CHAIN_SLOTS, Member};
use super::{SlotSpec, gcd};

/// The most chains that are looked at.
const MAX_CHAINS: usize = 128;

/// No slot counts with a longer period, in microseconds: all sums fit 64 bits.
const MAX_COUNTED_US: u64 = 1 << 40;

/// The most different periods.
const MAX_PERIODS: usize = 48;

/// The chains that may prove something, those that ask for most time first. Empty where there are too many periods.
pub(super) fn chains(slots: &[SlotSpec]) -> Vec<Vec<Member>> {
    let mut by_period: BTreeMap<u64, Vec<usize>> = BTreeMap::new();
    for (index, slot) in slots.iter().enumerate() {
        by_period
            .entry(slot.period_us.into())
            .or_default()
            .push(index);
    }
    let periods_us: Vec<u64> = by_period.keys().copied().collect();
    if periods_us.len() > MAX_PERIODS {
        return Vec::new();
    }
    let mut spines: Vec<Vec<u64>> = Vec::new();
    extend(&mut Vec::new(), &periods_us, &mut spines);
    let mut chains: Vec<(f64, Vec<Member>)> = spines
        .iter()
        .map(|spine| {
            let members = members(slots, &by_period, spine);
            let load = members
                .iter()
                .map(|member| member.duration_us as f64 / member.period_us as f64)
                .sum();
            (load, members)
        })
        .filter(|(_, members)| members.len() <= MAX_CHAIN_SLOTS)
        .collect();
    chains.sort_by(|a, b| b.0.total_cmp(&a.0));
    chains.into_iter().map(|(_, members)| members).collect()
}

/// All chains of periods that no further period extends, as far as their number is bounded.
fn extend(spine: &mut Vec<u64>, periods_us: &[u64], spines: &mut Vec<Vec<u64>>) {
    if spines.len() >= MAX_CHAINS {
        return;
    }
    let last = spine.last().copied().unwrap_or(1);
    let multiples: Vec<u64> = periods_us
        .iter()
        .copied()
        .filter(|&period_us| period_us > last && period_us.is_multiple_of(last))
        .collect();
    // Next is only what no other one stands between.
    let nearest: Vec<u64> = multiples
        .iter()
        .copied()
        .filter(|&candidate| {
            !multiples
                .iter()
                .any(|&other| other < candidate && candidate.is_multiple_of(other))
        })
        .collect();
    if nearest.is_empty() && !spine.is_empty() {
        spines.push(spine.clone());
    }
    for next in nearest {
        spine.push(next);
        extend(spine, periods_us, spines);
        spine.pop();
    }
}

/// The slots that can count along a spine, each with the period that it counts with.
fn members(
    slots: &[SlotSpec],
    by_period: &BTreeMap<u64, Vec<usize>>,
    spine: &[u64],
) -> Vec<Member> {
    // (period, counted period), first those of the spine itself.
    let mut counted: Vec<(u64, u64)> = spine
        .iter()
        .map(|&period_us| (period_us, period_us))
        .collect();
    let mut rest: Vec<(u64, &Vec<usize>)> = by_period
        .iter()
        .filter(|(period_us, _)| !spine.contains(period_us))
        .map(|(&period_us, indices)| (period_us, indices))
        .collect();
    let load = |period_us: u64, indices: &[usize]| {
        let sum: u64 = indices
            .iter()
            .map(|&index| u64::from(slots[index].duration_us))
            .sum();
        sum as f64 / period_us as f64
    };
    rest.sort_by(|a, b| load(b.0, b.1).total_cmp(&load(a.0, a.1)));
    for (period_us, indices) in rest {
        let fits = |candidate: u64| {
            let alone = indices.len() < 2 || candidate.is_multiple_of(period_us);
            alone
                && counted.iter().all(|&(other_us, other_counts)| {
                    candidate
                        .min(other_counts)
                        .is_multiple_of(gcd(period_us, other_us))
                })
        };
        // A multiple of the longest one continues the chain, but asks for least.
        let longest = spine.last().copied().unwrap_or(1);
        let beyond = longest / gcd(longest, period_us) * period_us;
        if let Some(counts) = spine
            .iter()
            .copied()
            .chain((beyond <= MAX_COUNTED_US).then_some(beyond))
            .find(|&candidate| fits(candidate))
        {
            // Two that both go beyond need not divide each other.
            if counts <= longest
                || counted
                    .iter()
                    .all(|&(_, other)| counts.is_multiple_of(other) || other.is_multiple_of(counts))
            {
                counted.push((period_us, counts));
            }
        }
    }
    let mut members: Vec<Member> = counted
        .into_iter()
        .flat_map(|(period_us, counts)| {
            by_period
                .get(&period_us)
                .into_iter()
                .flatten()
                .map(move |&index| Member {
                    index,
                    period_us: counts,
                    duration_us: slots[index].duration_us.into(),
                })
        })
        .collect();
    members.sort_by_key(|member| member.index);
    members
}
