//! W107: slots, tasks, containers, flags and parameters that nothing uses. Data ports are in
//! [`super::ports`].
//!
//! Asked only where there is a machine: a file of tasks and containers alone is there for others to
//! use.

use std::collections::HashSet;

use crate::lang::analysis::holes::{Holes, RegionHoles};
use crate::lang::cure::{end_of_item, remove_item};
use crate::lang::diagnostic::{Code, Diagnostic, Fix, Sink};
use crate::lang::resolve::Trees;
use crate::lang::tree::{self, Given};
use crate::model::{
    Action, Direction, Flag, Guard, Model, Region, SlotRef, Source, Span, StateKind, Target,
    Transition,
};

/// Reports what is declared and not used.
///
/// Gives what is used.
pub(super) fn check(trees: &Trees<'_>, model: &Model, holes: &Holes, sink: &mut Sink) -> Users {
    let users = Users::of(trees, model, holes);
    report_slots(model, &users, sink);
    let declarations = trees.trees.iter().flat_map(|file| &file.tasks);
    for ((task, used), declaration) in model.tasks.iter().zip(&users.tasks).zip(declarations) {
        if used.may_be_more {
            continue;
        }
        if !used.is_used {
            sink.push(
                unused(
                    declaration.span,
                    format!("task `{}` is not used", task.name),
                )
                .hint(format!(
                    "run it in a state (`task A: {};`), or remove the declaration",
                    task.name
                ))
                .fix(remove_body("remove the task", declaration.span, model)),
            );
            continue;
        }
        let owner = format!("task `{}`", task.name);
        report_flags(&owner, &task.flags, used, None, sink);
        for (param, is_named) in task.params.iter().zip(&used.params) {
            if !is_named {
                let message = format!(
                    "parameter `{}` of {owner} is given by no `with`",
                    param.name
                );
                sink.push(unused(param.span, message).hint(
                    "its default holds everywhere: give a value where it should be another, or remove the parameter",
                ));
            }
        }
    }
    let declarations = trees.trees.iter().flat_map(|file| &file.containers);
    for ((container, used), declaration) in model
        .containers
        .iter()
        .zip(&users.containers)
        .zip(declarations)
    {
        if container.is_machine || used.may_be_more {
            continue;
        }
        let name = &container.name;
        if used.is_used {
            let owner = format!("container `{name}`");
            report_flags(&owner, &container.flags, used, Some(model), sink);
        } else {
            sink.push(
                unused(declaration.span, format!("container `{name}` is not used"))
                    .hint(format!(
                        "use it in a state (`super A: {name};`), or remove the declaration"
                    ))
                    .fix(remove_body("remove the container", declaration.span, model)),
            );
        }
    }
    users
}

/// A warning about something that is declared and not used.
pub(super) fn unused(place: Span, message: String) -> Diagnostic {
    Diagnostic::new(Code::W107, place, message)
}

fn report_slots(model: &Model, users: &Users, sink: &mut Sink) {
    for (slot, is_used) in model.slots.iter().zip(&users.slots) {
        if !is_used {
            sink.push(
                unused(slot.span, format!("slot {} is not used", slot.number)).hint(format!(
                    "let a task run in it (`slot {}`), or remove it: it takes time from the others",
                    slot.number
                ))
                .fix(remove("remove the slot", slot.span, model)),
            );
        }
    }
}

/// The fix that removes a declaration.
pub(super) fn remove(title: &str, span: Span, model: &Model) -> Fix {
    let file = model.files.get(span.file as usize);
    let text = file.map_or("", |file| file.text.as_str());
    Fix::one(title, remove_item(text, span))
}

/// The same for one with a body, by its head.
fn remove_body(title: &str, head: Span, model: &Model) -> Fix {
    let file = model.files.get(head.file as usize);
    let text = file.map_or("", |file| file.text.as_str());
    let end = end_of_item(text, head.start);
    remove(title, Span { end, ..head }, model)
}

/// Reports flags that are not used. `removable` is the model where they can be removed: what a task
/// has stands in its firmware.
fn report_flags(
    owner: &str,
    flags: &[Flag],
    used: &User,
    removable: Option<&Model>,
    sink: &mut Sink,
) {
    for (flag, is_used) in flags.iter().zip(&used.flags) {
        if *is_used {
            continue;
        }
        let (message, hint) = match flag.direction {
            Direction::In => (
                format!(
                    "no transition sets or reads `in` flag `{}` of {owner}",
                    flag.name
                ),
                format!(
                    "set it on the way into a state (`/ set .{}`), or remove it",
                    flag.name
                ),
            ),
            _ => (
                format!(
                    "no transition reads or sets `out` flag `{}` of {owner}",
                    flag.name
                ),
                format!(
                    "read it on the way out of a state (`[.{}]`), or remove it",
                    flag.name
                ),
            ),
        };
        let mut diagnostic = unused(flag.span, message).hint(hint);
        if let Some(model) = removable {
            diagnostic = diagnostic.fix(remove("remove the flag", flag.span, model));
        }
        sink.push(diagnostic);
    }
}

/// What is used of a task or container.
pub(super) struct User {
    pub(super) is_used: bool,
    /// Whether uses may be hidden, or the declaration is not the one that counts.
    pub(super) may_be_more: bool,
    pub(super) flags: Vec<bool>,
    params: Vec<bool>,
}

/// What is used in a set of files. Lists are those of the model.
pub(super) struct Users {
    slots: Vec<bool>,
    pub(super) tasks: Vec<User>,
    containers: Vec<User>,
}

impl Users {
    fn of(trees: &Trees<'_>, model: &Model, holes: &Holes) -> Self {
        // A state whose task or container is not known may be of any.
        let may_hide_states = holes.set
            || holes.containers.iter().any(|container| {
                container.declarations
                    || container
                        .regions
                        .iter()
                        .any(|region| region.body || region.states.iter().any(|state| state.kind))
            });
        // The interpreter that is missing would have one of them.
        let has_broken_slot = has_broken_slot(trees) || model.interpreter_slot.is_none();
        let mut users = Users {
            slots: vec![may_hide_states || holes.slots || has_broken_slot; model.slots.len()],
            tasks: model
                .tasks
                .iter()
                .zip(&holes.tasks)
                .map(|(task, holes)| User {
                    is_used: false,
                    may_be_more: may_hide_states || holes.is_twin,
                    flags: repeated(task.flags.iter().map(|flag| flag.name.as_str())),
                    params: repeated(task.params.iter().map(|param| param.name.as_str())),
                })
                .collect(),
            containers: model
                .containers
                .iter()
                .zip(&holes.containers)
                .map(|(container, holes)| User {
                    is_used: false,
                    may_be_more: may_hide_states || holes.is_twin,
                    flags: repeated(container.flags.iter().map(|flag| flag.name.as_str())),
                    params: Vec::new(),
                })
                .collect(),
        };
        users.name_slot(model.interpreter_slot);
        for task in &model.tasks {
            users.name_slot_of(task.slot);
        }
        let containers = trees.trees.iter().flat_map(|file| &file.containers);
        for (index, ((container, holes), tree)) in model
            .containers
            .iter()
            .zip(&holes.containers)
            .zip(containers)
            .enumerate()
        {
            let regions = container.regions.iter().zip(&holes.regions);
            for ((region, holes), tree) in regions.zip(&tree.regions) {
                users.states(trees, model, region, holes, tree);
                users.transitions(index, region, holes);
            }
        }
        users
    }

    fn name_slot(&mut self, slot: Option<usize>) {
        if let Some(used) = slot.and_then(|slot| self.slots.get_mut(slot)) {
            *used = true;
        }
    }

    fn name_slot_of(&mut self, slot: Option<SlotRef>) {
        if let Some(SlotRef::Slot(slot)) = slot {
            self.name_slot(Some(slot));
        }
    }

    fn states(
        &mut self,
        trees: &Trees<'_>,
        model: &Model,
        region: &Region,
        holes: &RegionHoles,
        tree: &tree::Region,
    ) {
        let states = region.states.iter().zip(&holes.states).zip(&tree.states);
        for ((state, holes), tree) in states {
            if holes.kind {
                continue;
            }
            match &state.kind {
                StateKind::Simple => {}
                StateKind::Super { container } => {
                    if let Some(user) = self.containers.get_mut(*container) {
                        user.is_used = true;
                    }
                }
                StateKind::Task { task, slot, .. } => {
                    self.name_slot_of(Some(*slot));
                    let (Some(user), Some(task)) =
                        (self.tasks.get_mut(*task), model.tasks.get(*task))
                    else {
                        continue;
                    };
                    user.is_used = true;
                    let tree::StateKind::Task {
                        with, with_broken, ..
                    } = &tree.kind
                    else {
                        continue;
                    };
                    let named: HashSet<&str> =
                        with.iter().map(|(name, _)| text(trees, name.0)).collect();
                    // A name that is not one of the parameters may have been meant for any.
                    let known: HashSet<&str> = task
                        .params
                        .iter()
                        .map(|param| param.name.as_str())
                        .filter(|name| named.contains(name))
                        .collect();
                    let is_certain = !with_broken && known.len() == named.len();
                    for (param, is_named) in task.params.iter().zip(&mut user.params) {
                        *is_named |= !is_certain || named.contains(param.name.as_str());
                    }
                }
            }
        }
    }

    fn transitions(&mut self, index: usize, region: &Region, holes: &RegionHoles) {
        let is_whole = !holes.body
            && holes.transitions.is_empty()
            && holes.guards.is_empty()
            && holes.actions.is_empty();
        if !is_whole {
            // What is missing may use any flag that can be used here.
            self.use_all_flags(index, region);
            return;
        }
        for transition in &region.transitions {
            self.transition(index, region, transition);
        }
    }

    fn use_all_flags(&mut self, index: usize, region: &Region) {
        let all = |user: Option<&mut User>| {
            user.into_iter()
                .flat_map(|user| &mut user.flags)
                .for_each(|used| *used = true);
        };
        all(self.containers.get_mut(index));
        for state in &region.states {
            match state.kind {
                StateKind::Simple => {}
                StateKind::Task { task, .. } => all(self.tasks.get_mut(task)),
                StateKind::Super { container } => all(self.containers.get_mut(container)),
            }
        }
    }

    fn transition(&mut self, index: usize, region: &Region, transition: &Transition) {
        let source = match transition.source {
            Source::Initial => None,
            Source::State(state) => region.states.get(state),
        };
        let target = match transition.target {
            Target::Final => None,
            Target::State(state) => region.states.get(state),
        };
        for action in &transition.actions {
            match *action {
                Action::Send(_) => {}
                Action::Own(flag, _) => self.use_own(target.map(|state| &state.kind), flag),
                Action::Parent(flag, _) => self.use_of_container(index, flag),
            }
        }
        // The depth of a guard is bounded by the parser, and a list needs no bound at all.
        let mut terms: Vec<&Guard> = transition.guard.iter().collect();
        while let Some(term) = terms.pop() {
            match term {
                Guard::Exit | Guard::Timeout | Guard::Busy => {}
                Guard::Own(flag) => self.use_own(source.map(|state| &state.kind), *flag),
                Guard::Parent(flag) => self.use_of_container(index, *flag),
                Guard::Not(inner) => terms.push(inner),
                Guard::And(inner) | Guard::Or(inner) => terms.extend(inner),
            }
        }
    }

    fn use_own(&mut self, kind: Option<&StateKind>, flag: usize) {
        let user = match kind {
            Some(StateKind::Task { task, .. }) => self.tasks.get_mut(*task),
            Some(StateKind::Super { container }) => self.containers.get_mut(*container),
            Some(StateKind::Simple) | None => None,
        };
        if let Some(used) = user.and_then(|user| user.flags.get_mut(flag)) {
            *used = true;
        }
    }

    fn use_of_container(&mut self, index: usize, flag: usize) {
        let user = self.containers.get_mut(index);
        if let Some(used) = user.and_then(|user| user.flags.get_mut(flag)) {
            *used = true;
        }
    }
}

/// Whether some task or task state names a slot that could not be read, or that does not exist.
fn has_broken_slot(trees: &Trees<'_>) -> bool {
    let of_tasks = trees
        .trees
        .iter()
        .flat_map(|file| &file.tasks)
        .map(|task| task.slot);
    let of_states = trees
        .trees
        .iter()
        .flat_map(|file| &file.containers)
        .flat_map(|container| &container.regions)
        .flat_map(|region| &region.states)
        .filter_map(|state| match &state.kind {
            tree::StateKind::Task { slot, .. } => Some(*slot),
            _ => None,
        });
    let declared: HashSet<u32> = trees
        .trees
        .iter()
        .flat_map(|file| &file.slots)
        .filter_map(|slot| Some(slot.number?.value))
        .collect();
    let of_interpreters = trees
        .trees
        .iter()
        .flat_map(|file| &file.interpreters)
        .map(|interpreter| Given::from_read(interpreter.slot));
    of_tasks
        .chain(of_states)
        .chain(of_interpreters)
        .any(|slot| match slot {
            Given::Absent => false,
            Given::Broken => true,
            Given::Value(number) => number.value != 0 && !declared.contains(&number.value),
        })
}

/// For each name, whether it stood there before: then the first is the one that counts, and nothing
/// is said about this.
fn repeated<'n>(names: impl Iterator<Item = &'n str>) -> Vec<bool> {
    let mut seen = HashSet::new();
    names.map(|name| !seen.insert(name)).collect()
}

fn text<'t>(trees: &Trees<'t>, span: Span) -> &'t str {
    trees
        .files
        .get(span.file as usize)
        .and_then(|file| file.text.get(span.start as usize..span.end as usize))
        .unwrap_or("")
}
