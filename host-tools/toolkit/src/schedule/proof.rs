//! Proofs that there is no schedule, brought down to the slots that matter.
//!
//! Slots that have no schedule keep having none with more beside them. So each proof is made again
//! with fewer slots, until none of them can be left out.

use super::chain::{self, Chain, End as ChainEnd};
use super::clock::Clock;
use super::frames::{End as FramesEnd, Frames};
use super::orders::{self, End as OrdersEnd};
use super::{Infeasibility, SlotSpec};

/// What is known of a set of slots.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// There is no schedule.
    Refuted,
    /// The proofs of this module come to an end, and do not refute it.
    Passes,
    /// The steps did not suffice.
    Open,
}

/// Steps for each of the smaller sets that a proof is tried with.
const CORE_STEPS: u64 = 2_000;

/// Steps for all of them together.
const ALL_CORE_STEPS: u64 = 40_000;

/// Refutes slots by packing them into frames of their shortest period, in so many steps.
pub(super) fn by_packing(
    slots: &[SlotSpec],
    steps: u64,
    clock: &mut Clock,
) -> Option<Infeasibility> {
    (packing(slots, &mut { steps }, clock) == Verdict::Refuted).then(|| smallest_core(slots, clock))
}

/// What packing says of slots. It counts the steps down that it makes.
pub(super) fn packing(slots: &[SlotSpec], steps_left: &mut u64, clock: &mut Clock) -> Verdict {
    // Periods that divide each other have a search that knows more of them: there, a packing is a
    // schedule.
    let lasting: Vec<SlotSpec> = slots
        .iter()
        .copied()
        .filter(|slot| slot.duration_us > 0)
        .collect();
    if let Some(members) = chain::of_slots(&lasting) {
        let steps = *steps_left;
        let end = Chain::new(&members).search(steps, None, clock);
        *steps_left = match end {
            ChainEnd::GivenUp => 0,
            ChainEnd::Exhausted | ChainEnd::Found(_) => steps.saturating_sub(lasting.len() as u64),
        };
        return match end {
            ChainEnd::Exhausted => Verdict::Refuted,
            ChainEnd::Found(_) => Verdict::Passes,
            ChainEnd::GivenUp => Verdict::Open,
        };
    }
    match Frames::new(&lasting).search(steps_left, clock) {
        FramesEnd::Exhausted => Verdict::Refuted,
        FramesEnd::Packed => Verdict::Passes,
        FramesEnd::GivenUp => Verdict::Open,
    }
}

/// The packing that slots do not have, with as few of them as do not have one already.
pub(super) fn smallest_core(slots: &[SlotSpec], clock: &mut Clock) -> Infeasibility {
    let mut steps_left = ALL_CORE_STEPS;
    let mut core = slots.to_vec();
    core.sort_by_key(|slot| (slot.period_us, slot.duration_us, slot.number));
    let mut refutes = |slots: &[SlotSpec]| {
        let mut steps = CORE_STEPS.min(steps_left);
        let before = steps;
        let verdict = packing(slots, &mut steps, clock);
        steps_left -= before - steps;
        verdict == Verdict::Refuted
    };
    // The shortest periods alone, if they prove it: those that repeat seldom are many, and matter
    // least.
    let ends: Vec<usize> = (1..core.len())
        .filter(|&end| core[end].period_us != core[end - 1].period_us)
        .collect();
    if let Some(end) = ends.into_iter().find(|&end| refutes(&core[..end])) {
        core.truncate(end);
    }
    // In halves, in quarters, … one by one, those that repeat seldom first.
    let mut length = core.len() / 2;
    while length > 0 {
        let mut end = core.len();
        while end > 0 {
            let begin = end.saturating_sub(length);
            let without = [&core[..begin], &core[end..]].concat();
            if !without.is_empty() && refutes(&without) {
                core = without;
            }
            end = begin;
        }
        length /= 2;
    }
    let frame_us = core
        .iter()
        .map(|slot| u64::from(slot.period_us))
        .min()
        .unwrap_or(0);
    Infeasibility::Packing {
        longest: longest(&core),
        slots: numbers(&core),
        frame_us,
    }
}

/// Number of the longest of some slots.
fn longest(slots: &[SlotSpec]) -> u32 {
    slots
        .iter()
        .max_by_key(|slot| (slot.duration_us, std::cmp::Reverse(slot.number)))
        .map_or(0, |slot| slot.number)
}

/// Numbers of slots in rising order.
fn numbers(slots: &[SlotSpec]) -> Vec<u32> {
    let mut numbers: Vec<u32> = slots.iter().map(|slot| slot.number).collect();
    numbers.sort_unstable();
    numbers
}

/// What the orders of slots say of them.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Ordered {
    /// Some of them have no start times beside each other.
    Refuted(Infeasibility),
    /// All of them have these, in microseconds, where none is given.
    Starts(Vec<u32>),
    /// The steps did not suffice.
    Open,
}

/// The fewest slots whose orders are tried: the windows know all of two.
const FEWEST_IN_ORDER: usize = 3;

/// Tries all orders in which some of the slots can come: of a few, then of more and more, in the
/// order given, as long as so many steps suffice. Durations are above 0.
pub(super) fn by_orders(slots: &[SlotSpec], steps: u64, clock: &mut Clock) -> Ordered {
    for count in FEWEST_IN_ORDER..=slots.len() {
        let core = &slots[..count];
        match orders::search(core, &mut { steps }, clock) {
            OrdersEnd::Found(starts_us) if count == slots.len() => {
                return Ordered::Starts(starts_us);
            }
            OrdersEnd::Found(_) => {}
            OrdersEnd::GivenUp => break,
            OrdersEnd::Exhausted => {
                return Ordered::Refuted(smallest_order(core, steps, clock));
            }
        }
    }
    Ordered::Open
}

/// The slots that overlap in every order, with as few of them as do.
fn smallest_order(slots: &[SlotSpec], steps: u64, clock: &mut Clock) -> Infeasibility {
    let mut core = slots.to_vec();
    for position in (0..core.len()).rev() {
        let mut fewer = core.clone();
        fewer.remove(position);
        if orders::search(&fewer, &mut { steps }, clock) == OrdersEnd::Exhausted {
            core = fewer;
        }
    }
    Infeasibility::Orders {
        longest: longest(&core),
        slots: numbers(&core),
    }
}
