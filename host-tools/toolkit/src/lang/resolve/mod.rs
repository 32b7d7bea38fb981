//! From trees to a [`Model`]: names are looked up, rules are checked.
//!
//! All declarations of the set come first (slots, tasks, ports of containers), then the bodies that
//! refer to them, then the rules that need the whole: recursion, data paths, time. What is unknown
//! stays unknown through all of it, so that one mistake is reported once: nothing is said about a
//! state whose task is unknown, or about a name that may stand in what could not be read.

mod counts;
mod declarations;
mod demand;
mod links;
mod literals;
mod nets;
mod recursion;
mod regions;
mod scope;
mod slots;
mod tasks;
mod timing;

use std::collections::HashMap;

use crate::model::{Container, ContainerEvent, Direction, Model, Path, Region, Span};

use super::analysis::activity::{Activity, View};
use super::analysis::holes::{ContainerHoles, Holes, RegionHoles};
use super::diagnostic::{Code, Diagnostic, Sink};
use super::references::References;
use super::tree::{self, EventListing};
pub(super) use declarations::Trees;
use declarations::{declare_data, declare_flags, remove};
use links::{FlagNames, LinkTable};
use scope::{Names, Scope};
use slots::SlotTable;
use tasks::TaskTable;

/// Capacity of the event queue where no `queue` says another.
const DEFAULT_QUEUE: u8 = 32;

/// What the set of files came to.
pub(super) struct Resolved {
    /// The model, right where no error was reported.
    pub(super) model: Model,
    /// What can happen in what is known of the set.
    pub(super) activity: Activity,
    /// What of the set is not in the model.
    pub(super) holes: Holes,
    /// Which places name the same thing.
    pub(super) references: References,
    /// Whether every slot of the set is known, so that a schedule can be searched.
    pub(super) slots_are_whole: bool,
    /// Per slot of the model, whether its period and duration are known.
    pub(super) known_slots: Vec<bool>,
}

/// What else is known of a container than its model: name spaces, and what its states are.
struct ContainerFacts<'f> {
    events: Scope<'f>,
    flags: Scope<'f>,
    /// Direction of each flag of the model; `None` where it could not be read.
    flag_directions: Vec<Option<Direction>>,
    data: Scope<'f>,
    /// Per region, per state.
    states: Vec<Vec<StateFacts>>,
}

/// What is known of a state.
#[derive(Clone, Copy, Debug)]
struct StateFacts {
    kind: Kind,
    /// From the word on: where things that concern the whole state are reported.
    span: Span,
    /// What a `timeout` or `slot` can be written behind.
    place_of_attributes: Option<Span>,
    /// Whether a timeout is given, readable or not.
    has_limit: bool,
    /// The slot that the state itself names, by index.
    own_slot: Option<usize>,
    /// The slot it runs in, by index; not slot 0.
    slot: Option<usize>,
}

/// What a state is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Simple,
    /// Index of a task.
    Task(usize),
    /// Index of a container.
    Super(usize),
    /// What was meant could not be found out.
    Unknown,
}

/// Resolves a set of files.
pub(super) fn resolve(set: &Trees<'_>, sink: &mut Sink) -> Resolved {
    let flag_names = FlagNames::of(set);
    let mut names = Names::new(set.files, sink);
    let mut model = Model {
        files: set.files.to_vec(),
        queue: DEFAULT_QUEUE,
        ..Model::default()
    };
    let has_machine = set
        .trees
        .iter()
        .flat_map(|tree| &tree.containers)
        .any(|container| container.is_machine);

    let slots = SlotTable::declare(set, has_machine, &mut model, &mut names);
    let mut tasks = TaskTable::declare(set, &slots, &mut model, &mut names);
    let links = LinkTable::declare(set, &flag_names, &mut model, &mut tasks, &mut names);
    let mut machine_span = None;
    let (scope, trees) = declare_containers(set, &mut model, &mut names, &mut machine_span);
    declare_queue(set, &mut model, &mut names);
    slots::declare_interpreter(set, machine_span, &slots, &mut model, &mut names);

    let mut events = EventNames::default();
    let mut facts: Vec<ContainerFacts<'_>> = trees
        .iter()
        .zip(&mut model.containers)
        .map(|(tree, container)| declare_parts(tree, container, &mut events, &mut names))
        .collect();
    // Regions refer to flags of any container, so all of these are known by now.
    let resolver = regions::Resolver {
        containers: &scope,
        facts: &facts,
        tasks: &tasks,
        links: &links,
        slots: &slots,
        model: &model,
    };
    let resolved: Vec<Vec<ResolvedRegion>> = (0..trees.len())
        .map(|index| resolver.regions(&trees, index, &mut names))
        .collect();
    let mut holes = Holes {
        set: set.is_incomplete() || set.trees.iter().any(|file| file.has_gaps),
        slots: !slots.is_whole(),
        tasks: tasks.holes(set, &names),
        containers: container_holes(&trees, &facts, &scope, &model, &names),
    };
    for (((container, facts), holes), resolved) in model
        .containers
        .iter_mut()
        .zip(&mut facts)
        .zip(&mut holes.containers)
        .zip(resolved)
    {
        for resolved in resolved {
            container.regions.push(resolved.region);
            facts.states.push(resolved.facts);
            holes.regions.push(resolved.holes);
        }
    }
    model.events = events.order.iter().map(|&name| name.to_owned()).collect();

    let order = recursion::children_first(&facts, &model, &mut names);
    counts::check(&facts, &model, order.as_deref(), &mut names);
    let paths = nets::check(&trees, &facts, &tasks, &model, order.as_deref(), &mut names);
    for ((container, holes), resolved) in model
        .containers
        .iter_mut()
        .zip(&mut holes.containers)
        .zip(paths)
    {
        container.paths = resolved.paths;
        holes.paths |= !resolved.are_whole;
    }
    let activity = Activity::of(&model, &holes, View::Known);
    timing::check(&facts, &slots, &model, &activity, &mut names);

    Resolved {
        slots_are_whole: slots.is_whole(),
        known_slots: slots.known(),
        references: names.into_references(),
        model,
        holes,
        activity,
    }
}

/// What is not known of the containers themselves; of their regions that is found out with the
/// regions.
fn container_holes<'f>(
    trees: &[&'f tree::Container],
    facts: &[ContainerFacts<'f>],
    scope: &Scope<'f>,
    model: &Model,
    names: &Names<'f, '_>,
) -> Vec<ContainerHoles> {
    trees
        .iter()
        .zip(facts)
        .enumerate()
        .map(|(index, (tree, facts))| {
            let has_gaps = tree.has_gaps || tree.is_cut || !tree.skipped.is_empty();
            let is_first = if tree.is_machine {
                model.machine == Some(index)
            } else {
                tree.name
                    .is_some_and(|name| scope.is_first(names.text(name.0), index))
            };
            ContainerHoles {
                declarations: has_gaps
                    || facts.flag_directions.contains(&None)
                    || tree.flags.iter().any(|flag| flag.name.is_none())
                    || tree.events.iter().any(|event| event.name.is_none())
                    || tree
                        .data
                        .iter()
                        .any(|port| port.name.is_none() || port.type_name.is_none()),
                paths: has_gaps || tree.paths.iter().any(|path| path.broken),
                is_twin: !is_first,
                regions: Vec::with_capacity(tree.regions.len()),
            }
        })
        .collect()
}

/// Event names of the set, each once.
#[derive(Default)]
struct EventNames<'f> {
    order: Vec<&'f str>,
    indices: HashMap<&'f str, usize>,
}

impl<'f> EventNames<'f> {
    fn index(&mut self, name: &'f str) -> usize {
        *self.indices.entry(name).or_insert_with(|| {
            self.order.push(name);
            self.order.len() - 1
        })
    }
}

/// Fills the name space of containers and the list of containers and machines.
fn declare_containers<'f>(
    set: &Trees<'f>,
    model: &mut Model,
    names: &mut Names<'f, '_>,
    machine_span: &mut Option<Span>,
) -> (Scope<'f>, Vec<&'f tree::Container>) {
    let mut scope = Scope::default();
    if set.is_incomplete() {
        scope.is_incomplete();
    }
    let mut trees = Vec::new();
    for tree in set.containers() {
        let index = trees.len();
        trees.push(tree);
        if let (true, Some(name)) = (tree.is_machine, tree.name) {
            names.refer(name.0, name.0);
        }
        if !tree.is_machine {
            names.declare(&mut scope, tree.name, index, "container");
        } else if let Some(first) = *machine_span {
            names.report(
                Diagnostic::new(Code::E013, tree.span, "a second machine")
                    .hint("a set of files has one machine: make this one a `container`, or do not `use` its file")
                    .related(first, "the first machine"),
            );
        } else {
            *machine_span = Some(tree.span);
            model.machine = Some(index);
        }
        let name_span = tree.name.map_or(tree.span, |name| name.0);
        model.containers.push(Container {
            name: names.text(name_span).to_owned(),
            is_machine: tree.is_machine,
            events: Vec::new(),
            flags: Vec::new(),
            data: Vec::new(),
            regions: Vec::new(),
            paths: Vec::new(),
            docs: names.docs(tree.docs),
            span: name_span,
        });
    }
    for file in set.trees {
        scope.may_hide(names, &file.skipped, file.is_cut);
    }
    (scope, trees)
}

fn declare_queue(set: &Trees<'_>, model: &mut Model, names: &mut Names<'_, '_>) {
    let mut first: Option<Span> = None;
    for queue in set.trees.iter().flat_map(|file| &file.queues) {
        if let Some(first) = first {
            let diagnostic = Diagnostic::new(Code::E003, queue.span, "a second `queue`")
                .hint("remove one of the two: there is one queue")
                .related(first, "the first one")
                .fix(remove("remove the second `queue`", queue.span, names));
            names.report(diagnostic);
            continue;
        }
        first = Some(queue.span);
        if let Some(capacity) = queue.capacity {
            model.queue = capacity;
        }
    }
}

/// Declares events, flags and data ports of a container.
fn declare_parts<'f>(
    tree: &'f tree::Container,
    container: &mut Container,
    events: &mut EventNames<'f>,
    names: &mut Names<'f, '_>,
) -> ContainerFacts<'f> {
    let mut facts = ContainerFacts {
        events: Scope::default(),
        flags: Scope::default(),
        flag_directions: Vec::new(),
        data: Scope::default(),
        states: Vec::new(),
    };
    declare_events(tree, container, &mut facts.events, events, names);
    (container.flags, facts.flag_directions) = declare_flags(&tree.flags, &mut facts.flags, names);
    container.data = declare_data(&tree.data, &mut facts.data, names);
    for scope in [&mut facts.events, &mut facts.flags, &mut facts.data] {
        scope.may_hide(names, &tree.skipped, tree.is_cut);
    }
    facts
}

fn declare_events<'f>(
    tree: &'f tree::Container,
    container: &mut Container,
    scope: &mut Scope<'f>,
    events: &mut EventNames<'f>,
    names: &mut Names<'f, '_>,
) {
    for event in &tree.events {
        let Some(name) = event.name else {
            scope.is_incomplete();
            continue;
        };
        let text = names.text(name.0);
        let listed_in = event.listing == EventListing::In;
        let listed_out = event.listing == EventListing::Out;
        let Err(first) = scope.declare(text, name.0, container.events.len()) else {
            names.refer(name.0, name.0);
            container.events.push(ContainerEvent {
                event: events.index(text),
                forwarded_in: listed_in,
                forwarded_out: listed_out,
                span: name.0,
            });
            continue;
        };
        // The same event may be forwarded both ways; then it has both listings once.
        let known = match scope.find(text) {
            scope::Found::Index(index) => container.events.get_mut(index),
            _ => None,
        };
        names.refer(name.0, first);
        match known {
            Some(known) if listed_in && known.forwarded_out && !known.forwarded_in => {
                known.forwarded_in = true;
            }
            Some(known) if listed_out && known.forwarded_in && !known.forwarded_out => {
                known.forwarded_out = true;
            }
            _ => names.defined_twice("event", text, name.0, first),
        }
    }
}

/// A region as it is resolved.
struct ResolvedRegion {
    region: Region,
    /// One for each of its states.
    facts: Vec<StateFacts>,
    holes: RegionHoles,
}

/// The data paths of a container as they are resolved.
struct ResolvedPaths {
    paths: Vec<Path>,
    /// Whether every end of every path is among them, and fits the others.
    are_whole: bool,
}
