//! Warnings about what is declared: events that nobody hears, events in circles, limits of time
//! that are over at once, things that nothing uses.
//!
//! Whatever a warning rests on is known for certain: where something could not be read or resolved
//! ([`Holes`]), the mistake that is reported already may be the only one.
//!
//! Containers are looked at as they are written, and not once for each use, since nesting can make
//! the uses too many to count.

mod circles;
mod components;
mod events;
mod links;
mod ports;
mod timeouts;
mod unused;
mod uses;

use crate::model::Model;

use super::analysis::activity::Activity;
use super::analysis::holes::Holes;
use super::diagnostic::Sink;
use super::resolve::Trees;
use uses::Uses;

/// Adds the warnings. `activity` is that of what is known of the set.
pub(super) fn check(
    trees: &Trees<'_>,
    model: &Model,
    holes: &Holes,
    activity: &Activity,
    sink: &mut Sink,
) {
    timeouts::check(model, holes, sink);
    let has_one_machine = !model
        .containers
        .iter()
        .zip(&holes.containers)
        .any(|(container, holes)| container.is_machine && holes.is_twin);
    // Where containers contain themselves, or there are two machines, there is no tree of instances
    // to speak of.
    let Some(uses) = Uses::of(model, holes).filter(|_| has_one_machine) else {
        return;
    };
    events::check(model, holes, &uses, sink);
    circles::check(trees, model, holes, activity, &uses, sink);
    if model.machine.is_some() {
        let users = unused::check(trees, model, holes, sink);
        if let Some(ports) = ports::check(model, holes, &uses, sink) {
            links::check(model, &users, &ports, sink);
        }
    }
}

#[cfg(test)]
mod tests;
