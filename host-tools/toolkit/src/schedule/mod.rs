//! Start times of the slots: search, proof, check.
//!
//! Slots are strictly periodic and never preempt each other: slot i with period T_i and duration C_i needs one start s_i with
//! 0 ≤ s_i < T_i such that no two occurrences of any slots ever overlap. Two slots i, j fit if and only if, with g = gcd(T_i, T_j),
//! C_i ≤ (s_j − s_i) mod g ≤ g − C_j (Korst, Aarts, Lenstra). Nothing here ever lists the occurrences of a hyperperiod.
//!
//! ```
//! use esm_toolkit::schedule::{Limit, Outcome, SlotSpec, check, solve};
//!
//! let slot = |number, period_us, duration_us| SlotSpec { number, period_us, duration_us, fixed_start_us: None };
//! let slots = [slot(1, 4_000, 1_000), slot(2, 6_000, 1_000)];
//! let Outcome::Feasible(schedule) = solve(&slots, Limit::pieces(1_000_000)) else { panic!() };
//! assert_eq!(check(&slots, &schedule.starts_us), Ok(()));
//! ```

mod bounds;
mod chain;
mod clock;
mod columns;
mod construct;
mod cure;
mod ejection;
mod frames;
mod growth;
pub mod handover;
mod infeasibility;
pub mod instances;
mod orders;
mod proof;
pub(crate) mod random;
mod search;
mod snap;
mod spread;

use std::collections::BTreeMap;

use serde::Serialize;

use crate::model::Model;

pub use clock::{Limit, Now};
pub use cure::{Change, Cure};
pub use growth::{Growth, growth};
pub use infeasibility::Infeasibility;
pub use snap::{MAX_SNAP_PERCENT, RateChange, Snap, snap};

/// The most slots that are laid out: more than any robot's table has, and few enough to compare each with each.
pub const MAX_SLOTS: usize = esm_core::format::MAX_SLOTS as usize;

/// What the search needs to know of a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SlotSpec {
    /// The number that it was declared with, for messages.
    pub number: u32,
    /// Period in microseconds, above 0.
    pub period_us: u32,
    /// Duration in microseconds.
    pub duration_us: u32,
    /// A start that is given: 0 for the interpreter's slot.
    pub fixed_start_us: Option<u32>,
}

impl SlotSpec {
    /// The slots of a model in their order; the interpreter's starts at 0.
    pub fn of_model(model: &Model) -> Vec<SlotSpec> {
        model
            .slots
            .iter()
            .enumerate()
            .map(|(index, slot)| SlotSpec {
                number: slot.number,
                period_us: slot.period_us,
                duration_us: slot.duration_us,
                fixed_start_us: (model.interpreter_slot == Some(index)).then_some(0),
            })
            .collect()
    }
}

/// Start times that [`check`] has found right.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Schedule {
    /// Start of each slot in microseconds, in the order of the slots given; 0 ≤ start < period.
    pub starts_us: Vec<u32>,
}

/// What a search came to.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// A schedule.
    Feasible(Schedule),
    /// There is none, and why.
    Infeasible(Infeasibility),
    /// The search ended without an answer: its time ran out, or there are more than [`MAX_SLOTS`] slots.
    Undecided,
}

/// Searches for start times for at most `limit`. Equal slots give equal answers, but for searches
/// that the limit cuts off.
pub fn solve(slots: &[SlotSpec], limit: impl Into<Limit>) -> Outcome {
    solve_within(slots, &mut clock::Clock::new(limit))
}

/// [`solve`] with a clock that may count work instead of time.
fn solve_within(slots: &[SlotSpec], clock: &mut clock::Clock) -> Outcome {
    if let Some(reason) = bounds::single_slots(slots) {
        return Outcome::Infeasible(reason);
    }
    if slots.len() > MAX_SLOTS {
        return Outcome::Undecided;
    }
    if let Some(reason) = bounds::windows(slots, clock) {
        return Outcome::Infeasible(reason);
    }
    let outcome = search::search(slots, clock);
    if let Outcome::Feasible(schedule) = &outcome
        && check(slots, &schedule.starts_us).is_err()
    {
        // Never trusted: what the checker refuses is no schedule.
        debug_assert!(
            false,
            "the search found {schedule:?}, the checker refuses it"
        );
        return Outcome::Undecided;
    }
    outcome
}

/// Whether slots ask for more time than there is, and which of them for most of it.
pub fn overcommitted(slots: &[SlotSpec]) -> Option<Infeasibility> {
    bounds::overcommitted(slots)
}

/// Greatest common divisor; that of 0 and n is n.
pub(crate) fn gcd(mut a: u64, mut b: u64) -> u64 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

// ─── Check ────────────────────────────────────────────────────────────────────────────────────────────────────────────

/// Two slots of which some occurrences overlap, by index, or one whose start is out of its range (then both are that one).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clash {
    /// Index of a slot.
    pub first: usize,
    /// Index of the other.
    pub second: usize,
}

/// Checks start times by the definition alone, independently of how they were found.
///
/// # Errors
/// The first pair that clashes. A slot without a start, or with one outside of its period or other than the one given, clashes with
/// itself.
pub fn check(slots: &[SlotSpec], starts_us: &[u32]) -> Result<(), Clash> {
    for (first, slot) in slots.iter().enumerate() {
        let start_us = starts_us.get(first).copied();
        let is_in_range = start_us.is_some_and(|start_us| start_us < slot.period_us);
        let is_as_given = slot.fixed_start_us.is_none() || slot.fixed_start_us == start_us;
        if !is_in_range || !is_as_given || slot.duration_us > slot.period_us {
            return Err(Clash {
                first,
                second: first,
            });
        }
    }
    // Slots of one period have the same divisors with others: these are worked out once for all of them.
    let mut by_period: BTreeMap<u32, Vec<(usize, Occurring)>> = BTreeMap::new();
    for (index, (slot, &start_us)) in slots.iter().zip(starts_us).enumerate() {
        let occurring = Occurring {
            start_us: start_us.into(),
            duration_us: slot.duration_us.into(),
        };
        by_period
            .entry(slot.period_us)
            .or_default()
            .push((index, occurring));
    }
    let mut clash: Option<Clash> = None;
    for (&period_a, group_a) in &by_period {
        for (&period_b, group_b) in by_period.range(period_a..) {
            let divisor_us = gcd(period_a.into(), period_b.into());
            for (first, a) in group_a {
                for (second, b) in group_b {
                    if first != second && !a.fits(b, divisor_us) && !b.fits(a, divisor_us) {
                        let found = Clash {
                            first: *first.min(second),
                            second: *first.max(second),
                        };
                        let is_earlier = clash.is_none_or(|clash| {
                            (found.second, found.first) < (clash.second, clash.first)
                        });
                        clash = if is_earlier { Some(found) } else { clash };
                    }
                }
            }
        }
    }
    clash.map_or(Ok(()), Err)
}

/// Start and duration of a slot, in microseconds.
#[derive(Clone, Copy)]
struct Occurring {
    start_us: u64,
    duration_us: u64,
}

impl Occurring {
    /// Whether no occurrences of two slots overlap whose periods have this greatest common divisor: the theorem of Korst, Aarts and Lenstra. Asked the other
    /// way round, it says the same, but where both start at once: there one without duration fits before the other, and not behind it.
    fn fits(&self, other: &Occurring, divisor_us: u64) -> bool {
        let distance_us = (other.start_us + divisor_us - self.start_us % divisor_us) % divisor_us;
        self.duration_us <= distance_us && distance_us + other.duration_us <= divisor_us
    }
}

// ─── Report ───────────────────────────────────────────────────────────────────────────────────────────────────────────

/// What `esm schedule` tells, in the form of its JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Whether there is a schedule; `None` where that is undecided.
    pub feasible: Option<bool>,
    /// Least common multiple of the periods in microseconds, 1 without slots; `None` where it exceeds 64 bits.
    pub hyperperiod_us: Option<u64>,
    /// Sum of duration over period.
    pub utilisation: f64,
    /// The slots with their starts; empty without a schedule.
    pub slots: Vec<SlotReport>,
    /// Why there is no schedule, in words; `None` otherwise.
    pub reason: Option<String>,
    /// What to change, in words, where there is no schedule.
    pub cure: Option<String>,
    /// By which factor all durations may grow together with these starts; `None` without a schedule, or where nothing lasts.
    pub growth_factor: Option<f64>,
    /// Changes of rates that make the slots easy; there only where they were asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub snap: Option<Vec<SnapReport>>,
}

/// A slot of a [`Report`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SlotReport {
    /// Number of the slot.
    pub slot: u32,
    /// Its first start in microseconds, below its period.
    pub start_us: u32,
    /// Its period in microseconds.
    pub period_us: u32,
    /// Its duration in microseconds.
    pub duration_us: u32,
    /// By how many microseconds it may last longer, alone, with these starts.
    pub growth_us: u32,
}

/// Puts slots and outcome together for `esm schedule`.
pub fn report(slots: &[SlotSpec], outcome: &Outcome) -> Report {
    let (feasible, starts_us, reason) = match outcome {
        Outcome::Feasible(schedule) => (Some(true), schedule.starts_us.as_slice(), None),
        Outcome::Infeasible(reason) => (Some(false), &[][..], Some(reason)),
        Outcome::Undecided => (None, &[][..], None),
    };
    let growth = growth(slots.get(..starts_us.len()).unwrap_or(slots), starts_us);
    Report {
        feasible,
        hyperperiod_us: hyperperiod_us(slots),
        utilisation: utilisation(slots.iter().map(|slot| (slot.period_us, slot.duration_us))),
        slots: slots
            .iter()
            .zip(starts_us)
            .zip(&growth.alone_us)
            .map(|((slot, &start_us), &growth_us)| SlotReport {
                slot: slot.number,
                start_us,
                period_us: slot.period_us,
                duration_us: slot.duration_us,
                growth_us,
            })
            .collect(),
        reason: reason.map(Infeasibility::to_string),
        cure: reason.map(|reason| reason.cure(slots).to_string()),
        growth_factor: growth.together,
        snap: None,
    }
}

/// A proposal of [`snap`], in the form of its JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SnapReport {
    /// Whether each period divides the next longer one then.
    pub harmonic: bool,
    /// Least common multiple of the periods in microseconds; `None` where it exceeds 64 bits.
    pub hyperperiod_us: Option<u64>,
    /// Sum of duration over period.
    pub utilisation: f64,
    /// Sum of the changes of all slots in percent, each counted as positive.
    pub total_percent: f64,
    /// The slots whose rates change.
    pub changes: Vec<SnapChange>,
}

/// A change of a [`SnapReport`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SnapChange {
    /// Number of the slot.
    pub slot: u32,
    /// Its period in microseconds.
    pub period_us: u32,
    /// The new one.
    pub new_period_us: u32,
    /// By how much the period changes, in percent; above 0 where the slot becomes slower.
    pub percent: f64,
}

/// Puts a proposal into the form of its JSON.
pub fn snap_report(snap: &Snap) -> SnapReport {
    SnapReport {
        harmonic: snap.is_harmonic(),
        hyperperiod_us: hyperperiod_us(&snap.slots),
        utilisation: utilisation(
            snap.slots
                .iter()
                .map(|slot| (slot.period_us, slot.duration_us)),
        ),
        total_percent: snap.total_percent(),
        changes: snap
            .changes
            .iter()
            .map(|change| SnapChange {
                slot: change.slot,
                period_us: change.from_us,
                new_period_us: change.to_us,
                percent: change.percent(),
            })
            .collect(),
    }
}

/// Least common multiple of the periods in microseconds; `None` where it exceeds 64 bits.
pub fn hyperperiod_us(slots: &[SlotSpec]) -> Option<u64> {
    slots.iter().try_fold(1_u64, |multiple, slot| {
        let period_us = u64::from(slot.period_us.max(1));
        multiple.checked_mul(period_us / gcd(multiple, period_us))
    })
}

// ─── Utilisation ──────────────────────────────────────────────────────────────────────────────────────────────────────

/// Sum of duration over period of (period, duration) pairs, to the precision of `f64`.
pub fn utilisation(times_us: impl Iterator<Item = (u32, u32)>) -> f64 {
    times_us
        .map(|(period_us, duration_us)| f64::from(duration_us) / f64::from(period_us.max(1)))
        // Not `sum`, which gives -0 for nothing.
        .fold(0.0, |sum, share| sum + share)
}

/// Whether duration over period of (period, duration) pairs sum up to more than 1: exactly, where [`utilisation`] rounds.
///
/// Sums that are nearer to 1 than 2⁻⁶⁴ a slot are worked out as a fraction; one whose denominator exceeds 128 bits counts as 1.
pub fn exceeds_one(times_us: impl Iterator<Item = (u32, u32)> + Clone) -> bool {
    const ONE: u128 = 1 << 64;
    let mut floor_sum = 0_u128;
    let mut terms = 0_u128;
    for (period_us, duration_us) in times_us.clone() {
        floor_sum += (u128::from(duration_us) << 64) / u128::from(period_us.max(1));
        terms += 1;
    }
    // Each term is less than 1/2⁶⁴ below its value.
    if floor_sum > ONE || floor_sum + terms <= ONE {
        return floor_sum > ONE;
    }
    exact_sum(times_us).is_some_and(|(numerator, denominator)| numerator > denominator)
}

/// The sum of duration over period as a fraction, where that fits 128 bits.
fn exact_sum(times_us: impl Iterator<Item = (u32, u32)>) -> Option<(u128, u128)> {
    let wide_gcd = |mut a: u128, mut b: u128| {
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a.max(1)
    };
    let (mut numerator, mut denominator) = (0_u128, 1_u128);
    for (period_us, duration_us) in times_us {
        let period_us = u128::from(period_us.max(1));
        let common = wide_gcd(denominator, period_us);
        let scale = period_us / common;
        let share = u128::from(duration_us).checked_mul(denominator / common)?;
        numerator = numerator.checked_mul(scale)?.checked_add(share)?;
        denominator = denominator.checked_mul(scale)?;
        let reduce = wide_gcd(numerator, denominator);
        numerator /= reduce;
        denominator /= reduce;
    }
    Some((numerator, denominator))
}

#[cfg(test)]
mod tests;

#[cfg(test)]
mod oracle;
