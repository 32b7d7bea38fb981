//! Start times of the slots: search, proof, check.
//!
//! Slots are strictly periodic and never preempt each other: slot i with period T_i and duration C_i needs one start s_i with
//! 0 ≤ s_i < T_i such that no two occurrences of any slots ever overlap. Two slots i, j fit if and only if, with g = gcd(T_i, T_j),
//! C_i ≤ (s_j − s_i) mod g ≤ g − C_j (Korst, Aarts, Lenstra). Nothing here ever lists the occurrences of a hyperperiod.

use std::fmt;
use std::time::Duration;

use serde::Serialize;

/// What the search needs to know of a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SlotSpec {
    /// The number that it was declared with, for messages.
    pub number: u32,
    /// Period in microseconds.
    pub period_us: u32,
    /// Duration in microseconds.
    pub duration_us: u32,
    /// A start that is given: 0 for the interpreter's slot.
    pub fixed_start_us: Option<u32>,
}

/// Start times that [`check`] has found right.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Schedule {
    /// Start of each slot in microseconds, in the order of the slots given; 0 ≤ start < period.
    pub starts_us: Vec<u32>,
}

/// What a search came to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// A schedule.
    Feasible(Schedule),
    /// There is none, and why.
    Infeasible(Infeasibility),
    /// The search ended without an answer.
    Undecided,
}

/// Why there is no schedule.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Infeasibility {}

impl fmt::Display for Infeasibility {
    fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {}
    }
}

/// Searches for start times for at most `limit`. Equal slots give equal answers, but for searches that the limit cuts off.
pub fn solve(slots: &[SlotSpec], limit: Duration) -> Outcome {
    let _ = (slots, limit);
    Outcome::Undecided
}

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
/// The first pair that clashes.
pub fn check(slots: &[SlotSpec], starts_us: &[u32]) -> Result<(), Clash> {
    let _ = (slots, starts_us);
    Ok(())
}

/// What `esm schedule` tells, in the form of its JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Whether there is a schedule; `None` where that is undecided.
    pub feasible: Option<bool>,
    /// Least common multiple of the periods in microseconds; `None` where it exceeds 64 bits.
    pub hyperperiod_us: Option<u64>,
    /// Sum of duration over period.
    pub utilisation: f64,
    /// The slots with their starts; empty without a schedule.
    pub slots: Vec<SlotReport>,
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
}

/// Puts slots and outcome together for `esm schedule`.
pub fn report(slots: &[SlotSpec], outcome: &Outcome) -> Report {
    let _ = (slots, outcome);
    Report {
        feasible: None,
        hyperperiod_us: None,
        utilisation: 0.0,
        slots: Vec::new(),
    }
}
