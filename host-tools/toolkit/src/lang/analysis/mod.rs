//! What can happen in a set of files, and what cannot: the questions that need more than names.
//!
//! - [`holes`]: what of the set is not known because it could not be read or resolved. No warning
//!   may rest on that.
//! - [`guards`]: whether guards can be true, alone, together, or after others were not.
//! - [`activity`]: which transitions can be taken, which states can be reached.
//! - [`side_by_side`]: which states can be active together.
//! - [`sharing`]: which tasks share a slot, and how long they take together at most.
//!
//! Data is looked at in two modules of its own: which ports share a net in which instance, and
//! which values get old there.
//!
//! ```
//! use esm_toolkit::lang::{analysis::{activity::{Activity, StateId, View}, holes::Holes, side_by_side::SideBySide}, load_text};
//!
//! let model = load_text("doors.esm", "
//!     container Doors {
//!       region left { state Open; state Shut; initial -> Open; Open -> Shut; Shut -> Open; }
//!       region right { state Ajar; state Gone; initial -> Ajar; Ajar -> Ajar; }
//!     }
//! ").model.expect("a set without errors");
//! let holes = Holes::none(&model);
//! let activity = Activity::of(&model, &holes, View::Known);
//! let mut nesting = SideBySide::new(&model, &holes, &activity).expect("no container uses itself");
//! let state = |region, state| StateId { container: 0, region, state };
//! assert_eq!(nesting.can_be_together(state(0, 0), state(1, 0)), Some(true));
//! assert_eq!(nesting.can_be_together(state(0, 0), state(0, 1)), Some(false));
//! assert!(!activity.is_reachable(state(1, 1)));
//! ```

pub mod activity;
mod freshness;
pub mod guards;
pub mod holes;
mod nets;
pub mod sharing;
pub mod side_by_side;
mod warnings;

use crate::model::Model;

use super::diagnostic::{Code, Sink};
use activity::{Activity, Uses, View};
use holes::Holes;
use warnings::Warnings;

/// Adds the warnings that rest on what can be active. `known` is the activity of what is known of
/// the set.
pub(super) fn check(model: &Model, holes: &Holes, known: &Activity, sink: &mut Sink) {
    let has_holes = holes.any();
    let possible = has_holes.then(|| Activity::of(model, holes, View::Possible));
    let with_limits = sink.has(Code::W109).then(|| {
        let mut model = model.clone();
        let states = model
            .containers
            .iter_mut()
            .flat_map(|container| &mut container.regions)
            .flat_map(|region| &mut region.states);
        for state in states {
            state.timeout_us.get_or_insert(1_000_000);
        }
        let view = if has_holes {
            View::Possible
        } else {
            View::Known
        };
        Activity::of(&model, holes, view)
    });
    let warnings = Warnings {
        model,
        holes,
        known,
        possible: possible.as_ref().unwrap_or(known),
        with_limits: with_limits.as_ref(),
    };
    let uses = Uses::of(model, holes);
    warnings.unreachable_states(sink);
    warnings.competing_transitions(sink);
    warnings.exclusive_tasks(sink);
    warnings.dead_ends(&uses, sink);
    warnings.competing_writers(&uses, sink);
    warnings.old_values(&uses, sink);
}

#[cfg(test)]
mod tests;
