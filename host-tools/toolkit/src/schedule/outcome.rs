//! What a search comes to.

use super::{Infeasibility, Schedule};

/// What a search came to.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// A schedule.
    Feasible(Schedule),
    /// There is none, and why.
    Infeasible(Infeasibility),
    /// The search ended without an answer: its time ran out, or there are more than
    /// [`MAX_SLOTS`](super::MAX_SLOTS) slots.
    Undecided,
}
