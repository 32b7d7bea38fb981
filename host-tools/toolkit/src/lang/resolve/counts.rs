//! How many task states of a task there can be: what its `count` says (E012).
//!
//! Each use of a container counts its task states anew. They are counted without laying the
//! instances out: how many instances each container has, from the outside in; and where a task has
//! too many states, how many are inside each container, which leads down to the first one too many
//! in the order of the instance tree.

use crate::lang::diagnostic::{Code, Diagnostic};
use crate::model::{Model, Span};

use super::scope::Names;
use super::{ContainerFacts, Kind};

/// As many superstates are shown around the first task state too many.
const MAX_SHOWN: usize = 4;

/// Looks for tasks of which the machine has more task states than there is room for. `order`: the
/// containers, each behind all that it uses; without one nothing is counted, nor in a set without a
/// machine.
pub(super) fn check(
    facts: &[ContainerFacts<'_>],
    model: &Model,
    order: Option<&[usize]>,
    names: &mut Names<'_, '_>,
) {
    let (Some(machine), Some(order)) = (model.machine, order) else {
        return;
    };
    let needed = needed(facts, model, machine, order);
    for (index, (task, needed)) in model.tasks.iter().zip(needed).enumerate() {
        let Some(room) = task.count.map(u64::from).filter(|&room| needed > room) else {
            continue;
        };
        // Only of those that have too many, so that a set of many tasks costs no more than it is
        // long.
        if names.omits_error() {
            continue;
        }
        let counts = counts(facts, index, order);
        let Some((place, around)) = beyond(facts, index, &counts, machine, room) else {
            continue;
        };
        let name = &task.name;
        let message = format!(
            "{needed} task states of task `{name}` are needed, {} more than the {room} that its `count` allows",
            needed - room
        );
        let mut diagnostic = Diagnostic::new(Code::E012, place, message)
            .hint("enter one task state from several places, where only one at a time runs; or give the firmware more room and let `count` say so")
            .related(task.span, "the task");
        for superstate in around.into_iter().rev().take(MAX_SHOWN) {
            diagnostic =
                diagnostic.related(superstate, "each superstate counts what is inside it anew");
        }
        names.report(diagnostic);
    }
}

/// How many task states of each task the machine has.
fn needed(
    facts: &[ContainerFacts<'_>],
    model: &Model,
    machine: usize,
    order: &[usize],
) -> Vec<u64> {
    let mut needed = vec![0_u64; model.tasks.len()];
    let mut instances = vec![0_u64; facts.len()];
    if let Some(of_machine) = instances.get_mut(machine) {
        *of_machine = 1;
    }
    for &container in order.iter().rev() {
        let here = instances.get(container).copied().unwrap_or(0);
        for (kind, _) in states(facts, container) {
            let sum = match kind {
                Kind::Task(task) => needed.get_mut(task),
                Kind::Super(inside) => instances.get_mut(inside),
                Kind::Simple | Kind::Unknown => None,
            };
            if let Some(sum) = sum {
                *sum = sum.saturating_add(here);
            }
        }
    }
    needed
}

/// How many task states of a task are inside each container.
fn counts(facts: &[ContainerFacts<'_>], task: usize, order: &[usize]) -> Vec<u64> {
    let mut counts = vec![0_u64; facts.len()];
    for &container in order {
        let count = states(facts, container).fold(0_u64, |sum, (kind, _)| {
            sum.saturating_add(count_of(kind, task, &counts))
        });
        if let Some(known) = counts.get_mut(container) {
            *known = count;
        }
    }
    counts
}

/// How many task states of a task a state is, or has inside.
fn count_of(kind: Kind, task: usize, counts: &[u64]) -> u64 {
    match kind {
        Kind::Task(of) => u64::from(of == task),
        Kind::Super(container) => counts.get(container).copied().unwrap_or(0),
        Kind::Simple | Kind::Unknown => 0,
    }
}

fn states<'a>(
    facts: &'a [ContainerFacts<'_>],
    container: usize,
) -> impl Iterator<Item = (Kind, Span)> + 'a {
    let regions = facts.get(container).into_iter().flat_map(|it| &it.states);
    regions.flatten().map(|state| (state.kind, state.span))
}

/// The task state behind so many others of its task, and the superstates around it from the outside
/// in.
fn beyond(
    facts: &[ContainerFacts<'_>],
    task: usize,
    counts: &[u64],
    machine: usize,
    room: u64,
) -> Option<(Span, Vec<Span>)> {
    let mut left = room;
    let mut container = machine;
    let mut around = Vec::new();
    // Each container is at most once on the way: none uses itself.
    for _ in facts {
        let (kind, span) = states(facts, container).find(|(kind, _)| {
            let count = count_of(*kind, task, counts);
            let is_beyond = count > left;
            left -= if is_beyond { 0 } else { count };
            is_beyond
        })?;
        match kind {
            Kind::Super(inside) => {
                around.push(span);
                container = inside;
            }
            _ => return Some((span, around)),
        }
    }
    None
}
