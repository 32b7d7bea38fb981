//! W106: limits of time that are over before the interpreter looks a second time.

use crate::lang::analysis::holes::Holes;
use crate::lang::diagnostic::{Code, Diagnostic, Sink};
use crate::model::Model;

/// Reports states whose timeout is not above the interpreter's period.
pub(super) fn check(model: &Model, holes: &Holes, sink: &mut Sink) {
    let slot = model
        .interpreter_slot
        .and_then(|slot| model.slots.get(slot));
    let Some(slot) = slot.filter(|_| !holes.slots) else {
        return;
    };
    let states = model
        .containers
        .iter()
        .flat_map(|container| &container.regions)
        .flat_map(|region| &region.states);
    for state in states {
        let Some(timeout_us) = state.timeout_us.filter(|&limit| limit <= slot.period_us) else {
            continue;
        };
        let message = format!(
            "the timeout of `{}`, {timeout_us} us, is not above the interpreter's period of {} us",
            state.name, slot.period_us
        );
        // The timeout is over when more than the limit has passed, which is looked at once a period.
        let after = if timeout_us < slot.period_us {
            "first"
        } else {
            "second"
        };
        sink.push(
            Diagnostic::new(Code::W106, state.declaration, message)
                .hint(format!(
                    "it is over at the {after} macro step after the state is entered, whatever the limit says: lengthen it, or shorten the period of slot {}",
                    slot.number
                ))
                .related(slot.span, "the slot that runs the interpreter"),
        );
    }
}
