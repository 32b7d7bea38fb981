//! W106: limits of time that are over before the interpreter looks a second time.

use crate::lang::analysis::holes::Holes;
use crate::lang::cure::{remove_limit, without_timeout};
use crate::lang::diagnostic::{Code, Diagnostic, Fix, Sink};
use crate::model::{Guard, Model, Region, Source, State, Transition, Trigger};

/// Reports states whose timeout is not above the interpreter's period.
pub(super) fn check(model: &Model, holes: &Holes, sink: &mut Sink) {
    let slot = model
        .interpreter_slot
        .and_then(|slot| model.slots.get(slot));
    let Some(slot) = slot.filter(|_| !holes.slots) else {
        return;
    };
    let regions = model
        .containers
        .iter()
        .flat_map(|container| &container.regions);
    let states = regions.flat_map(|region| {
        let readers = timeout_readers(region);
        region.states.iter().zip(readers)
    });
    for (state, readers) in states {
        let Some(timeout_us) = state.timeout_us.filter(|&limit| limit <= slot.period_us) else {
            continue;
        };
        let message = format!(
            "the timeout of `{}`, {timeout_us} us, is not above the interpreter's period of {} us",
            state.name, slot.period_us
        );
        // The timeout is over when more than the limit has passed, which is looked at once a
        // period.
        let after = if timeout_us < slot.period_us {
            "first"
        } else {
            "second"
        };
        let mut diagnostic = Diagnostic::new(Code::W106, state.declaration, message)
            .hint(format!(
                "it is over at the {after} macro step after the state is entered, whatever the limit says: lengthen it, or shorten the period of slot {}",
                slot.number
            ))
            .related(slot.span, "the slot that runs the interpreter");
        if timeout_us < slot.period_us {
            diagnostic
                .fixes
                .extend(without_limit(model, state, &readers));
        }
        sink.push(diagnostic);
    }
}

/// The transitions that read `timeout`, for each state of a region.
fn timeout_readers(region: &Region) -> Vec<Vec<&Transition>> {
    let mut readers = vec![Vec::new(); region.states.len()];
    for transition in &region.transitions {
        if let Source::State(state) = transition.source
            && transition.guard.as_ref().is_some_and(reads_timeout)
            && let Some(readers) = readers.get_mut(state)
        {
            readers.push(transition);
        }
    }
    readers
}

/// Removes the limit of a state that is over at the first macro step after the state is entered,
/// and `[timeout]` from its transitions: these are taken at that step as before. None where the
/// limit is read in another way.
fn without_limit(model: &Model, state: &State, readers: &[&Transition]) -> Option<Fix> {
    let text_of = |file: u32| Some(model.files.get(file as usize)?.text.as_str());
    let text = text_of(state.declaration.file)?;
    let mut edits = vec![remove_limit(text, state.declaration)?];
    for transition in readers {
        let is_pulse = transition.trigger == Trigger::Pulse;
        let edit = without_timeout(text_of(transition.span.file)?, transition.span);
        edits.push(edit.filter(|_| is_pulse)?);
    }
    let title = format!(
        "leave `{}` at the next macro step, as it is now",
        state.name
    );
    Some(Fix::new(title, edits))
}

fn reads_timeout(guard: &Guard) -> bool {
    match guard {
        Guard::Timeout => true,
        Guard::Not(inner) => reads_timeout(inner),
        Guard::And(terms) | Guard::Or(terms) => terms.iter().any(reads_timeout),
        _ => false,
    }
}
