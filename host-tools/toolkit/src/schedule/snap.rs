//! Which small changes of rates make slots easy: `esm schedule --snap`.
//!
//! Three ways are tried. One *mends*: as long as there is a proof that there is no schedule, one of
//! the slots that it names gets the nearest other period with which those slots have one. The other
//! *lines up*: all periods move to a chain in which each divides the next, for then hardly anything
//! speaks against a schedule, and everything repeats soon. One *evens out*: all periods become
//! multiples of one unit, which takes smaller changes than a chain where rates are awkward. No
//! period leaves the tolerance around the one that was declared. What comes out is solved and
//! checked like any other set.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use super::cure::{Change, Trials};
use super::{Infeasibility, Outcome, Schedule, SlotSpec, gcd};

/// The most that a period may change, in percent.
pub const MAX_SNAP_PERCENT: u32 = 50;

/// As many changes are made one after another to mend a set.
const MAX_MENDS: usize = 12;

/// As many shortest periods are tried for a chain.
const MAX_BASES: usize = 64;

/// As many chains are kept at each step to the next longer period.
const MAX_KEPT_CHAINS: usize = 32;

/// As many chains are searched for a schedule, those with the smallest changes.
const MAX_SOLVED_CHAINS: usize = 12;

/// As many units are tried, and as many pairs of rows compared, to even periods out.
const MAX_UNITS: u32 = 4_096;
const MAX_PAIRS: usize = 2_000_000;

/// As many sets of multiples are searched for a schedule, those with the smallest changes, with as
/// many small pieces of work in all.
const MAX_TRIED_UNITS: usize = 1_000;
const EVEN_TICKS: u64 = 8_000_000;

/// A long period may be a multiple of a power of two times the unit, so that fewer places are
/// taken: of one that it holds as often as this at least. With 0 it is a multiple of the unit
/// itself.
const FINENESS: [u32; 5] = [2, 4, 8, 16, 0];

/// Small pieces of work that the search for one schedule may take.
const SOLVE_TICKS: u64 = 4_000_000;

/// The period of a slot changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RateChange {
    /// Number of the slot.
    pub slot: u32,
    /// Its period in microseconds.
    pub from_us: u32,
    /// The new one.
    pub to_us: u32,
}

impl RateChange {
    /// By how much the period changes, in percent; above 0 where the slot becomes slower.
    pub fn percent(&self) -> f64 {
        (f64::from(self.to_us) - f64::from(self.from_us)) * 100.0 / f64::from(self.from_us.max(1))
    }
}

/// A set that is easy, and what leads to it.
#[derive(Clone, Debug, PartialEq)]
pub struct Snap {
    /// The changes, in the order of the slots. Empty if the slots are easy as they are.
    pub changes: Vec<RateChange>,
    /// The slots with the changes made.
    pub slots: Vec<SlotSpec>,
    /// Their schedule, checked.
    pub schedule: Schedule,
}

impl Snap {
    /// Sum of the changes of all slots, in percent, each counted as positive.
    pub fn total_percent(&self) -> f64 {
        self.changes.iter().fold(0.0, |sum, change| {
            let percent = change.percent();
            sum + if percent < 0.0 { -percent } else { percent }
        })
    }

    /// Whether each period divides the next longer one.
    pub fn is_harmonic(&self) -> bool {
        is_chain(&self.slots)
    }
}

/// Sets with schedules that slots turn into if no period changes by more than `percent`, the
/// smallest total change first: one that is mended, one whose periods divide each other, and one
/// that is evened out if that takes less than both, where they are found.
pub fn snap(slots: &[SlotSpec], percent: u32) -> Vec<Snap> {
    let percent = percent.min(MAX_SNAP_PERCENT);
    let mended = mend(slots, percent);
    let is_easy = |snap: &Snap| snap.changes.is_empty() && snap.is_harmonic();
    let lined_up = match &mended {
        Some(snap) if is_easy(snap) => None,
        _ => line_up(slots, percent),
    };
    let mut snaps: Vec<Snap> = mended.into_iter().chain(lined_up).collect();
    let least = (snaps.iter().map(Snap::total_percent)).fold(f64::INFINITY, f64::min);
    if least > 0.0 {
        // Small changes first: where much is allowed, there are so many sets that the right one may
        // not be reached.
        let evened = [percent.div_ceil(4), percent.div_ceil(2), percent]
            .into_iter()
            .find_map(|percent| even_out(slots, percent));
        snaps.extend(evened.filter(|snap| snap.total_percent() < least));
    }
    snaps.sort_by(|a, b| a.total_percent().total_cmp(&b.total_percent()));
    snaps.dedup_by(|a, b| a.slots == b.slots);
    snaps
}

/// The periods that a slot may have: not shorter than it lasts, and after its start if that is
/// given.
fn range_us(slot: &SlotSpec, percent: u32) -> std::ops::RangeInclusive<u32> {
    let part_us = u64::from(slot.period_us) * u64::from(percent) / 100;
    let part_us = u32::try_from(part_us).unwrap_or(0);
    let shortest_us = (slot.period_us - part_us.min(slot.period_us))
        .max(slot.duration_us)
        .max(
            slot.fixed_start_us
                .map_or(1, |start_us| start_us.saturating_add(1)),
        );
    shortest_us..=slot.period_us.saturating_add(part_us)
}

fn is_chain(slots: &[SlotSpec]) -> bool {
    let mut periods_us: Vec<u32> = slots.iter().map(|slot| slot.period_us).collect();
    periods_us.sort_unstable();
    periods_us
        .windows(2)
        .all(|pair| pair[0] != 0 && pair[1].is_multiple_of(pair[0]))
}

/// What became of slots, if it has a schedule.
fn solved(slots: &[SlotSpec], changed: Vec<SlotSpec>) -> Result<Snap, Outcome> {
    match Trials::new(SOLVE_TICKS).solve(&changed) {
        Outcome::Feasible(schedule) => Ok(Snap {
            changes: slots
                .iter()
                .zip(&changed)
                .filter(|(before, after)| before.period_us != after.period_us)
                .map(|(before, after)| RateChange {
                    slot: before.number,
                    from_us: before.period_us,
                    to_us: after.period_us,
                })
                .collect(),
            slots: changed,
            schedule,
        }),
        outcome => Err(outcome),
    }
}

// ─── Mending ─────────────────────────────────────────────────────────────────────────────────────

/// Changes one period after another of what is proved to have no schedule.
fn mend(slots: &[SlotSpec], percent: u32) -> Option<Snap> {
    let allowed: BTreeMap<u32, std::ops::RangeInclusive<u32>> = slots
        .iter()
        .map(|slot| (slot.number, range_us(slot, percent)))
        .collect();
    let mut changed = slots.to_vec();
    for _ in 0..MAX_MENDS {
        let reason = match solved(slots, changed.clone()) {
            Ok(snap) => return Some(snap),
            Err(Outcome::Infeasible(reason)) => reason,
            Err(_) => return None,
        };
        let core: Vec<SlotSpec> = match &reason {
            Infeasibility::Crowded { slots, .. }
            | Infeasibility::Packing { slots, .. }
            | Infeasibility::Orders { slots, .. } => changed
                .iter()
                .filter(|slot| slots.contains(&slot.number))
                .copied()
                .collect(),
            Infeasibility::Exhausted { .. } => changed.clone(),
            _ => return None,
        };
        let is_allowed = |slot: &SlotSpec, to_us: u32| {
            allowed
                .get(&slot.number)
                .is_some_and(|range_us| range_us.contains(&to_us))
        };
        let change = Trials::new(SOLVE_TICKS).other_period(&core, &is_allowed)?;
        changed = Change::applied(&change, &changed);
    }
    None
}

// ─── Lining up ───────────────────────────────────────────────────────────────────────────────────

/// Slots with one period, as declared.
struct Row {
    period_us: u32,
    /// The periods that all of them may have.
    shortest_us: u32,
    longest_us: u32,
    count: u32,
    /// The longest duration among them, and the next.
    durations_us: [u32; 2],
}

/// Periods for the first rows, each of which divides the next, and what they cost: the sum of the
/// changes of all slots, in millionths.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Line {
    cost: u64,
    periods_us: Vec<u32>,
}

/// The slots by their periods, the shortest first.
fn rows(slots: &[SlotSpec], percent: u32) -> Vec<Row> {
    let mut by_period: BTreeMap<u32, Row> = BTreeMap::new();
    for slot in slots {
        let range_us = range_us(slot, percent);
        let row = by_period.entry(slot.period_us).or_insert(Row {
            period_us: slot.period_us,
            shortest_us: 1,
            longest_us: u32::MAX,
            count: 0,
            durations_us: [0; 2],
        });
        row.shortest_us = row.shortest_us.max(*range_us.start());
        row.longest_us = row.longest_us.min(*range_us.end());
        row.count += 1;
        let [longest_us, next_us] = row.durations_us;
        row.durations_us = if slot.duration_us > longest_us {
            [slot.duration_us, longest_us]
        } else {
            [longest_us, next_us.max(slot.duration_us)]
        };
    }
    by_period.into_values().collect()
}

/// The slots with the periods of their rows.
fn with_periods(slots: &[SlotSpec], rows: &[Row], periods_us: &[u32]) -> Vec<SlotSpec> {
    let changed = |slot: &SlotSpec| {
        let row = rows.partition_point(|row| row.period_us < slot.period_us);
        SlotSpec {
            period_us: periods_us.get(row).copied().unwrap_or(slot.period_us),
            ..*slot
        }
    };
    slots.iter().map(changed).collect()
}

/// What it costs that the slots of a row get another period: the sum of their changes, in
/// millionths.
fn cost(row: &Row, to_us: u32) -> u64 {
    u64::from(row.period_us.abs_diff(to_us)) * 1_000_000 / u64::from(row.period_us.max(1))
        * u64::from(row.count)
}

/// The chain with the smallest total change that has a schedule.
fn line_up(slots: &[SlotSpec], percent: u32) -> Option<Snap> {
    let rows = rows(slots, percent);
    let mut lines: Vec<Line> = bases_us(&rows)
        .into_iter()
        .flat_map(|base_us| lines(&rows, base_us))
        .collect();
    lines.sort_unstable();
    lines.dedup();
    lines
        .into_iter()
        .take(MAX_SOLVED_CHAINS)
        .find_map(|line| solved(slots, with_periods(slots, &rows, &line.periods_us)).ok())
}

/// Shortest periods that some of the rows have as a divisor already, those of most slots first.
fn bases_us(rows: &[Row]) -> Vec<u32> {
    let Some(first) = rows.first() else {
        return Vec::new();
    };
    let mut counts: BTreeMap<u32, u32> = BTreeMap::new();
    for row in rows {
        let most = row.period_us / first.shortest_us.max(1);
        for parts in (row.period_us / first.longest_us.max(1)).max(1)..=most {
            let base_us = row.period_us / parts;
            let is_exact = base_us * parts == row.period_us;
            if is_exact && (first.shortest_us..=first.longest_us).contains(&base_us) {
                *counts.entry(base_us).or_default() += row.count;
            }
        }
    }
    let mut bases_us: Vec<(u32, u32)> = counts.into_iter().collect();
    bases_us.sort_by_key(|&(base_us, count)| (Reverse(count), base_us));
    bases_us.truncate(MAX_BASES);
    bases_us.into_iter().map(|(base_us, _)| base_us).collect()
}

/// Chains that begin with a base, those with the smallest changes.
fn lines(rows: &[Row], base_us: u32) -> Vec<Line> {
    let mut lines = vec![Line {
        cost: 0,
        periods_us: Vec::new(),
    }];
    for row in rows {
        let mut longer: Vec<Line> = Vec::new();
        for line in &lines {
            let last_us = line.periods_us.last().copied();
            let unit_us = last_us.unwrap_or(base_us).max(1);
            let most = if last_us.is_none() {
                1
            } else {
                row.longest_us / unit_us
            };
            for times in row.shortest_us.div_ceil(unit_us).max(1)..=most {
                let to_us = unit_us * times;
                if !(row.shortest_us..=row.longest_us).contains(&to_us) {
                    continue;
                }
                let mut periods_us = line.periods_us.clone();
                periods_us.push(to_us);
                longer.push(Line {
                    cost: line.cost + cost(row, to_us),
                    periods_us,
                });
                if longer.len() > MAX_KEPT_CHAINS * MAX_KEPT_CHAINS {
                    break;
                }
            }
        }
        longer.sort_unstable();
        // Of chains that end alike, the first costs least.
        let mut ends: Vec<u32> = Vec::new();
        longer.retain(|line| {
            let end = line.periods_us.last().copied().unwrap_or(0);
            let is_new = !ends.contains(&end);
            if is_new {
                ends.push(end);
            }
            is_new
        });
        longer.truncate(MAX_KEPT_CHAINS);
        lines = longer;
    }
    lines
}

// ─── Evening out ─────────────────────────────────────────────────────────────────────────────────

/// The set of multiples of one unit with the smallest total change that has a schedule.
fn even_out(slots: &[SlotSpec], percent: u32) -> Option<Snap> {
    let rows = rows(slots, percent);
    let longest_us = rows.first()?.longest_us;
    let step_us = (longest_us / MAX_UNITS).max(1);
    let mut lines: Vec<Line> = (1..=longest_us / step_us)
        .flat_map(|units| FINENESS.map(|fineness| (units * step_us, fineness)))
        .filter_map(|(unit_us, fineness)| evened(&rows, unit_us, fineness))
        .collect();
    lines.sort_unstable();
    lines.dedup();
    let mut trials = Trials::new(EVEN_TICKS);
    let pairs_each = rows.len() * (rows.len() + 1) / 2;
    lines
        .into_iter()
        .take(MAX_PAIRS / pairs_each.max(1))
        .filter(|line| pairs_fit(&rows, &line.periods_us))
        .map(|line| with_periods(slots, &rows, &line.periods_us))
        .take(MAX_TRIED_UNITS)
        .find(|changed| trials.works(changed))
        .and_then(|changed| solved(slots, changed).ok())
}

/// The multiples of a unit that come nearest to the periods of the rows. `None` where a row may
/// have no multiple of it.
fn evened(rows: &[Row], unit_us: u32, fineness: u32) -> Option<Line> {
    let mut line = Line {
        cost: 0,
        periods_us: Vec::with_capacity(rows.len()),
    };
    for row in rows {
        let nearest_us = |unit_us: u32| {
            let times =
                (row.period_us / unit_us) + u32::from(row.period_us % unit_us > unit_us / 2);
            let to_us = times.max(1).checked_mul(unit_us)?;
            (row.shortest_us..=row.longest_us)
                .contains(&to_us)
                .then_some(to_us)
        };
        let doublings = match (row.period_us / unit_us).checked_div(fineness) {
            Some(times) => times.checked_ilog2().unwrap_or(0),
            None => 0,
        };
        let to_us = (0..=doublings)
            .rev()
            .find_map(|doublings| nearest_us(unit_us.checked_shl(doublings)?))?;
        line.cost += cost(row, to_us);
        line.periods_us.push(to_us);
    }
    Some(line)
}

/// Whether each two slots fit beside each other with these periods of their rows.
fn pairs_fit(rows: &[Row], periods_us: &[u32]) -> bool {
    let pairs: Vec<(&Row, u32)> = rows.iter().zip(periods_us.iter().copied()).collect();
    pairs.iter().enumerate().all(|(index, &(row, period_us))| {
        let fits = |common_us: u64, durations_us: [u32; 2]| {
            let [first_us, second_us] = durations_us.map(u64::from);
            first_us + second_us <= common_us
        };
        let [longest_us, _] = row.durations_us;
        fits(period_us.into(), row.durations_us)
            && (pairs.iter().skip(index + 1)).all(|&(other, other_us)| {
                fits(
                    gcd(period_us.into(), other_us.into()),
                    [longest_us, other.durations_us[0]],
                )
            })
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::check;
    use super::*;
    use crate::schedule::tests::slots;

    /// (slot, old, new period) of each proposal.
    fn proposals(times_us: &[(u32, u32)], percent: u32) -> Vec<Vec<(u32, u32, u32)>> {
        let triple = |change: &RateChange| (change.slot, change.from_us, change.to_us);
        snap(&slots(times_us), percent)
            .iter()
            .map(|snap| snap.changes.iter().map(triple).collect())
            .collect()
    }

    #[test]
    fn rates_that_are_nearly_harmonic_become_so() {
        let (fast, odd) = ((10_000, 4_000), (19_000, 4_000));
        assert_eq!(
            proposals(&[fast, odd], 10),
            [[(1, 10_000, 9_500)], [(2, 19_000, 20_000)]]
        );
        assert!(proposals(&[fast, odd], 2).is_empty(), "it takes more");
        // Nothing has to change.
        assert_eq!(proposals(&[fast, (20_000, 4_000)], 10), [[]]);
    }

    #[test]
    fn what_is_only_mended_comes_beside_what_is_lined_up() {
        // 10 and 25 ms have 5 ms in common: too little. 30 ms would do, and 11.25, 22.5 and 45 ms
        // divide each other. Multiples of 9 ms are nearer than both.
        let times_us = [(10_000, 4_000), (25_000, 4_000), (45_000, 100)];
        let proposals = proposals(&times_us, 20);
        assert_eq!(
            proposals,
            [
                vec![(1, 10_000, 9_000), (2, 25_000, 27_000)],
                vec![(2, 25_000, 30_000)],
                vec![(1, 10_000, 11_250), (2, 25_000, 22_500)]
            ]
        );
    }

    #[test]
    fn awkward_rates_are_evened_out() {
        // Nearly 3, 7, 11 and 13 ms: they have 1 us in common, and no chain is near.
        let times_us = [(3_001, 200), (7_003, 250), (11_003, 250), (12_998, 300)];
        let changes = proposals(&times_us, 5);
        assert_eq!(changes.len(), 1);
        let after: Vec<u32> = changes[0].iter().map(|&(_, _, to_us)| to_us).collect();
        assert_eq!(after, [3_000, 7_000, 11_000, 13_000]);
        assert!(
            proposals(&times_us, 0).is_empty(),
            "something has to change"
        );
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        /// Whatever is proposed has the schedule that comes with it, and stays within the
        /// tolerance.
        #[test]
        fn proposals_hold_what_they_promise(
            times_us in proptest::collection::vec((prop::sample::select(vec![90_u32, 100, 110, 190, 200, 250, 330, 400]), 1..40_u32), 1..6),
            percent in 0..30_u32,
        ) {
            let slots = slots(&times_us);
            let snaps = snap(&slots, percent);
            for (before, after) in snaps.iter().zip(snaps.iter().skip(1)) {
                prop_assert!(before.total_percent() <= after.total_percent());
            }
            for snap in snaps {
                prop_assert_eq!(check(&snap.slots, &snap.schedule.starts_us), Ok(()));
                for (before, after) in slots.iter().zip(&snap.slots) {
                    prop_assert_eq!(before.duration_us, after.duration_us);
                    let most_us = before.period_us * percent / 100;
                    prop_assert!(before.period_us.abs_diff(after.period_us) <= most_us);
                }
            }
        }
    }
}
