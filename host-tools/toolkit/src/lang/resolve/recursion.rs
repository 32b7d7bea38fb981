//! Which containers use which, and that none uses itself.

use crate::lang::diagnostic::{Code, Diagnostic};
use crate::model::{Model, Span};

use super::scope::Names;
use super::{ContainerFacts, Kind};

/// How far the walk is with a container.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Mark {
    /// Not yet there.
    New,
    /// On the way down from it.
    Open,
    /// Done with it and all that it uses.
    Done,
}

/// A container on the way down, and which of its uses comes next.
struct Step {
    container: usize,
    next_use: usize,
}

/// Orders the containers so that each stands behind all that it uses. Each `super` that closes a
/// circle is reported; then there is no order.
pub(super) fn children_first(
    facts: &[ContainerFacts<'_>],
    model: &Model,
    names: &mut Names<'_, '_>,
) -> Option<Vec<usize>> {
    let uses: Vec<Vec<(usize, Span)>> = facts.iter().map(uses_of).collect();
    let mut marks = vec![Mark::New; facts.len()];
    let mut order = Vec::with_capacity(facts.len());
    let mut is_recursive = false;
    for start in 0..facts.len() {
        // A walk with its own stack: the depth of nesting is not bounded here.
        let mut way = vec![Step {
            container: start,
            next_use: 0,
        }];
        if marks.get(start) != Some(&Mark::New) {
            continue;
        }
        set(&mut marks, start, Mark::Open);
        while let Some(step) = way.last_mut() {
            let container = step.container;
            let next = uses.get(container).and_then(|uses| uses.get(step.next_use));
            step.next_use += 1;
            let Some(&(used, span)) = next else {
                set(&mut marks, container, Mark::Done);
                order.push(container);
                way.pop();
                continue;
            };
            match marks.get(used) {
                Some(Mark::New) => {
                    set(&mut marks, used, Mark::Open);
                    way.push(Step {
                        container: used,
                        next_use: 0,
                    });
                }
                Some(Mark::Open) => {
                    is_recursive = true;
                    report(&way, used, span, model, names);
                }
                Some(Mark::Done) | None => {}
            }
        }
    }
    (!is_recursive).then_some(order)
}

fn set(marks: &mut [Mark], container: usize, mark: Mark) {
    if let Some(old) = marks.get_mut(container) {
        *old = mark;
    }
}

/// The containers that a container uses, with the `super` of each.
fn uses_of(facts: &ContainerFacts<'_>) -> Vec<(usize, Span)> {
    facts
        .states
        .iter()
        .flatten()
        .filter_map(|state| match state.kind {
            Kind::Super(container) => Some((container, state.span)),
            _ => None,
        })
        .collect()
}

fn report(way: &[Step], used: usize, span: Span, model: &Model, names: &mut Names<'_, '_>) {
    /// More of a circle than this is not worth reading.
    const MAX_SHOWN: usize = 8;
    let name = |index: usize| {
        model
            .containers
            .get(index)
            .map_or("", |container| container.name.as_str())
    };
    let circle = way.iter().skip_while(|step| step.container != used);
    let mut shown: Vec<&str> = circle
        .clone()
        .take(MAX_SHOWN)
        .map(|step| name(step.container))
        .collect();
    if circle.count() > MAX_SHOWN {
        shown.push("…");
    }
    shown.push(name(used));
    names.report(
        Diagnostic::new(
            Code::E007,
            span,
            format!(
                "container `{}` contains itself: {}",
                name(used),
                shown.join(" → ")
            ),
        )
        .hint("use another container here"),
    );
}
