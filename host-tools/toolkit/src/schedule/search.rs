//! The search for start times: which method has its turn when.
//!
//! First a quick constructive one: slots are placed one after another into the gaps that are left,
//! in a way that spreads the load, and if that leads nowhere, in one that wastes little. That is
//! enough for most tables. Then a short search for columns, which lays out what fills all time;
//! then proofs: chains of periods that the slots are or imply, searched exactly. Then those
//! searches take turns that find schedules where little time is left, and beside them all orders of
//! the slots that found no place most often; in the end an exhaustive one, for a few slots of odd
//! periods. What was found where there is little room is evened out at the end, as far as that can
//! be.
//!
//! Turns are counted in steps, never in time: equal slots get equal answers, but where the limit
//! cuts a search off.
//!
//! The exhaustive search rests on pushing left. Call a slot *held* if its start is given (or is 0,
//! for one slot of a set without given starts, because a schedule can be turned as a whole), or if
//! it begins exactly where a slot that is held ends, modulo the greatest common divisor of their
//! periods. In any schedule, all slots that are not held can be moved earlier together, until one
//! of them touches one that is held; what was held stays so. So if there is a schedule, there is
//! one in which all are held, and a search that adds one slot at a time at such a place, whichever
//! slot it is, misses none.

use std::cmp::Reverse;

use super::chain::{self, Chain, End as ChainEnd, Member};
use super::clock::Clock;
use super::columns::Columns;
use super::construct::{Fit, Placed, Taste, construct, first_fit, fit};
use super::ejection::Ejection;
use super::luby::luby;
use super::proof::{self, Ordered};
use super::random::Random;
use super::{Infeasibility, Outcome, Schedule, SlotSpec, check, gcd, spread};

/// As many slots without a given start are searched exhaustively: with more, it would only burn the
/// time that is left. It is also the depth of the recursion.
const MAX_EXHAUSTIVE: usize = 12;

/// As many places are looked at in one step of the exhaustive search; more are beyond exhausting.
const MAX_PLACES: usize = 100_000;

/// Searches until there is an answer or the clock has run out. The slots fit alone, and together do
/// not ask for too much.
pub(super) fn search(slots: &[SlotSpec], clock: &mut Clock) -> Outcome {
    let mut fixed: Vec<Placed> = Vec::new();
    let mut free: Vec<(usize, &SlotSpec)> = Vec::new();
    for (index, slot) in slots.iter().enumerate() {
        match slot.fixed_start_us {
            Some(start_us) => fixed.push(Placed::new(index, slot, start_us.into())),
            None => free.push((index, slot)),
        }
    }
    if let Some(reason) = given_starts_clash(slots, &fixed) {
        return Outcome::Infeasible(reason);
    }
    free.sort_by_key(|(_, slot)| (slot.period_us, Reverse(slot.duration_us)));
    if let Some(layout) = construct(&fixed, &free, Taste::Widest, clock) {
        return Outcome::Feasible(schedule_of(slots, &layout));
    }
    let mut outcome = search_tight(slots, fixed, free, clock);
    if let Outcome::Feasible(schedule) = &mut outcome {
        spread::even_out(slots, &mut schedule.starts_us);
    }
    outcome
}

/// Searches where there is little room: for a schedule without care for how the load is spread, or
/// a proof.
fn search_tight(
    slots: &[SlotSpec],
    fixed: Vec<Placed>,
    free: Vec<(usize, &SlotSpec)>,
    clock: &mut Clock,
) -> Outcome {
    if let Some(layout) = construct(&fixed, &free, Taste::Shared, clock) {
        return Outcome::Feasible(schedule_of(slots, &layout));
    }
    // What has no duration needs no time, and what has two given starts or more cannot be turned as
    // a whole.
    let is_plain = slots.iter().all(|slot| slot.duration_us > 0);
    let mut columns = if is_plain { Columns::new(slots) } else { None };
    if let Some(columns) = &mut columns
        && let Some(starts_us) = columns.search(FIRST_COLUMNS_WORK * slots.len() as u64, clock)
    {
        return Outcome::Feasible(Schedule { starts_us });
    }
    if let Some(reason) = proof::by_packing(slots, PROOF_STEPS, clock) {
        return Outcome::Infeasible(reason);
    }
    let members = chain::of_slots(slots).filter(|_| is_plain && fixed.len() <= 1);
    if let Some(members) = &members
        && let ChainEnd::Found(starts_us) = Chain::new(members).search(PROOF_STEPS, None, clock)
    {
        return Outcome::Feasible(turned(slots, members, &starts_us));
    }
    let outcome = take_turns(
        slots,
        members.as_deref(),
        columns,
        is_plain,
        free.len(),
        clock,
    );
    if outcome != Outcome::Undecided || free.len() > MAX_EXHAUSTIVE || members.is_some() {
        return outcome;
    }
    exhaust(slots, fixed, free, clock)
}

/// Steps of an exact search of a chain that is only to prove something.
const PROOF_STEPS: u64 = 20_000;

/// Steps of the first search of all orders of the slots that are hardest to place.
const ORDERS_STEPS: u64 = 500;

/// Work of the search for columns before proofs are looked for, for each slot, in pieces as the
/// clock counts them.
const FIRST_COLUMNS_WORK: u64 = 1_000;

/// Work of one turn of the search for columns, for each slot.
const COLUMNS_WORK: u64 = 4_000;

/// Steps of one turn of the ejection search.
const EJECTION_STEPS: u64 = 1_000;

/// Turns before the exhaustive search of a few slots begins.
const TURNS_OF_FEW: u64 = 16;

/// Lets the searches that need luck take turns until one has it, or the clock has run out.
fn take_turns(
    slots: &[SlotSpec],
    members: Option<&[Member]>,
    mut columns: Option<Columns>,
    is_plain: bool,
    free: usize,
    clock: &mut Clock,
) -> Outcome {
    let chain = members.map(|members| (Chain::new(members), members));
    let mut ejection = if is_plain { Ejection::new(slots) } else { None };
    let mut random = Random::new(1);
    let mut exact_steps = PROOF_STEPS;
    let mut turn = 0;
    while !clock.is_over() && (chain.is_some() || ejection.is_some()) {
        turn += 1;
        if let Some((chain, members)) = &chain {
            // Short attempts often, long ones seldom (Luby, Sinclair, Zuckerman 1993).
            for attempt in (turn - 1) * CHAIN_ATTEMPTS + 1..=turn * CHAIN_ATTEMPTS {
                let steps = (2 * slots.len() as u64 + 100) * luby(attempt);
                match chain.search(steps, Some(&mut random), clock) {
                    ChainEnd::Found(starts_us) => {
                        return Outcome::Feasible(turned(slots, members, &starts_us));
                    }
                    ChainEnd::Exhausted => {
                        return Outcome::Infeasible(proof::smallest_core(slots, clock));
                    }
                    ChainEnd::GivenUp => {}
                }
            }
        }
        if turn.is_multiple_of(8) {
            exact_steps *= 2;
            if let Some(reason) = proof::by_packing(slots, exact_steps, clock) {
                return Outcome::Infeasible(reason);
            }
        }
        if let Some(columns) = &mut columns
            && let Some(starts_us) = columns.search(COLUMNS_WORK * slots.len() as u64, clock)
        {
            return Outcome::Feasible(Schedule { starts_us });
        }
        if let Some(ejection) = &mut ejection
            && (chain.is_none() || turn.is_multiple_of(8))
            && let Some(starts_us) = ejection.search(EJECTION_STEPS, clock)
        {
            return Outcome::Feasible(Schedule { starts_us });
        }
        if let Some(ejection) = &ejection
            && chain.is_none()
            && turn.is_power_of_two()
            && let Some(outcome) = try_orders(slots, &ejection.hardest(), turn, clock)
        {
            return outcome;
        }
        // The orders of slots with several given starts say less than all places do.
        if chain.is_none() && free <= MAX_EXHAUSTIVE && turn == TURNS_OF_FEW {
            break;
        }
    }
    Outcome::Undecided
}

/// Tries all orders of the slots that are hardest to place, as many of them as the steps suffice
/// for.
fn try_orders(
    slots: &[SlotSpec],
    hardest: &[usize],
    turn: u64,
    clock: &mut Clock,
) -> Option<Outcome> {
    let ordered: Vec<SlotSpec> = hardest
        .iter()
        .filter_map(|&index| slots.get(index).copied())
        .collect();
    match proof::by_orders(&ordered, ORDERS_STEPS * turn, clock) {
        Ordered::Refuted(reason) => Some(Outcome::Infeasible(reason)),
        Ordered::Open => None,
        Ordered::Starts(found_us) => {
            let mut starts_us = vec![0; slots.len()];
            for (&index, &start_us) in hardest.iter().zip(&found_us) {
                if let Some(place) = starts_us.get_mut(index) {
                    *place = start_us.into();
                }
            }
            let members: Vec<Member> = chain::members(slots);
            // Turned as a whole, they have one given start; several may be others.
            let schedule = turned(slots, &members, &starts_us);
            check(slots, &schedule.starts_us)
                .is_ok()
                .then_some(Outcome::Feasible(schedule))
        }
    }
}

/// Attempts at a chain in one turn.
const CHAIN_ATTEMPTS: u64 = 16;

/// The starts of all slots, turned so that the slot with a given start has it.
fn turned(slots: &[SlotSpec], members: &[Member], starts_us: &[u64]) -> Schedule {
    let given = members
        .iter()
        .zip(starts_us)
        .find_map(|(member, &start_us)| {
            let given_us = slots.get(member.index)?.fixed_start_us?;
            Some((u64::from(given_us), start_us))
        });
    let (to_us, from_us) = given.unwrap_or((0, 0));
    let mut turned = vec![0; slots.len()];
    for (member, &start_us) in members.iter().zip(starts_us) {
        let period_us = member.period_us.max(1);
        let since = (start_us % period_us + period_us - from_us % period_us + to_us) % period_us;
        if let (Some(turned), Ok(since)) = (turned.get_mut(member.index), u32::try_from(since)) {
            *turned = since;
        }
    }
    Schedule { starts_us: turned }
}

/// Slots whose starts are given must fit each other and start within their periods.
fn given_starts_clash(slots: &[SlotSpec], fixed: &[Placed]) -> Option<Infeasibility> {
    let number = |placed: &Placed| slots.get(placed.index).map_or(0, |slot| slot.number);
    fixed.iter().enumerate().find_map(|(position, b)| {
        let is_late = b.start_us >= b.period_us;
        let clashes = |a: &&Placed| fit(a, b.start_us, b.period_us, b.duration_us) != Fit::Free;
        let other = if is_late {
            Some(b)
        } else {
            fixed.iter().take(position).find(clashes)
        };
        other.map(|a| Infeasibility::FixedStarts {
            first: number(a),
            second: number(b),
        })
    })
}

fn schedule_of(slots: &[SlotSpec], layout: &[Placed]) -> Schedule {
    let mut starts_us = vec![0; slots.len()];
    for placed in layout {
        if let (Some(start_us), Ok(found_us)) = (
            starts_us.get_mut(placed.index),
            u32::try_from(placed.start_us),
        ) {
            *start_us = found_us;
        }
    }
    Schedule { starts_us }
}

// ─── Exhaustive search ───────────────────────────────────────────────────────────────────────────

/// What a part of the exhaustive search came to.
#[derive(Clone, Copy, PartialEq, Eq)]
enum End {
    Found,
    Exhausted,
    GivenUp,
}

/// Tries every arrangement.
fn exhaust(
    slots: &[SlotSpec],
    mut layout: Vec<Placed>,
    mut free: Vec<(usize, &SlotSpec)>,
    clock: &mut Clock,
) -> Outcome {
    if layout.is_empty() && !free.is_empty() {
        // A schedule as a whole can be moved, so one slot may as well start at 0.
        let (index, slot) = free.remove(0);
        layout.push(Placed::new(index, slot, 0));
    }
    let mut search = Exhaustive {
        clock,
        done: Vec::new(),
        arrangements: 0,
    };
    match search.extend(&mut layout, &free) {
        End::Found => Outcome::Feasible(schedule_of(slots, &layout)),
        End::Exhausted => Outcome::Infeasible(Infeasibility::Exhausted {
            arrangements: search.arrangements,
        }),
        End::GivenUp => Outcome::Undecided,
    }
}

struct Exhaustive<'c> {
    clock: &'c mut Clock,
    /// Places that were tried on the way here, by slot and start: all schedules with one of them
    /// and the present layout are known not to work.
    done: Vec<(usize, u64)>,
    /// How many arrangements came to a dead end.
    arrangements: u64,
}

impl Exhaustive<'_> {
    /// Adds the rest of the slots to the layout in every way that can matter.
    fn extend(&mut self, layout: &mut Vec<Placed>, rest: &[(usize, &SlotSpec)]) -> End {
        if rest.is_empty() {
            return End::Found;
        }
        for (_, slot) in rest {
            let has_place = first_fit(layout, slot, self.clock).is_some();
            if self.clock.is_over() {
                return End::GivenUp;
            }
            if !has_place {
                self.arrangements += 1;
                return End::Exhausted;
            }
        }
        let Some(places) = self.places(layout, rest) else {
            return End::GivenUp;
        };
        let done_before = self.done.len();
        let mut end = End::Exhausted;
        for place in places {
            if self.done.contains(&(place.index, place.start_us)) {
                continue;
            }
            let others: Vec<(usize, &SlotSpec)> = rest
                .iter()
                .copied()
                .filter(|&(index, _)| index != place.index)
                .collect();
            layout.push(place);
            end = self.extend(layout, &others);
            if end != End::Exhausted {
                break;
            }
            layout.pop();
            self.done.push((place.index, place.start_us));
        }
        self.done.truncate(done_before);
        if end == End::Exhausted {
            self.arrangements += 1;
        }
        end
    }

    /// All places at which a slot begins exactly where one that is placed ends. `None` where these
    /// are too many, or time ran out.
    fn places(&mut self, layout: &[Placed], rest: &[(usize, &SlotSpec)]) -> Option<Vec<Placed>> {
        let mut places: Vec<Placed> = Vec::new();
        for &(index, slot) in rest {
            let period_us = u64::from(slot.period_us);
            let mut starts_us: Vec<u64> = Vec::new();
            for other in layout {
                let divisor = gcd(other.period_us, period_us);
                let first_us = (other.start_us + other.duration_us) % divisor;
                let count = usize::try_from(period_us / divisor).ok()?;
                if starts_us.len() + count > MAX_PLACES {
                    return None;
                }
                starts_us.extend((0..count as u64).map(|turn| first_us + turn * divisor));
            }
            starts_us.sort_unstable();
            starts_us.dedup();
            for start_us in starts_us {
                let place = Placed::new(index, slot, start_us);
                let fits = |other: &Placed| {
                    fit(other, start_us, period_us, place.duration_us) == Fit::Free
                };
                if layout.iter().all(fits) {
                    places.push(place);
                }
                if self.clock.tick() {
                    return None;
                }
            }
        }
        Some(places)
    }
}
