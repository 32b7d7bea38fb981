//! The search, from the first look at the slots to the check of what it found.

use super::clock::{Clock, Limit};
use super::{Infeasibility, MAX_SLOTS, Outcome, SlotSpec, bounds, check, search};

/// Searches for start times for at most `limit`. Equal slots give equal answers, but for searches
/// that the limit cuts off.
pub fn solve(slots: &[SlotSpec], limit: impl Into<Limit>) -> Outcome {
    solve_within(slots, &mut Clock::new(limit))
}

/// [`solve`] with a clock that may count work instead of time.
pub(super) fn solve_within(slots: &[SlotSpec], clock: &mut Clock) -> Outcome {
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
