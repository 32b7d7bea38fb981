//! Data paths: ends, directions, types, writers, and inputs that are left open.

use std::collections::{HashMap, HashSet};

use crate::lang::cure::{Cure, end_of_item, insert_behind};
use crate::lang::diagnostic::{Code, Diagnostic, Edit, Fix};
use crate::lang::forest::Forest;
use crate::lang::tree::{self, Name};
use crate::model::{Container, DataPort, Direction, Model, Path, PathEnd, Span};

use super::regions::list_of;
use super::scope::{Found, Names, Scope};
use super::tasks::TaskTable;
use super::{ContainerFacts, Kind, ResolvedPaths};

/// Resolves all data paths and checks their nets. `order` has each container behind all that it
/// uses; without it nothing is known of what is inside the superstates, and no writer is missed.
pub(super) fn check<'f>(
    trees: &[&'f tree::Container],
    facts: &[ContainerFacts<'f>],
    tasks: &TaskTable<'f>,
    model: &Model,
    order: Option<&[usize]>,
    names: &mut Names<'f, '_>,
) -> Vec<ResolvedPaths> {
    let unordered: Vec<usize> = (0..trees.len()).collect();
    let mut supplied: Vec<Vec<bool>> = model
        .containers
        .iter()
        .map(|container| vec![order.is_none(); container.data.len()])
        .collect();
    let mut wired: Vec<Wired> = trees.iter().map(|_| Wired::default()).collect();
    for &index in order.unwrap_or(&unordered) {
        let (Some(&tree), Some(container_facts), Some(container)) = (
            trees.get(index),
            facts.get(index),
            model.containers.get(index),
        ) else {
            continue;
        };
        let wiring = Wiring {
            container,
            tree,
            facts: container_facts,
            all_facts: facts,
            tasks,
            model,
            supplied: &supplied,
            regions: region_names(tree, names),
            states: state_places(tree, names),
        };
        let found = wiring.check(tree, names);
        if let (Some(ports), true) = (supplied.get_mut(index), order.is_some()) {
            ports.clone_from(&found.supplied);
        }
        if let Some(slot) = wired.get_mut(index) {
            *slot = found;
        }
    }
    report_faults(&mut wired, facts, names);
    wired
        .into_iter()
        .map(|wired| ResolvedPaths {
            paths: wired.paths,
            are_whole: wired.is_whole,
        })
        .collect()
}

/// What a container's data paths came to.
#[derive(Default)]
struct Wired {
    paths: Vec<Path>,
    /// Whether every end of every path was found, and fits the others.
    is_whole: bool,
    nets: Nets,
    faults: Vec<Fault>,
    /// For each port of the container, whether something inside publishes on it.
    supplied: Vec<bool>,
}

/// Reports the first fault of each net. A port of a container joins the net outside with the net
/// inside.
fn report_faults(wired: &mut [Wired], facts: &[ContainerFacts<'_>], names: &mut Names<'_, '_>) {
    // Nodes of all containers in one forest, those of each behind those of the one before.
    let mut first_nodes = Vec::with_capacity(wired.len());
    let mut all = Forest::default();
    for wired in wired.iter_mut() {
        let first = all.len();
        first_nodes.push(first);
        for node in 0..wired.nets.forest.len() {
            all.add();
            let root = wired.nets.forest.root(node);
            all.join(first + root, first + node);
        }
    }
    for (outside, (facts, wired_outside)) in facts.iter().zip(wired.iter()).enumerate() {
        for (&end, &node_outside) in &wired_outside.nets.nodes {
            if let PathEnd::State {
                region,
                state,
                port,
            } = end
                && let Some(state) = facts
                    .states
                    .get(region)
                    .and_then(|states| states.get(state))
                && let Kind::Super(inside) = state.kind
                && let Some(wired_inside) = wired.get(inside)
                && let Some(&node_inside) =
                    wired_inside.nets.nodes.get(&PathEnd::Container { port })
                && let (Some(a), Some(b)) = (first_nodes.get(outside), first_nodes.get(inside))
            {
                all.join(a + node_outside, b + node_inside);
            }
        }
    }
    let mut faults: Vec<(usize, Diagnostic)> = Vec::new();
    for (wired, first) in wired.iter_mut().zip(first_nodes) {
        for fault in wired.faults.drain(..) {
            faults.push((all.root(first + fault.node), fault.diagnostic));
        }
    }
    faults.sort_by_key(|(_, diagnostic)| diagnostic.span);
    let mut is_reported = HashSet::new();
    for (root, diagnostic) in faults {
        if is_reported.insert(root) {
            names.report(diagnostic);
        }
    }
}

/// One container, and what its paths can refer to.
struct Wiring<'w, 'f> {
    container: &'w Container,
    /// The container as it is written.
    tree: &'f tree::Container,
    facts: &'w ContainerFacts<'f>,
    all_facts: &'w [ContainerFacts<'f>],
    tasks: &'w TaskTable<'f>,
    model: &'w Model,
    /// Per container, per port: whether something inside publishes on it.
    supplied: &'w [Vec<bool>],
    regions: Scope<'f>,
    states: StatePlaces<'f>,
}

/// As many fixes are proposed for one diagnostic.
const MAX_FIXES: usize = 4;

/// More states than this are not looked through for what could be meant.
const MAX_STATES: usize = 1_000;

/// The last path of a container, or its last region: more paths can be written behind it.
fn last_item(tree: &tree::Container, names: &Names<'_, '_>) -> Option<Span> {
    let path = tree.paths.last().map(|path| path.span);
    path.or_else(|| {
        let head = tree.regions.last()?.span;
        let end = end_of_item(names.file_text(head), head.start);
        Some(Span { end, ..head })
    })
}

/// Where the states of a container are, by name.
#[derive(Default)]
struct StatePlaces<'f> {
    /// Region and index, for each region that has a state of this name.
    places: HashMap<&'f str, Vec<(usize, usize)>>,
    in_order: Vec<&'f str>,
    /// Whether a state has a name that could not be read.
    is_incomplete: bool,
}

fn region_names<'f>(tree: &'f tree::Container, names: &Names<'f, '_>) -> Scope<'f> {
    let mut scope = Scope::default();
    for (index, region) in tree.regions.iter().enumerate() {
        match region.name {
            // A second region of a name is reported with the regions.
            Some(name) => drop(scope.declare(names.text(name.0), name.0, index)),
            None => scope.is_incomplete(),
        }
    }
    scope.may_hide(names, &tree.skipped, tree.is_cut);
    scope
}

fn state_places<'f>(tree: &'f tree::Container, names: &Names<'f, '_>) -> StatePlaces<'f> {
    let mut states = StatePlaces::default();
    if tree.paths.is_empty() {
        return states;
    }
    for (region_index, region) in tree.regions.iter().enumerate() {
        states.is_incomplete |= region.is_cut || !region.skipped.is_empty();
        for (index, state) in region.states.iter().enumerate() {
            let Some(name) = state.name else {
                states.is_incomplete = true;
                continue;
            };
            let text = names.text(name.0);
            let places = states.places.entry(text).or_insert_with(|| {
                states.in_order.push(text);
                Vec::new()
            });
            if places
                .last()
                .is_none_or(|&(region, _)| region != region_index)
            {
                places.push((region_index, index));
            }
        }
    }
    states.is_incomplete |= tree.is_cut || !tree.skipped.is_empty();
    states
}

/// Something wrong with a net.
struct Fault {
    /// A node of the net.
    node: usize,
    diagnostic: Diagnostic,
}

/// What could not be resolved: inputs that it may have been meant for are not open.
#[derive(Default)]
struct Unresolved<'f> {
    /// Anything may have been meant.
    anything: bool,
    /// Some port of this state, by region and index.
    states: HashSet<(usize, usize)>,
    /// A port of this name.
    ports: HashSet<&'f str>,
}

/// The nets of one container.
#[derive(Default)]
struct Nets {
    nodes: HashMap<PathEnd, usize>,
    /// The end of each node.
    ends: Vec<PathEnd>,
    forest: Forest,
    /// Type of the net that a node stands for, with the end that gave it.
    types: Vec<Option<(String, PathEnd)>>,
}

impl Nets {
    fn node(&mut self, end: PathEnd, type_name: &str) -> usize {
        if let Some(&node) = self.nodes.get(&end) {
            return node;
        }
        let node = self.forest.add();
        self.nodes.insert(end, node);
        self.ends.push(end);
        // A type that could not be read is the empty name.
        self.types
            .push((!type_name.is_empty()).then(|| (type_name.to_owned(), end)));
        node
    }

    fn root(&mut self, node: usize) -> usize {
        self.forest.root(node)
    }

    /// Joins two nets. Gives the ends and types that differ, if they do.
    fn join(&mut self, a: usize, b: usize) -> Option<[(String, PathEnd); 2]> {
        let (keep, drop) = self.forest.join(a, b)?;
        let dropped = self.types.get_mut(drop).and_then(Option::take);
        let kept = self.types.get_mut(keep)?;
        match (kept.as_ref(), dropped) {
            (Some(first), Some(second)) if first.0 != second.0 => Some([first.clone(), second]),
            (None, Some(second)) => {
                *kept = Some(second);
                None
            }
            _ => None,
        }
    }
}

impl<'f> Wiring<'_, 'f> {
    fn check(&self, tree: &'f tree::Container, names: &mut Names<'f, '_>) -> Wired {
        let mut nets = Nets::default();
        let mut faults: Vec<Fault> = Vec::new();
        let mut unresolved = Unresolved {
            anything: tree.is_cut,
            ..Unresolved::default()
        };
        // Nets with an end that is not known may have a writer there.
        let mut uncertain: Vec<usize> = Vec::new();
        let mut first_paths: Vec<usize> = Vec::new();
        let mut paths = Vec::with_capacity(tree.paths.len());
        let mut all_are_whole = true;
        for (path_index, path) in tree.paths.iter().enumerate() {
            unresolved.anything |= path.broken;
            let mut is_whole = !path.broken;
            let mut resolved = [Vec::new(), Vec::new()];
            let mut first_node: Option<usize> = None;
            for (side, ends) in [&path.from, &path.to].into_iter().enumerate() {
                for &end in ends {
                    let Some((end, port)) = self.end(end, &mut unresolved, names) else {
                        is_whole = false;
                        continue;
                    };
                    let node = nets.node(end, &port.type_name);
                    if first_paths.len() <= node {
                        first_paths.push(path_index);
                    }
                    // What stands on which side of an arrow that is broken says nothing.
                    if !path.broken && !fits_side(end, port.direction, side == 0) {
                        all_are_whole = false;
                        let diagnostic = self.wrong_direction(end, port, side == 0, path);
                        faults.push(Fault { node, diagnostic });
                    }
                    if let Some(differing) = first_node.and_then(|first| nets.join(first, node))
                        && !path.broken
                    {
                        all_are_whole = false;
                        let diagnostic = self.types_differ(&differing, path);
                        faults.push(Fault { node, diagnostic });
                    }
                    first_node.get_or_insert(node);
                    if let Some(ends) = resolved.get_mut(side) {
                        ends.push(end);
                    }
                }
            }
            all_are_whole &= is_whole;
            if let (false, Some(node)) = (is_whole, first_node) {
                uncertain.push(node);
            }
            let [from, to] = resolved;
            paths.push(Path {
                from,
                to,
                span: path.span,
            });
        }

        // Of nets that have a fault, or an end that is not known, nothing more is said.
        let mut is_settled = vec![false; nets.ends.len()];
        let faulty = faults.iter().map(|fault| fault.node);
        for node in faulty.chain(uncertain) {
            let root = nets.root(node);
            settle(&mut is_settled, root);
        }
        let has_writer = self.writers(&mut nets);
        for (node, &path_index) in first_paths.iter().enumerate() {
            let root = nets.root(node);
            if root == node
                && has_writer.get(root) == Some(&false)
                && settle(&mut is_settled, root)
                && let Some(path) = tree.paths.get(path_index)
            {
                let diagnostic =
                    Diagnostic::new(Code::E008, path.span, "nothing writes to this net").hint(
                        "begin a path of it at the output of a task that runs inside or outside",
                    );
                faults.push(Fault { node, diagnostic });
            }
        }
        self.check_open_inputs(&nets, &unresolved, names);

        let supplied = (0..self.container.data.len())
            .map(|port| match nets.nodes.get(&PathEnd::Container { port }) {
                Some(&node) => {
                    let root = nets.root(node);
                    is_settled.get(root) == Some(&true) || has_writer.get(root) == Some(&true)
                }
                None => unresolved.anything,
            })
            .collect();
        Wired {
            paths,
            is_whole: all_are_whole,
            nets,
            faults,
            supplied,
        }
    }

    // ─── Ends ────────────────────────────────────────────────────────────────────────────────────

    fn end(
        &self,
        end: tree::PathEnd,
        unresolved: &mut Unresolved<'f>,
        names: &mut Names<'f, '_>,
    ) -> Option<(PathEnd, &DataPort)> {
        match end {
            tree::PathEnd::Container(port) => self.container_port(port, unresolved, names),
            tree::PathEnd::State(state, port) => {
                let place = self.place_of_state(state, port, unresolved, names)?;
                self.state_port(place, state, port, unresolved, names)
            }
            tree::PathEnd::Region(region, state, port) => {
                let place = self.place_in_region(region, state, port, unresolved, names)?;
                self.state_port(place, state, port, unresolved, names)
            }
        }
    }

    fn container_port(
        &self,
        name: Name,
        unresolved: &mut Unresolved<'f>,
        names: &mut Names<'f, '_>,
    ) -> Option<(PathEnd, &DataPort)> {
        let container = self.container.name.as_str();
        let is_machine = self.container.is_machine;
        let is_state = self.states.places.contains_key(names.text(name.0));
        let port = names.resolve(&self.facts.data, name, "data port", |port| {
            if is_state {
                format!("`{port}` is a state: name its port, `{port}.port`")
            } else if is_machine {
                "a machine has no ports: name those of its states, `state.port`".to_owned()
            } else {
                format!(
                    "declare it in container `{container}`, or name that of a state, `state.{port}`"
                )
            }
        });
        let Some(port) = port else {
            // It may have been meant for any state.
            unresolved.anything = true;
            return None;
        };
        let model = self.container.data.get(port)?;
        Some((PathEnd::Container { port }, model))
    }

    /// The state that `state.port` means: the only one of its name in the container.
    fn place_of_state(
        &self,
        state: Name,
        port: Name,
        unresolved: &mut Unresolved<'f>,
        names: &mut Names<'f, '_>,
    ) -> Option<(usize, usize)> {
        let text = names.text(state.0);
        let places = self.states.places.get(text).map_or(&[][..], Vec::as_slice);
        if let [place] = places {
            self.refer_to_state(*place, state, names);
            return Some(*place);
        }
        unresolved.ports.insert(names.text(port.0));
        if !places.is_empty() {
            let port = names.text(port.0);
            let regions = places
                .iter()
                .filter_map(|&(region, _)| self.container.regions.get(region));
            let full: Vec<String> = regions
                .map(|region| format!("`{}.{text}.{port}`", region.name))
                .collect();
            let mut diagnostic = Diagnostic::new(
                Code::E002,
                state.0,
                format!("`{text}` is a state of several regions"),
            )
            .hint(format!("say which one is meant: {}", full.join(" or ")));
            for &(region, _) in places.iter().take(MAX_FIXES) {
                if let Some(region) = self.container.regions.get(region) {
                    let meant = format!("{}.{text}", region.name);
                    diagnostic = diagnostic.fix(Fix::write(state.0, meant));
                }
            }
            names.report(diagnostic);
        } else if !self.states.is_incomplete {
            let is_region = self.regions.find(text) != Found::Nothing;
            unresolved.anything |= is_region;
            let hint = match names.meant(text, &self.states.in_order) {
                _ if is_region => {
                    format!("it is a region: name a state of it, `{text}.state.port`")
                }
                Some(meant) => format!("did you mean `{meant}`?"),
                None => format!("no region of `{}` has such a state", self.container.name),
            };
            let mut cure = Cure::say(hint);
            if let (false, Some(meant)) = (is_region, names.meant(text, &self.states.in_order)) {
                cure = cure.fix(Fix::write(state.0, meant));
            }
            names.unknown(state, "state", cure);
        }
        None
    }

    fn refer_to_state(
        &self,
        (region, state): (usize, usize),
        name: Name,
        names: &mut Names<'f, '_>,
    ) {
        let regions = &self.container.regions;
        if let Some(state) = regions
            .get(region)
            .and_then(|region| region.states.get(state))
        {
            names.refer(name.0, state.span);
        }
    }

    fn place_in_region(
        &self,
        region: Name,
        state: Name,
        port: Name,
        unresolved: &mut Unresolved<'f>,
        names: &mut Names<'f, '_>,
    ) -> Option<(usize, usize)> {
        let container = self.container.name.as_str();
        let found = names.resolve(&self.regions, region, "region", |_| {
            format!("no region of `{container}` has this name")
        });
        let Some(region_index) = found else {
            unresolved.ports.insert(names.text(port.0));
            return None;
        };
        let text = names.text(state.0);
        let places = self.states.places.get(text).map_or(&[][..], Vec::as_slice);
        // The places are in the order of the regions.
        let place = places
            .binary_search_by_key(&region_index, |place| place.0)
            .ok()
            .and_then(|index| places.get(index));
        if let Some(&place) = place {
            self.refer_to_state(place, state, names);
        } else {
            unresolved.ports.insert(names.text(port.0));
            if !self.states.is_incomplete {
                let region_name = names.text(region.0);
                let hint = match places
                    .first()
                    .and_then(|place| self.container.regions.get(place.0))
                {
                    Some(other) => format!("it is a state of region `{}`", other.name),
                    None => names.meant(text, &self.states.in_order).map_or_else(
                        || format!("region `{region_name}` has no such state"),
                        |meant| format!("did you mean `{meant}`?"),
                    ),
                };
                names.unknown(state, "state", hint);
            }
        }
        place.copied()
    }

    fn state_port(
        &self,
        (region, state): (usize, usize),
        state_name: Name,
        port: Name,
        unresolved: &mut Unresolved<'f>,
        names: &mut Names<'f, '_>,
    ) -> Option<(PathEnd, &DataPort)> {
        let kind = self.kind(region, state);
        let state_text = names.text(state_name.0);
        let found = match kind {
            Kind::Unknown => None,
            Kind::Simple => {
                names.unknown(
                    port,
                    "data port",
                    format!("`{state_text}` is a simple state and has no ports"),
                );
                None
            }
            Kind::Task(_) | Kind::Super(_) => {
                let owner = self.owner_name(kind);
                names.resolve(self.scope_of(kind)?, port, "data port", |_| {
                    let ports = self.ports_of(kind).iter().map(|port| port.name.as_str());
                    format!("{owner} has {}", list_of("data port", ports))
                })
            }
        };
        let Some(index) = found else {
            unresolved.states.insert((region, state));
            return None;
        };
        let model = self.ports_of(kind).get(index)?;
        let end = PathEnd::State {
            region,
            state,
            port: index,
        };
        Some((end, model))
    }

    // ─── What is at the ends ─────────────────────────────────────────────────────────────────────

    fn kind(&self, region: usize, state: usize) -> Kind {
        self.facts
            .states
            .get(region)
            .and_then(|states| states.get(state))
            .map_or(Kind::Unknown, |state| state.kind)
    }

    fn ports_of(&self, kind: Kind) -> &[DataPort] {
        match kind {
            Kind::Task(task) => self.model.tasks.get(task).map_or(&[], |task| &task.data),
            Kind::Super(container) => self
                .model
                .containers
                .get(container)
                .map_or(&[], |container| &container.data),
            Kind::Simple | Kind::Unknown => &[],
        }
    }

    fn scope_of(&self, kind: Kind) -> Option<&Scope<'f>> {
        match kind {
            Kind::Task(task) => self.tasks.facts(task).map(|facts| &facts.data),
            Kind::Super(container) => self.all_facts.get(container).map(|facts| &facts.data),
            Kind::Simple | Kind::Unknown => None,
        }
    }

    fn owner_name(&self, kind: Kind) -> String {
        match kind {
            Kind::Task(task) => {
                let name = self.model.tasks.get(task).map_or("", |task| &task.name);
                format!("task `{name}`")
            }
            Kind::Super(container) => {
                let container = self.model.containers.get(container);
                format!(
                    "container `{}`",
                    container.map_or("", |container| &container.name)
                )
            }
            Kind::Simple | Kind::Unknown => "it".to_owned(),
        }
    }

    /// An end as it is written.
    fn written(&self, end: PathEnd) -> String {
        match end {
            PathEnd::Container { port } => self
                .container
                .data
                .get(port)
                .map_or_else(String::new, |port| port.name.clone()),
            PathEnd::State {
                region,
                state,
                port,
            } => {
                let name = self
                    .container
                    .regions
                    .get(region)
                    .and_then(|region| region.states.get(state))
                    .map_or("", |state| state.name.as_str());
                let ports = self.ports_of(self.kind(region, state));
                let port = ports.get(port).map_or("", |port| port.name.as_str());
                format!("{name}.{port}")
            }
        }
    }

    // ─── Rules ───────────────────────────────────────────────────────────────────────────────────

    fn wrong_direction(
        &self,
        end: PathEnd,
        port: &DataPort,
        is_before_arrow: bool,
        path: &tree::Path,
    ) -> Diagnostic {
        let written = self.written(end);
        let word = match port.direction {
            Direction::In => "in",
            Direction::Out => "out",
            Direction::InOut => "inout",
        };
        let (side, side_of_data) = if is_before_arrow {
            ("before", "comes from")
        } else {
            ("behind", "goes to")
        };
        let inside = match end {
            PathEnd::Container { .. } => " of the container around",
            PathEnd::State { .. } => "",
        };
        Diagnostic::new(
            Code::E008,
            path.span,
            format!("`{written}` is an `{word}` port{inside}: it cannot stand {side} the arrow"),
        )
        .hint(format!(
            "{side} the arrow stands what the data {side_of_data}: swap the ends or name another port"
        ))
        .related(port.span, "the port")
    }

    fn types_differ(&self, differing: &[(String, PathEnd); 2], path: &tree::Path) -> Diagnostic {
        let [(first_type, first), (second_type, second)] = differing;
        let mut diagnostic = Diagnostic::new(
            Code::E008,
            path.span,
            format!(
                "the types differ: `{}` is of type `{first_type}`, `{}` of type `{second_type}`",
                self.written(*first),
                self.written(*second)
            ),
        )
        .hint("all ports of a net have one type");
        for end in [*first, *second] {
            if let Some(port) = self.port(end) {
                diagnostic = diagnostic.related(port.span, format!("`{}`", self.written(end)));
            }
        }
        diagnostic
    }

    fn port(&self, end: PathEnd) -> Option<&DataPort> {
        match end {
            PathEnd::Container { port } => self.container.data.get(port),
            PathEnd::State {
                region,
                state,
                port,
            } => self.ports_of(self.kind(region, state)).get(port),
        }
    }

    /// Per node that stands for a net: whether something publishes on it.
    fn writers(&self, nets: &mut Nets) -> Vec<bool> {
        let mut has_writer = vec![false; nets.ends.len()];
        for (node, end) in nets.ends.clone().into_iter().enumerate() {
            let writes = match (end, self.port(end).map(|port| port.direction)) {
                (_, None) => true,
                // What comes from outside is checked where the container is used.
                (PathEnd::Container { .. }, Some(direction)) => direction != Direction::Out,
                (PathEnd::State { .. }, Some(Direction::In)) => false,
                (
                    PathEnd::State {
                        region,
                        state,
                        port,
                    },
                    Some(_),
                ) => match self.kind(region, state) {
                    Kind::Super(container) => self
                        .supplied
                        .get(container)
                        .and_then(|ports| ports.get(port))
                        .is_none_or(|&supplied| supplied),
                    _ => true,
                },
            };
            let root = nets.root(node);
            if let (true, Some(slot)) = (writes, has_writer.get_mut(root)) {
                *slot = true;
            }
        }
        has_writer
    }

    /// Every required input of a state must be on a net.
    fn check_open_inputs(
        &self,
        nets: &Nets,
        unresolved: &Unresolved<'f>,
        names: &mut Names<'f, '_>,
    ) {
        if unresolved.anything {
            return;
        }
        for (region_index, states) in self.facts.states.iter().enumerate() {
            for (state_index, state) in states.iter().enumerate() {
                if unresolved.states.contains(&(region_index, state_index)) {
                    continue;
                }
                let scope = self.scope_of(state.kind);
                let open: Vec<&str> = self
                    .ports_of(state.kind)
                    .iter()
                    .enumerate()
                    .filter(|(index, port)| {
                        let end = PathEnd::State {
                            region: region_index,
                            state: state_index,
                            port: *index,
                        };
                        port.direction == Direction::In
                            && port.must_be_on_net()
                            && !nets.nodes.contains_key(&end)
                            && !unresolved.ports.contains(&port.name.as_str())
                            && scope
                                .is_some_and(|scope| scope.find(&port.name) == Found::Index(*index))
                    })
                    .map(|(_, port)| port.name.as_str())
                    .collect();
                let Some(first) = open.first() else {
                    continue;
                };
                let name = self
                    .container
                    .regions
                    .get(region_index)
                    .and_then(|region| region.states.get(state_index))
                    .map_or("", |state| state.name.as_str());
                let what = match state.kind {
                    Kind::Super(_) => "superstate",
                    _ => "task state",
                };
                let list = list_of("port", open.iter().copied());
                let diagnostic = Diagnostic::new(
                    Code::E008,
                    state.span,
                    format!("{what} `{name}` needs data on {list}, and no path leads there"),
                )
                .hint(format!(
                    "write `path … -> {name}.{first};`, or declare the port `optional` and without `within`"
                ));
                let place = (region_index, state_index);
                names.report(self.with_paths(diagnostic, place, &open, names));
            }
        }
    }
}

impl<'f> Wiring<'_, 'f> {
    /// Adds what can supply the open ports of a state: the outputs of their types, where there are
    /// few; else that they are optional.
    fn with_paths(
        &self,
        mut diagnostic: Diagnostic,
        (region, state): (usize, usize),
        open: &[&str],
        names: &Names<'f, '_>,
    ) -> Diagnostic {
        let states = &self.facts.states;
        let Some(facts) = states.get(region).and_then(|states| states.get(state)) else {
            return diagnostic;
        };
        let ports = self.ports_of(facts.kind);
        let open: Vec<&DataPort> = ports
            .iter()
            .filter(|port| open.contains(&port.name.as_str()))
            .collect();
        let reader = self.name_of((region, state));
        if let [port] = open.as_slice()
            && self.states.in_order.len() <= MAX_STATES
            && let Some(last) = last_item(self.tree, names)
        {
            let writers = self.outputs_of(&port.type_name);
            if writers.len() <= MAX_FIXES {
                for writer in writers {
                    let path = format!("path {writer} -> {reader}.{};", port.name);
                    let insert = insert_behind(names.file_text(last), last, &path);
                    diagnostic = diagnostic.fix(Fix::one(format!("write `{path}`"), insert));
                }
            }
        }
        let ends: Vec<Span> = open.iter().map(|port| port.span).collect();
        let are_plain = ends.iter().all(|span| names.text(*span).ends_with(';'));
        // What a task needs says its firmware.
        if let (Kind::Super(_), true) = (facts.kind, are_plain) {
            let edits = ends.iter().map(|span| {
                let end = span.end - 1;
                Edit::behind(Span { end, ..*span }, " optional")
            });
            let title = "declare it `optional`";
            diagnostic = diagnostic.fix(Fix::new(title, edits.collect()));
        }
        diagnostic
    }

    /// A state as a path names it.
    fn name_of(&self, (region, state): (usize, usize)) -> String {
        let region = self.container.regions.get(region);
        let name = region
            .and_then(|region| region.states.get(state))
            .map_or("", |state| state.name.as_str());
        let is_alone = self.states.places.get(name).is_none_or(|it| it.len() < 2);
        match region {
            Some(region) if !is_alone => format!("{}.{name}", region.name),
            _ => name.to_owned(),
        }
    }

    /// The outputs of a type in the container, as paths name them.
    fn outputs_of(&self, type_name: &str) -> Vec<String> {
        let mut outputs = Vec::new();
        for (region, states) in self.facts.states.iter().enumerate() {
            for (state, facts) in states.iter().enumerate() {
                let ports = self.ports_of(facts.kind).iter();
                let fitting =
                    ports.filter(|it| it.direction == Direction::Out && it.type_name == type_name);
                for port in fitting.take(MAX_FIXES + 1) {
                    outputs.push(format!("{}.{}", self.name_of((region, state)), port.name));
                    if outputs.len() > MAX_FIXES {
                        return outputs;
                    }
                }
            }
        }
        outputs
    }
}

/// Whether a port can stand on a side of the arrow: data flow out of states, and out of the
/// container's own inputs.
fn fits_side(end: PathEnd, direction: Direction, is_before_arrow: bool) -> bool {
    let is_container = matches!(end, PathEnd::Container { .. });
    match direction {
        Direction::InOut => true,
        Direction::In => is_before_arrow == is_container,
        Direction::Out => is_before_arrow != is_container,
    }
}

/// Marks a net as dealt with; gives whether it was not yet.
fn settle(is_settled: &mut [bool], root: usize) -> bool {
    match is_settled.get_mut(root) {
        Some(settled) => !std::mem::replace(settled, true),
        None => false,
    }
}
