//! Regions: states, transitions, guards, actions.

use crate::lang::analysis::holes::{LooseTransition, RegionHoles, StateHoles};
use crate::lang::cure::{Cure, insert_behind, remove_action};
use crate::lang::diagnostic::{Code, Diagnostic, Edit, Fix};
use crate::lang::tree::{
    self, Endpoint, Given, GuardKind, GuardTerm, Literal, Name, Number, SystemFlag,
};
use crate::model::{
    Action, ContainerEvent, Direction, Guard, Model, Region, SlotRef, Source, Span, State,
    StateKind, Target, Transition, Trigger, Value,
};

use super::demand::Demand;
use super::links::LinkTable;
use super::literals;
use super::scope::{Found, Names, Scope};
use super::slots::{MAX_SLOTS_PROPOSED, SlotTable};
use super::tasks::{self, TaskTable};
use super::{ContainerFacts, Kind, ResolvedRegion, StateFacts};

/// What regions refer to.
pub(super) struct Resolver<'r, 'f> {
    pub(super) containers: &'r Scope<'f>,
    pub(super) facts: &'r [ContainerFacts<'f>],
    pub(super) tasks: &'r TaskTable<'f>,
    pub(super) links: &'r LinkTable<'f>,
    pub(super) slots: &'r SlotTable,
    /// Tasks, and events of containers.
    pub(super) model: &'r Model,
}

/// The container in which something stands.
#[derive(Clone, Copy)]
struct Around<'r, 'f> {
    name: &'f str,
    is_machine: bool,
    /// Up to the brace behind which its declarations start, where that was found.
    body: Option<Span>,
    tree: &'f tree::Container,
    facts: &'r ContainerFacts<'f>,
    events: &'r [ContainerEvent],
}

/// A state at one end of a transition.
#[derive(Clone, Copy)]
enum End<'f> {
    /// `initial` or `final`.
    Pseudo(&'static str),
    /// A state, by its name and kind.
    State(&'f str, Kind),
    /// One that is not known; nothing is said about it.
    Unknown,
}

/// How a flag is used, and so which direction it must have.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Use {
    /// `.F` in a guard: `out`.
    ReadOwn,
    /// `.F` in an action: `in`.
    WriteOwn,
    /// `^F` in a guard: both.
    ReadParent,
    /// `^F` in an action: `out`.
    WriteParent,
}

impl Use {
    /// The direction against which this is; none where both will do.
    fn against(self) -> Option<Direction> {
        match self {
            Use::ReadOwn | Use::WriteParent => Some(Direction::In),
            Use::WriteOwn => Some(Direction::Out),
            Use::ReadParent => None,
        }
    }
}

impl<'f> Resolver<'_, 'f> {
    /// Resolves the regions of the container with an index.
    pub(super) fn regions(
        &self,
        trees: &[&'f tree::Container],
        index: usize,
        names: &mut Names<'f, '_>,
    ) -> Vec<ResolvedRegion> {
        let (Some(&tree), Some(facts), Some(container)) = (
            trees.get(index),
            self.facts.get(index),
            self.model.containers.get(index),
        ) else {
            return Vec::new();
        };
        let around = Around {
            name: tree.name.map_or("", |name| names.text(name.0)),
            is_machine: tree.is_machine,
            body: start_of_body(tree.span, names),
            tree,
            facts,
            events: &container.events,
        };
        let mut scope = Scope::default();
        tree.regions
            .iter()
            .enumerate()
            .map(|(region_index, region)| {
                names.declare(&mut scope, region.name, region_index, "region");
                self.region(region, around, names)
            })
            .collect()
    }

    fn region(
        &self,
        tree: &'f tree::Region,
        around: Around<'_, 'f>,
        names: &mut Names<'f, '_>,
    ) -> ResolvedRegion {
        let mut scope = Scope::default();
        let (states, facts): (Vec<State>, Vec<StateFacts>) = tree
            .states
            .iter()
            .enumerate()
            .map(|(index, state)| {
                names.declare(&mut scope, state.name, index, "state");
                self.state(state, names)
            })
            .unzip();
        scope.may_hide(names, &tree.skipped, tree.is_cut);
        let mut region = Region {
            name: tree.name.map_or("", |name| names.text(name.0)).to_owned(),
            states,
            transitions: Vec::with_capacity(tree.transitions.len()),
            docs: names.docs(tree.docs),
            span: tree.name.map_or(tree.span, |name| name.0),
        };
        let mut holes = RegionHoles {
            body: tree.has_gaps || !tree.skipped.is_empty(),
            states: state_holes(tree, &scope, &facts, names),
            ..RegionHoles::default()
        };
        let mut has_initial = tree.may_have_initial;
        for transition in &tree.transitions {
            let context = Context {
                resolver: self,
                around,
                region: &region,
                states: &scope,
                facts: &facts,
            };
            has_initial |= context.leaves_initial(transition, names);
            match context.transition(transition, names) {
                Resolved::Whole(transition) => region.transitions.push(transition),
                Resolved::Loose(transition) => holes.transitions.push(transition),
                Resolved::Lacking {
                    transition,
                    guard,
                    actions,
                } => {
                    let index = region.transitions.len();
                    holes.guards.extend(guard.then_some(index));
                    holes.actions.extend(actions.then_some(index));
                    region.transitions.push(transition);
                }
            }
        }
        // Where a region starts is part of what it does: without it nothing is known of what can be
        // reached.
        holes.body |= !has_initial;
        if let (Some(name), false) = (tree.name, has_initial) {
            let first = region
                .states
                .first()
                .map_or("A", |state| state.name.as_str());
            let mut diagnostic = Diagnostic::new(
                Code::E004,
                name.0,
                format!("region `{}` has no initial transition", region.name),
            )
            .hint(format!("say where it starts: `initial -> {first};`"));
            if let Some(state) = region.states.first().filter(|it| !it.name.is_empty()) {
                let statement = format!("initial -> {first};");
                let text = names.file_text(state.declaration);
                let insert = insert_behind(text, state.declaration, &statement);
                diagnostic = diagnostic.fix(Fix::one(format!("write `{statement}`"), insert));
            }
            names.report(diagnostic);
        }
        ResolvedRegion {
            region,
            facts,
            holes,
        }
    }

    // ─── States ──────────────────────────────────────────────────────────────────────────────────

    fn state(&self, tree: &tree::State, names: &mut Names<'f, '_>) -> (State, StateFacts) {
        let name = tree.name.map_or("", |name| names.text(name.0));
        let mut facts = StateFacts {
            kind: Kind::Unknown,
            span: tree.span,
            place_of_attributes: tree.place_of_attributes(),
            has_limit: tree.timeout_us.is_given(),
            own_slot: None,
            slot: None,
        };
        let kind = match &tree.kind {
            tree::StateKind::Simple => {
                facts.kind = Kind::Simple;
                StateKind::Simple
            }
            tree::StateKind::Super { container } => {
                let container = container.and_then(|it| self.container(it, name, tree.span, names));
                facts.kind = container.map_or(Kind::Unknown, Kind::Super);
                StateKind::Super {
                    container: container.unwrap_or(0),
                }
            }
            tree::StateKind::Task {
                task,
                dispatcher,
                slot,
                slot_word,
                with,
                with_broken,
            } => {
                if let (Given::Value(_), Given::Value(number), Some(word)) =
                    (dispatcher, slot, slot_word)
                    && number.value == 0
                {
                    let message = "a dispatcher runs in a slot of its own, not in slot 0";
                    let hint =
                        "frames have their times, and slot 0 has none: name a slot from 1 on";
                    names.report(Diagnostic::new(Code::E014, *word, message).hint(hint));
                }
                let task = task.and_then(|reference| {
                    match dispatcher {
                        Given::Absent => {}
                        Given::Broken => return None,
                        Given::Value((direction, _)) => {
                            return self
                                .links
                                .dispatcher(reference, *direction, self.model, names);
                        }
                    }
                    names.resolve(&self.tasks.names, reference, "task", |task| {
                        if matches!(self.containers.find(task), Found::Index(_)) {
                            let hint = format!("it is a container: write `super {name}: {task}`");
                            return with_word(hint, tree.span, "task", "super");
                        }
                        if self.links.has(task) {
                            return Cure::say(format!(
                                "it is a link: write `{task}.transmit` or `{task}.receive`"
                            ));
                        }
                        Cure::say(format!(
                            "declare it (`task {task} {{ … }}`) or `use` the file that does"
                        ))
                    })
                });
                facts.kind = task.map_or(Kind::Unknown, Kind::Task);
                let slot = self.task_state_slot(*slot, task, name, &mut facts, names);
                let params = task
                    .map(|task| self.parameters(task, with, *with_broken, name, tree.span, names));
                StateKind::Task {
                    task: task.unwrap_or(0),
                    slot: slot.unwrap_or(SlotRef::NonRealTime),
                    params: params.unwrap_or_default(),
                }
            }
        };
        let state = State {
            name: name.to_owned(),
            kind,
            timeout_us: tree.timeout_us.value(),
            docs: names.docs(tree.docs),
            span: tree.name.map_or(tree.span, |name| name.0),
            declaration: tree.span,
        };
        (state, facts)
    }

    /// The container of the superstate `state`.
    fn container(
        &self,
        reference: Name,
        state: &str,
        span: Span,
        names: &mut Names<'f, '_>,
    ) -> Option<usize> {
        names.resolve(self.containers, reference, "container", |container| {
            if matches!(self.tasks.names.find(container), Found::Index(_)) {
                let hint = format!("it is a task: write `task {state}: {container}`");
                return with_word(hint, span, "super", "task");
            }
            Cure::say(format!(
                "declare it (`container {container} {{ … }}`) or `use` the file that does"
            ))
        })
    }

    /// The slot of a task state: its own, else its task's.
    fn task_state_slot(
        &self,
        own: Given<Number>,
        task: Option<usize>,
        name: &str,
        facts: &mut StateFacts,
        names: &mut Names<'f, '_>,
    ) -> Option<SlotRef> {
        let slot = match own {
            Given::Broken => None,
            Given::Value(number) => {
                let wcet_us = task.and_then(|task| self.model.tasks.get(task)?.wcet_us);
                let demand = Demand::of_one(wcet_us.unwrap_or(0));
                let slot = self.slots.resolve(number, demand, names);
                if let Some(SlotRef::Slot(index)) = slot {
                    facts.own_slot = Some(index);
                }
                slot
            }
            Given::Absent => {
                let task = task.and_then(|task| Some((task, self.tasks.facts(task)?)))?;
                if task.1.slot == Given::Absent {
                    let declared = self.model.tasks.get(task.0);
                    let task_name = declared.map_or("", |task| &task.name);
                    let is_dispatcher = declared.is_some_and(|task| task.dispatcher.is_some());
                    let or_none = match is_dispatcher {
                        true => "",
                        false => ", or `slot 0` for one without real time",
                    };
                    let mut diagnostic = Diagnostic::new(
                        Code::E009,
                        facts.span,
                        format!(
                            "neither task state `{name}` nor its task `{task_name}` names a \
                            slot"
                        ),
                    )
                    .hint(format!("write `task {name}: {task_name} slot 1`{or_none}"))
                    .related(task.1.span, "the task");
                    if let Some(place) = facts.place_of_attributes {
                        for number in self.proposed_slots(!is_dispatcher) {
                            let insert = Edit::behind(place, format!(" slot {number}"));
                            let title = format!("run it in slot {number}");
                            diagnostic = diagnostic.fix(Fix::one(title, insert));
                        }
                    }
                    names.report(diagnostic);
                }
                task.1.slot.value()
            }
        };
        if let Some(SlotRef::Slot(index)) = slot {
            facts.slot = Some(index);
        }
        slot
    }

    /// Slots that a task state can be given: those that do not run the interpreter, and, where it
    /// can run there, the one without real time.
    fn proposed_slots(&self, has_slot_0: bool) -> impl Iterator<Item = u32> {
        let slots = self.model.slots.iter().enumerate();
        slots
            .filter(|(index, _)| self.model.interpreter_slot != Some(*index))
            .map(|(_, slot)| slot.number)
            .take(MAX_SLOTS_PROPOSED)
            .chain(has_slot_0.then_some(0))
    }

    /// One value for each parameter of the task.
    fn parameters(
        &self,
        task: usize,
        with: &[(Name, Option<Literal>)],
        with_broken: bool,
        state: &str,
        span: Span,
        names: &mut Names<'f, '_>,
    ) -> Vec<Value> {
        let (Some(model), Some(facts)) = (self.model.tasks.get(task), self.tasks.facts(task))
        else {
            return Vec::new();
        };
        let mut given: Vec<Option<Span>> = vec![None; model.params.len()];
        let mut values: Vec<Option<Value>> =
            model.params.iter().map(|param| param.default).collect();
        let mut is_certain = !with_broken;
        for &(name, literal) in with {
            let known = names.resolve(&facts.params, name, "parameter", |_| {
                let params = model.params.iter().map(|param| param.name.as_str());
                format!("task `{}` has {}", model.name, list_of("parameter", params))
            });
            let Some(index) = known else {
                // It may have been meant for one that now seems to have no value.
                is_certain = false;
                continue;
            };
            let (Some(param), Some(seen), Some(value)) = (
                model.params.get(index),
                given.get_mut(index),
                values.get_mut(index),
            ) else {
                continue;
            };
            if let Some(first) = *seen {
                names.defined_twice("parameter", &param.name, name.0, first);
                continue;
            }
            *seen = Some(name.0);
            let has_type = facts
                .param_facts
                .get(index)
                .is_some_and(|facts| facts.param_type.is_some());
            if let (Some(literal), true) = (literal, has_type) {
                *value = tasks::read_value(literal, param, names);
            }
        }
        let missing: Vec<&crate::model::Param> = model
            .params
            .iter()
            .zip(&facts.param_facts)
            .zip(&given)
            .enumerate()
            .filter(|(index, ((param, param_facts), given))| {
                given.is_none()
                    && !param_facts.has_default
                    && facts.params.is_first(&param.name, *index)
            })
            .map(|(_, ((param, _), _))| param)
            .collect();
        if let (true, Some(first)) = (is_certain, missing.first()) {
            let list = list_of("parameter", missing.iter().map(|it| it.name.as_str()));
            let mut diagnostic = Diagnostic::new(
                Code::E009,
                span,
                format!(
                    "task state `{state}` gives no value to {list} of task `{}`",
                    model.name
                ),
            )
            .hint(format!(
                "write `with {{ {} = … }}`, or give it a default in the task",
                first.name
            ))
            .related(facts.span, "the task");
            let values: Vec<String> = missing
                .iter()
                .map(|it| {
                    let value = literals::some_value(it.param_type, it.range);
                    format!("{} = {value}", it.name)
                })
                .collect();
            let values = values.join(", ");
            let last = with.last().and_then(|(_, literal)| *literal);
            let edit = match last {
                Some(last) => Some(Edit::behind(last.span, format!(", {values}"))),
                None if with.is_empty() && names.text(span).ends_with(';') => {
                    let end = span.end - 1;
                    let place = Span { end, ..span };
                    Some(Edit::behind(place, format!(" with {{ {values} }}")))
                }
                None => None,
            };
            if let Some(edit) = edit {
                let title = format!("write `{values}`, and then the values that you want");
                diagnostic = diagnostic.fix(Fix::one(title, edit));
            }
            names.report(diagnostic);
        }
        values
            .into_iter()
            .map(|value| value.unwrap_or(Value::Bool(false)))
            .collect()
    }
}

/// From the head of a declaration to its `{`.
fn start_of_body(head: Span, names: &Names<'_, '_>) -> Option<Span> {
    let behind = names.file_text(head).get(head.end as usize..)?;
    let brace = behind.find('{')?;
    let end = head.end + brace as u32 + 1;
    behind
        .get(..brace)?
        .trim()
        .is_empty()
        .then_some(Span { end, ..head })
}

/// A hint with the change that replaces the first word of a declaration.
fn with_word(hint: String, declaration: Span, word: &str, meant: &str) -> Cure {
    let end = declaration.start + word.len() as u32;
    Cure::say(hint).fix(Fix::write(Span { end, ..declaration }, meant))
}

/// "no parameters", "parameter `a`", "parameters `a`, `b`"
pub(super) fn list_of<'n>(what: &str, mut names: impl Iterator<Item = &'n str>) -> String {
    /// More than this is not worth reading.
    const MAX_SHOWN: usize = 8;
    let shown: Vec<String> = names
        .by_ref()
        .take(MAX_SHOWN)
        .map(|name| format!("`{name}`"))
        .collect();
    let more = if names.next().is_some() { ", …" } else { "" };
    match shown.len() {
        0 => format!("no {what}s"),
        1 => format!("{what} {}", shown.concat()),
        _ => format!("{what}s {}{more}", shown.join(", ")),
    }
}

/// What is not known of the states of a region.
fn state_holes<'f>(
    tree: &tree::Region,
    scope: &Scope<'f>,
    facts: &[StateFacts],
    names: &Names<'f, '_>,
) -> Vec<StateHoles> {
    tree.states
        .iter()
        .zip(facts)
        .enumerate()
        .map(|(index, (state, facts))| StateHoles {
            kind: facts.kind == Kind::Unknown,
            limit: state.timeout_us == Given::Broken,
            is_twin: state
                .name
                .is_none_or(|name| !scope.is_first(names.text(name.0), index)),
        })
        .collect()
}

/// What a transition came to.
enum Resolved {
    Whole(Transition),
    /// What is there is right, but it is not all.
    Lacking {
        transition: Transition,
        /// The guard is not known.
        guard: bool,
        /// There are more actions.
        actions: bool,
    },
    /// An end or the trigger is not known.
    Loose(LooseTransition),
}

/// What other tools call the pseudo-states.
const WORDS_FOR_INITIAL: [&str; 5] = ["start", "begin", "init", "entry", "default"];
const WORDS_FOR_FINAL: [&str; 5] = ["end", "finish", "finished", "done", "terminate"];

fn is_one_of(text: &str, words: &[&str]) -> bool {
    words.iter().any(|word| word.eq_ignore_ascii_case(text))
}

/// Where a transition stands.
struct Context<'r, 'f> {
    resolver: &'r Resolver<'r, 'f>,
    around: Around<'r, 'f>,
    region: &'r Region,
    states: &'r Scope<'f>,
    facts: &'r [StateFacts],
}

impl<'f> Context<'_, 'f> {
    /// Whether a transition is one from `initial`, or was probably meant to be.
    fn leaves_initial(&self, tree: &tree::Transition, names: &mut Names<'f, '_>) -> bool {
        match tree.source {
            Endpoint::Pseudo => true,
            Endpoint::State(name) => {
                let text = names.text(name.0);
                self.states.find(text) == Found::Nothing
                    && (names.meant(text, &["initial"]).is_some()
                        || is_one_of(text, &WORDS_FOR_INITIAL))
            }
        }
    }

    fn transition(&self, tree: &tree::Transition, names: &mut Names<'f, '_>) -> Resolved {
        let (source, source_end) = match tree.source {
            Endpoint::Pseudo => (Some(Source::Initial), End::Pseudo("initial")),
            Endpoint::State(name) => {
                let state = self.state(name, "initial", names);
                (state.map(Source::State), self.end(state, name, names))
            }
        };
        let (target, target_end) = match tree.target {
            Some(Endpoint::Pseudo) => (Some(Target::Final), End::Pseudo("final")),
            Some(Endpoint::State(name)) => {
                let state = self.state(name, "final", names);
                (state.map(Target::State), self.end(state, name, names))
            }
            None => (None, End::Unknown),
        };
        let trigger = self.trigger(tree, source_end, names);
        let guard = match (&tree.guard, tree.trigger) {
            (Given::Value(term), Given::Value(tree::Trigger::Star(_))) => {
                let mut diagnostic = Diagnostic::new(Code::E006, term.span, "`on *` takes no guard")
                    .hint(
                        "it is taken when the state has finished: write `on pulse [exit and …]` to ask for more",
                    );
                if let Given::Value(tree::Trigger::Star(star)) = tree.trigger {
                    let is_or = matches!(term.kind, GuardKind::Or(_));
                    let (open, close) = if is_or {
                        ("exit and (", ")")
                    } else {
                        ("exit and ", "")
                    };
                    let edits = vec![
                        Edit::replace(star, "pulse"),
                        Edit::before(term.span, open),
                        Edit::behind(term.span, close),
                    ];
                    let title = "write `on pulse [exit and …]`";
                    diagnostic = diagnostic.fix(Fix::new(title, edits));
                }
                names.report(diagnostic);
                None
            }
            (Given::Value(term), _) => self.guard(term, source_end, names),
            _ => None,
        };
        let actions: Vec<Action> = tree
            .actions
            .iter()
            .filter_map(|&action| self.action(action, target_end, names))
            .collect();
        let (Some(source), Some(target), Some(trigger)) = (source, target, trigger) else {
            return Resolved::Loose(LooseTransition { source, target });
        };
        let lacks_guard = tree.guard.is_given() && guard.is_none();
        let lacks_actions = actions.len() < tree.actions.len();
        let transition = Transition {
            source,
            target,
            trigger,
            guard,
            actions,
            span: tree.span,
        };
        if lacks_guard || lacks_actions {
            Resolved::Lacking {
                transition,
                guard: lacks_guard,
                actions: lacks_actions,
            }
        } else {
            Resolved::Whole(transition)
        }
    }

    fn state(&self, name: Name, pseudo: &'static str, names: &mut Names<'f, '_>) -> Option<usize> {
        let text = names.text(name.0);
        match self.states.find(text) {
            Found::Index(index) => {
                names.refer_into(self.states, name);
                Some(index)
            }
            Found::Perhaps => None,
            Found::Nothing => {
                let words = match pseudo {
                    "initial" => &WORDS_FOR_INITIAL,
                    _ => &WORDS_FOR_FINAL,
                };
                let meant = names
                    .meant(text, self.states.names())
                    .or_else(|| names.meant(text, &[pseudo]))
                    .or_else(|| is_one_of(text, words).then_some(pseudo));
                let cure = match (meant, self.region.states.last()) {
                    (Some(meant), _) => Cure::meant(name.0, meant),
                    (None, last) => {
                        let region = &self.region.name;
                        let statement = format!("state {text};");
                        let cure =
                            Cure::say(format!("declare it in region `{region}`: `{statement}`"));
                        match last {
                            Some(last) => {
                                let file = names.file_text(last.declaration);
                                let insert = insert_behind(file, last.declaration, &statement);
                                cure.fix(Fix::one(format!("declare `{statement}`"), insert))
                            }
                            None => cure,
                        }
                    }
                };
                names.unknown(name, "state", cure);
                None
            }
        }
    }

    fn end(&self, state: Option<usize>, name: Name, names: &Names<'f, '_>) -> End<'f> {
        state
            .and_then(|state| self.facts.get(state))
            .map_or(End::Unknown, |facts| match facts.kind {
                Kind::Unknown => End::Unknown,
                kind => End::State(names.text(name.0), kind),
            })
    }

    fn trigger(
        &self,
        tree: &tree::Transition,
        source: End<'f>,
        names: &mut Names<'f, '_>,
    ) -> Option<Trigger> {
        match tree.trigger {
            Given::Absent | Given::Value(tree::Trigger::Pulse) => Some(Trigger::Pulse),
            Given::Broken => None,
            Given::Value(tree::Trigger::Event(name)) => self.event(name, names).map(Trigger::Event),
            Given::Value(tree::Trigger::Star(span)) => {
                let what = match source {
                    End::Pseudo(word) => format!("the pseudo-state `{word}`"),
                    End::State(name, Kind::Simple) => format!("the simple state `{name}`"),
                    End::State(..) | End::Unknown => return Some(Trigger::Star),
                };
                let mut diagnostic = Diagnostic::new(
                    Code::E006,
                    span,
                    format!("`on *` from {what}, which never finishes"),
                )
                .hint(
                    "only task states and superstates finish: leave `on *` out to be taken on \
                    the pulse",
                );
                let before = names.file_text(span).get(..span.start as usize);
                if let Some(before) = before.and_then(|it| it.trim_end().strip_suffix("on")) {
                    let start = before.trim_end().len() as u32;
                    let edit = Edit::remove(Span { start, ..span });
                    diagnostic = diagnostic.fix(Fix::one("remove `on *`", edit));
                }
                names.report(diagnostic);
                None
            }
        }
    }

    /// An event that the container sees, as index into the events of the model.
    fn event(&self, name: Name, names: &mut Names<'f, '_>) -> Option<usize> {
        let container = self.around.name;
        let is_machine = self.around.is_machine;
        let index = names.resolve(&self.around.facts.events, name, "event", |event| {
            if is_one_of(event, &["tick", "always", "every", "clock", "true"]) {
                let hint = "what is looked at in every step is `on pulse`, or has no `on` at all";
                return Cure::say(hint).fix(Fix::write(name.0, "pulse"));
            }
            if is_one_of(event, &["completed", "completion"]) {
                let hint = "that a task or superstate has finished is `on *`";
                return Cure::say(hint).fix(Fix::write(name.0, "*"));
            }
            let forward = if is_machine {
                ""
            } else {
                ", or `in event` to receive it from outside"
            };
            let statement = format!("event {event};");
            let cure = Cure::say(format!(
                "declare it in `{container}`: `{statement}`{forward}"
            ));
            match self.around.body {
                Some(body) => {
                    let insert = Edit::behind(body, format!("\n    {statement}"));
                    cure.fix(Fix::one(format!("declare `{statement}`"), insert))
                }
                None => cure,
            }
        })?;
        self.around.events.get(index).map(|event| event.event)
    }

    // ─── Guards ──────────────────────────────────────────────────────────────────────────────────

    /// Resolves a guard. The depth of the recursion is that of the tree, which the parser bounds.
    fn guard(&self, term: &GuardTerm, source: End<'f>, names: &mut Names<'f, '_>) -> Option<Guard> {
        let mut all = |terms: &[GuardTerm]| {
            // All terms are resolved, so that all that is wrong is reported.
            let terms: Vec<Option<Guard>> = terms
                .iter()
                .map(|term| self.guard(term, source, names))
                .collect();
            terms.into_iter().collect::<Option<Vec<Guard>>>()
        };
        match &term.kind {
            GuardKind::And(terms) => all(terms).map(Guard::And),
            GuardKind::Or(terms) => all(terms).map(Guard::Or),
            GuardKind::Not(inner) => self
                .guard(inner, source, names)
                .map(|inner| Guard::Not(Box::new(inner))),
            GuardKind::System(flag) => self.system_flag(*flag, term.span, source, names),
            GuardKind::Own(name) => self
                .own_flag(*name, source, Use::ReadOwn, names)
                .map(Guard::Own),
            GuardKind::Parent(name) => self
                .parent_flag(*name, source, Use::ReadParent, names)
                .map(Guard::Parent),
        }
    }

    fn system_flag(
        &self,
        flag: SystemFlag,
        span: Span,
        source: End<'f>,
        names: &mut Names<'f, '_>,
    ) -> Option<Guard> {
        let (word, guard) = match flag {
            SystemFlag::Exit => ("exit", Guard::Exit),
            SystemFlag::Timeout => ("timeout", Guard::Timeout),
            SystemFlag::Busy => ("busy", Guard::Busy),
        };
        let (message, hint) = match source {
            End::Pseudo(pseudo) => (
                format!("the pseudo-state `{pseudo}` has no `{word}`"),
                "a guard from `initial` can use `^` flags only",
            ),
            End::State(name, Kind::Simple) if flag != SystemFlag::Timeout => (
                format!("the simple state `{name}` has no `{word}`"),
                "only task states and superstates have it; a simple state has `timeout`",
            ),
            End::State(name, _) => {
                if flag == SystemFlag::Timeout {
                    self.check_limit(name, span, names);
                }
                return Some(guard);
            }
            End::Unknown => return Some(guard),
        };
        names.report(Diagnostic::new(Code::E006, span, message).hint(hint));
        None
    }

    /// Reports that `timeout` is read of a state that has no limit of time.
    fn check_limit(&self, state: &str, word: Span, names: &mut Names<'f, '_>) {
        let Found::Index(index) = self.states.find(state) else {
            return;
        };
        if let (Some(facts), Some(declared)) =
            (self.facts.get(index), self.region.states.get(index))
            && !facts.has_limit
        {
            let mut diagnostic = Diagnostic::new(
                Code::W109,
                word,
                format!("state `{state}` has no limit of time, so its `timeout` is never true"),
            )
            .hint(format!(
                "give it one where it is declared (`{} timeout 1 s;`), or leave `timeout` out of \
                    the guard",
                self.written(declared)
            ))
            .related(facts.span, "the state");
            if let Some(place) = facts.place_of_attributes {
                let title = format!("give `{state}` a limit, `timeout 1 s`");
                let insert = Edit::behind(place, " timeout 1 s");
                diagnostic = diagnostic.fix(Fix::one(title, insert));
            }
            names.report(diagnostic);
        }
    }

    /// How a state is declared, as far as that helps to find it.
    fn written(&self, state: &State) -> String {
        let word = match state.kind {
            StateKind::Simple => "state",
            StateKind::Task { .. } => "task",
            StateKind::Super { .. } => "super",
        };
        let colon = if word == "state" { "" } else { ": …" };
        format!("{word} {}{colon}", state.name)
    }

    // ─── Flags ───────────────────────────────────────────────────────────────────────────────────

    /// A flag of a task state or superstate, as index into the flags of its task or container.
    fn own_flag(
        &self,
        name: Name,
        end: End<'f>,
        usage: Use,
        names: &mut Names<'f, '_>,
    ) -> Option<usize> {
        let flag = names.text(name.0);
        let (state, kind) = match end {
            End::Unknown => return None,
            End::Pseudo(pseudo) => {
                let hint = if pseudo == "initial" {
                    "a guard from `initial` can use `^` flags only"
                } else {
                    "`final` has no flags: set one of the container with `^`"
                };
                let message = format!("the pseudo-state `{pseudo}` has no flag `{flag}`");
                names.report(Diagnostic::new(Code::E006, name.0, message).hint(hint));
                return None;
            }
            End::State(state, kind) => (state, kind),
        };
        if kind == Kind::Simple {
            let message = format!("the simple state `{state}` has no flag `{flag}`");
            let mut diagnostic = Diagnostic::new(Code::E006, name.0, message)
                .hint("only task states and superstates have flags");
            if matches!(self.around.facts.flags.find(flag), Found::Index(_)) {
                diagnostic.fixes = with_sign(String::new(), name, "^", names).fixes;
            }
            names.report(diagnostic);
            return None;
        }
        let flags = self.flags_of(end)?;
        let owner = match kind {
            Kind::Task(task) => format!("task `{}`", self.resolver.model.tasks.get(task)?.name),
            Kind::Super(container) => {
                let container = self.resolver.model.containers.get(container)?;
                format!("container `{}`", container.name)
            }
            Kind::Unknown | Kind::Simple => return None,
        };
        let word = if usage == Use::ReadOwn { "out" } else { "in" };
        let index = names.resolve_or(flags.names, name, "flag", |flag, names| {
            if let Some(meant) = flags.meant(flag, usage, names) {
                Cure::meant(name.0, meant)
            } else if matches!(self.around.facts.flags.find(flag), Found::Index(_)) {
                let around = self.around.name;
                let hint = format!("`^{flag}` is the flag of container `{around}`");
                with_sign(hint, name, "^", names)
            } else if let Some(other) = self.state_with_flag(flag, names) {
                Cure::say(match usage {
                    Use::ReadOwn => format!(
                        "it is a flag of state `{other}`, and a guard reads those of the state \
                            that is left: let `{other}` send an event (`/ send E`, and `on E` \
                            here), or set a flag of the container (`^f`)"
                    ),
                    _ => format!(
                        "it is a flag of state `{other}`, and an action sets those of the state \
                            that is entered: send an event instead"
                    ),
                })
            } else if matches!(kind, Kind::Task(_)) {
                Cure::say(format!(
                    "{owner} has no such flag: what it can be told and asked stands in its \
                        declaration"
                ))
            } else {
                Cure::say(format!("declare it in {owner}: `{word} flag {flag};`"))
            }
        })?;
        let declared = match kind {
            Kind::Task(task) => self.resolver.model.tasks.get(task).map(|it| &it.flags),
            Kind::Super(container) => {
                let containers = &self.resolver.model.containers;
                containers.get(container).map(|it| &it.flags)
            }
            Kind::Unknown | Kind::Simple => None,
        };
        let declared = declared
            .and_then(|flags| flags.get(index))
            .map(|it| it.span);
        let owner = Owner {
            name: &owner,
            is_task: matches!(kind, Kind::Task(_)),
            declared,
        };
        check_direction(flags.directions, index, usage, name, &owner, names);
        Some(index)
    }

    /// A state of the container that has a flag of some name.
    fn state_with_flag(&self, flag: &str, names: &Names<'f, '_>) -> Option<&'f str> {
        let index = |scope: &Scope<'f>, name: Option<Name>| match scope.find(names.text(name?.0)) {
            Found::Index(index) => Some(index),
            Found::Perhaps | Found::Nothing => None,
        };
        /// More states than this are not looked through.
        const MAX_STATES: usize = 1_000;
        let regions = &self.around.tree.regions;
        let states = regions.iter().flat_map(|region| &region.states);
        states.take(MAX_STATES).find_map(|state| {
            let flags = match state.kind {
                tree::StateKind::Task { task, .. } => {
                    let task = index(&self.resolver.tasks.names, task)?;
                    &self.resolver.tasks.facts(task)?.flags
                }
                tree::StateKind::Super { container } => {
                    let container = index(self.resolver.containers, container)?;
                    &self.resolver.facts.get(container)?.flags
                }
                tree::StateKind::Simple => return None,
            };
            let has_flag = matches!(flags.find(flag), Found::Index(_));
            has_flag.then(|| names.text(state.name.map_or(Span::default(), |name| name.0)))
        })
    }

    /// The flags of a state, where it has some and they are known.
    fn flags_of(&self, end: End<'f>) -> Option<Flags<'_, 'f>> {
        let (names, directions) = match end {
            End::State(_, Kind::Task(task)) => {
                let facts = self.resolver.tasks.facts(task)?;
                (&facts.flags, &facts.flag_directions)
            }
            End::State(_, Kind::Super(container)) => {
                let facts = self.resolver.facts.get(container)?;
                (&facts.flags, &facts.flag_directions)
            }
            End::State(..) | End::Pseudo(_) | End::Unknown => return None,
        };
        Some(Flags { names, directions })
    }

    /// A flag of the container around. `end` is the state whose own flag may have been meant.
    fn parent_flag(
        &self,
        name: Name,
        end: End<'f>,
        usage: Use,
        names: &mut Names<'f, '_>,
    ) -> Option<usize> {
        if self.around.is_machine {
            let flag = names.text(name.0);
            let mut diagnostic = Diagnostic::new(
                Code::E005,
                name.0,
                format!("`^{flag}`: nothing is around a machine"),
            )
            .hint("use an event between regions, or `.` for a flag of the state itself");
            let own = self.flags_of(end).map(|own| own.names.find(flag));
            if matches!(own, Some(Found::Index(_))) {
                diagnostic.fixes = with_sign(String::new(), name, ".", names).fixes;
            }
            names.report(diagnostic);
            return None;
        }
        let flags = Flags {
            names: &self.around.facts.flags,
            directions: &self.around.facts.flag_directions,
        };
        let index = names.resolve_or(flags.names, name, "flag", |flag, names| {
            let own = self.flags_of(end);
            if let Some(meant) = flags.meant(flag, usage, names) {
                Cure::meant(name.0, meant)
            } else if let (End::State(state, _), Some(Found::Index(_))) =
                (end, own.map(|own| own.names.find(flag)))
            {
                let hint = format!("`.{flag}` is the flag of state `{state}`");
                with_sign(hint, name, ".", names)
            } else {
                let word = if usage == Use::ReadParent {
                    "in"
                } else {
                    "out"
                };
                let container = self.around.name;
                let statement = format!("{word} flag {flag};");
                let cure = Cure::say(format!(
                    "declare it in container `{container}`: `{statement}`"
                ));
                match self.around.body {
                    Some(body) => {
                        let insert = Edit::behind(body, format!("\n    {statement}"));
                        cure.fix(Fix::one(format!("declare `{statement}`"), insert))
                    }
                    None => cure,
                }
            }
        })?;
        let owner = Owner {
            name: &format!("container `{}`", self.around.name),
            is_task: false,
            declared: None,
        };
        check_direction(flags.directions, index, usage, name, &owner, names);
        Some(index)
    }

    fn action(
        &self,
        action: tree::Action,
        target: End<'f>,
        names: &mut Names<'f, '_>,
    ) -> Option<Action> {
        match action {
            tree::Action::Send(name) => self.event(name, names).map(Action::Send),
            tree::Action::Own(name, value) => self
                .own_flag(name, target, Use::WriteOwn, names)
                .map(|flag| Action::Own(flag, value)),
            tree::Action::Parent(name, value) => self
                .parent_flag(name, target, Use::WriteParent, names)
                .map(|flag| Action::Parent(flag, value)),
        }
    }
}

/// The flags of a task or container.
#[derive(Clone, Copy)]
struct Flags<'r, 'f> {
    names: &'r Scope<'f>,
    /// Of each; `None` where it could not be read.
    directions: &'r [Option<Direction>],
}

impl<'f> Flags<'_, 'f> {
    /// Proposes the flag that was probably meant: one that can be used like this, else any.
    fn meant(self, text: &str, usage: Use, names: &mut Names<'f, '_>) -> Option<&'f str> {
        let fits = |name: &&&str| {
            let Found::Index(index) = self.names.find(name) else {
                return false;
            };
            self.directions.get(index).copied().flatten() != usage.against()
        };
        let fitting: Vec<&str> = self.names.names().iter().filter(fits).copied().collect();
        names
            .meant(text, &fitting)
            .or_else(|| names.meant(text, self.names.names()))
    }
}

/// A hint with the change that replaces the sign before the name of a flag.
fn with_sign(hint: String, name: Name, sign: &str, names: &Names<'_, '_>) -> Cure {
    let cure = Cure::say(hint);
    let start = name.0.start.saturating_sub(1);
    let place = Span { start, ..name.0 };
    if !names.text(place).starts_with(['.', '^']) {
        // Blanks stand between.
        return cure;
    }
    cure.fix(Fix::write(place, format!("{sign}{}", names.text(name.0))))
}

/// Whose flags these are.
struct Owner<'n> {
    /// "task `T`"
    name: &'n str,
    is_task: bool,
    /// Where the flag is declared, where that is worth showing.
    declared: Option<Span>,
}

/// Reports a flag that is used against its direction.
fn check_direction(
    directions: &[Option<Direction>],
    index: usize,
    usage: Use,
    name: Name,
    owner: &Owner<'_>,
    names: &mut Names<'_, '_>,
) {
    let Some(Some(direction)) = directions.get(index) else {
        return;
    };
    let (word, what) = match usage {
        Use::ReadParent => return,
        Use::ReadOwn => ("in", "a transition cannot read it from its state"),
        Use::WriteOwn => ("out", "a transition cannot write it from outside"),
        Use::WriteParent => ("in", "it cannot be written inside its container"),
    };
    if Some(*direction) != usage.against() {
        return;
    }
    let hint = match (usage, owner.is_task) {
        (Use::ReadOwn, true) => {
            "`in` flags are set on the way into a state, and it is the task that reads them: to \
                remember here what was set use a flag of the container, `^f`, or a state of its \
                own"
        }
        (Use::WriteOwn, true) => {
            "only the task sets it, in the firmware, and entering the state resets it: leave the \
                action out; to tell the task something set one of its `in` flags, to tell others \
                send an event or set a flag of the container, `^f`"
        }
        (Use::WriteParent, _) => "`in` flags are set from outside; declare it `out` to set it here",
        (Use::WriteOwn, false) => {
            "`out` flags are set inside the container itself (`/ set ^f`); declare it `in` to set \
                it on the way in"
        }
        _ => {
            "`in` flags are set on the way into a state; declare it `out` to read it on the way out"
        }
    };
    let flag = names.text(name.0);
    let message = format!("`{flag}` is an `{word}` flag of {}: {what}", owner.name);
    let mut diagnostic = Diagnostic::new(Code::E005, name.0, message).hint(hint);
    if let Some(declared) = owner.declared {
        diagnostic = diagnostic.related(declared, "the flag");
    }
    if usage == Use::WriteOwn {
        let text = names.file_text(name.0);
        // What entering resets need not be cleared.
        if let Some(edit) = remove_action(text, name.0, "clear") {
            diagnostic = diagnostic.fix(Fix::one(format!("remove `clear .{flag}`"), edit));
        } else if let Some(edit) = remove_action(text, name.0, "set") {
            diagnostic = diagnostic.fix(Fix::one(format!("remove `set .{flag}`"), edit));
        }
    }
    names.report(diagnostic);
}
