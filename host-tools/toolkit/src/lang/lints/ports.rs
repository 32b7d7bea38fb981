//! W107: data ports on no path, and outputs that nobody reads.
//!
//! The nets of a container are worked out once for all its instances: what reads a net below is the
//! same in each of them, and each use of the container is an instance in which what is around may
//! read it, too.

use std::collections::{HashMap, HashSet};

use crate::lang::analysis::holes::Holes;
use crate::lang::diagnostic::Sink;
use crate::lang::forest::Forest;
use crate::model::{Container, DataPort, Direction, Model, PathEnd, StateKind};

use super::unused::{remove, unused};
use super::uses::Uses;

/// Reports ports that do nothing.
///
/// Gives, for each task, which of its ports are on a path and lead somewhere; nothing where paths
/// may be hidden.
pub(super) fn check(
    model: &Model,
    holes: &Holes,
    uses: &Uses,
    sink: &mut Sink,
) -> Option<Vec<Vec<bool>>> {
    // A state that is not known may need any port, and a path that is not known may lead to it.
    if !uses.are_whole {
        return None;
    }
    let nets = Nets::of(model, holes, uses);
    let mut tasks = Ports::of(model.tasks.iter().map(|task| task.data.len()));
    let mut containers = Ports::of(
        model
            .containers
            .iter()
            .map(|container| container.data.len()),
    );
    for (index, (container, holes)) in model.containers.iter().zip(&holes.containers).enumerate() {
        let Some(own) = nets.containers.get(index) else {
            continue;
        };
        for state in container.regions.iter().flat_map(|region| &region.states) {
            let (ports, owner) = match state.kind {
                StateKind::Simple => continue,
                StateKind::Task { task, .. } => (&mut tasks, task),
                StateKind::Super { container } => (&mut containers, container),
            };
            ports.has_state(owner, holes.paths);
        }
        if holes.paths {
            containers.has_state(index, true);
        }
        for (&end, &node) in &own.nodes {
            let is_read = own.is_read(node);
            match end {
                PathEnd::Container { port } => containers.on_path(index, port, is_read),
                PathEnd::State { port, .. } => match kind_of(container, end) {
                    Some(StateKind::Task { task, .. }) => tasks.on_path(*task, port, is_read),
                    Some(StateKind::Super { container }) => {
                        containers.on_path(*container, port, is_read);
                    }
                    Some(StateKind::Simple) | None => {}
                },
            }
        }
    }
    for (index, (task, holes)) in model.tasks.iter().zip(&holes.tasks).enumerate() {
        // A frame's port and flags are looked at together, as the frame's.
        if !holes.is_twin && task.dispatcher.is_none() {
            let owner = format!("task `{}`", task.name);
            tasks.report(index, &owner, &task.data, None, sink);
        }
    }
    for (index, container) in model.containers.iter().enumerate() {
        let owner = format!("container `{}`", container.name);
        containers.report(index, &owner, &container.data, Some(model), sink);
    }
    let used = model.tasks.iter().enumerate().map(|(index, task)| {
        let hides = tasks.may_hide.contains(&index);
        let ports = tasks.ports.get(index).into_iter().flatten();
        let is_used = |(port, &(is_on_path, is_read)): (&DataPort, &(bool, bool))| {
            hides || is_on_path && (is_read || port.direction != Direction::Out)
        };
        task.data.iter().zip(ports).map(is_used).collect()
    });
    Some(used.collect())
}

/// What the state at an end of a path is.
fn kind_of(container: &Container, end: PathEnd) -> Option<&StateKind> {
    let PathEnd::State { region, state, .. } = end else {
        return None;
    };
    let state = container.regions.get(region)?.states.get(state)?;
    Some(&state.kind)
}

// ─── Nets ────────────────────────────────────────────────────────────────────────────────────────

/// The nets of one container.
#[derive(Default)]
struct ContainerNets {
    nodes: HashMap<PathEnd, usize>,
    /// For each node, the one that stands for its net.
    roots: Vec<usize>,
    /// For each node that stands for a net, whether it is read in the container or below.
    read_below: Vec<bool>,
    /// The same for what is around, in some instance.
    read_above: Vec<bool>,
}

impl ContainerNets {
    fn root(&self, end: PathEnd) -> Option<usize> {
        self.roots.get(*self.nodes.get(&end)?).copied()
    }

    fn is_read(&self, node: usize) -> bool {
        let root = self.roots.get(node).copied().unwrap_or(node);
        self.read_below.get(root) == Some(&true) || self.read_above.get(root) == Some(&true)
    }
}

/// The nets of all containers.
struct Nets {
    containers: Vec<ContainerNets>,
}

impl Nets {
    fn of(model: &Model, holes: &Holes, uses: &Uses) -> Self {
        let mut nets = Nets {
            containers: model
                .containers
                .iter()
                .map(|_| ContainerNets::default())
                .collect(),
        };
        for &index in &uses.children_first {
            let (Some(container), Some(holes)) =
                (model.containers.get(index), holes.containers.get(index))
            else {
                continue;
            };
            let found = nets.below(model, container, holes.paths);
            if let Some(place) = nets.containers.get_mut(index) {
                *place = found;
            }
        }
        for &index in uses.children_first.iter().rev() {
            nets.look_above(model, uses, index);
        }
        nets
    }

    /// The nets of a container whose superstates' containers are done.
    fn below(&self, model: &Model, container: &Container, has_hidden_paths: bool) -> ContainerNets {
        let mut nodes: HashMap<PathEnd, usize> = HashMap::new();
        let mut ends = Vec::new();
        let mut forest = Forest::default();
        for path in &container.paths {
            let mut first = None;
            for &end in path.from.iter().chain(&path.to) {
                let node = *nodes.entry(end).or_insert_with(|| {
                    ends.push(end);
                    forest.add();
                    forest.len() - 1
                });
                forest.join(*first.get_or_insert(node), node);
            }
        }
        // Ports of a superstate that are joined inside it are joined outside, too.
        let mut inner: HashMap<(usize, usize, usize), usize> = HashMap::new();
        for (node, &end) in ends.iter().enumerate() {
            if let (Some(root), PathEnd::State { region, state, .. }) =
                (self.root_inside(container, end), end)
            {
                let first = *inner.entry((region, state, root)).or_insert(node);
                forest.join(first, node);
            }
        }
        let roots: Vec<usize> = (0..ends.len()).map(|node| forest.root(node)).collect();
        let mut read_below = vec![has_hidden_paths; ends.len()];
        for (&end, &root) in ends.iter().zip(&roots) {
            if let Some(read) = read_below.get_mut(root) {
                *read |= self.reads(model, container, end);
            }
        }
        ContainerNets {
            nodes,
            read_above: vec![false; roots.len()],
            roots,
            read_below,
        }
    }

    /// The net inside a superstate at an end, where one leads to its port.
    fn root_inside(&self, container: &Container, end: PathEnd) -> Option<usize> {
        let (PathEnd::State { port, .. }, Some(StateKind::Super { container })) =
            (end, kind_of(container, end))
        else {
            return None;
        };
        let inside = self.containers.get(*container)?;
        inside.root(PathEnd::Container { port })
    }

    /// Whether something reads at an end: an input of a task, or what is behind a superstate's
    /// port.
    fn reads(&self, model: &Model, container: &Container, end: PathEnd) -> bool {
        let PathEnd::State { port, .. } = end else {
            return false;
        };
        match kind_of(container, end) {
            Some(StateKind::Task { task, .. }) => {
                let task = model.tasks.get(*task);
                task.and_then(|task| task.data.get(port))
                    .is_some_and(|port| port.direction != Direction::Out)
            }
            Some(StateKind::Super { container: used }) => self
                .containers
                .get(*used)
                .zip(self.root_inside(container, end))
                .is_some_and(|(inside, root)| inside.read_below.get(root) == Some(&true)),
            Some(StateKind::Simple) | None => false,
        }
    }

    /// Tells the containers in a container which of their nets are read around them.
    fn look_above(&mut self, model: &Model, uses: &Uses, index: usize) {
        let (Some(container), Some(mut own)) = (
            model.containers.get(index),
            self.containers.get_mut(index).map(std::mem::take),
        ) else {
            return;
        };
        if uses.has_unknown_surroundings(model, index) {
            for (end, &node) in &own.nodes {
                let root = own.roots.get(node).copied().unwrap_or(node);
                if let (PathEnd::Container { .. }, Some(read)) = (end, own.read_above.get_mut(root))
                {
                    *read = true;
                }
            }
        }
        for (&end, &node) in &own.nodes {
            if let (Some(root), Some(StateKind::Super { container: used }), true) = (
                self.root_inside(container, end),
                kind_of(container, end),
                own.is_read(node),
            ) && let Some(read) = self
                .containers
                .get_mut(*used)
                .and_then(|inside| inside.read_above.get_mut(root))
            {
                *read = true;
            }
        }
        if let Some(place) = self.containers.get_mut(index) {
            *place = own;
        }
    }
}

// ─── Ports ───────────────────────────────────────────────────────────────────────────────────────

/// What is known of the ports of tasks, or of containers.
struct Ports {
    /// Owners that have a state, with which their ports can be on paths.
    has_state: HashSet<usize>,
    /// Owners of which paths may be hidden.
    may_hide: HashSet<usize>,
    /// Per owner, per port: whether it is on a path, and whether its net is read.
    ports: Vec<Vec<(bool, bool)>>,
}

impl Ports {
    fn of(counts: impl Iterator<Item = usize>) -> Self {
        Ports {
            has_state: HashSet::new(),
            may_hide: HashSet::new(),
            ports: counts.map(|count| vec![(false, false); count]).collect(),
        }
    }

    fn has_state(&mut self, owner: usize, may_hide_paths: bool) {
        self.has_state.insert(owner);
        if may_hide_paths {
            self.may_hide.insert(owner);
        }
    }

    fn on_path(&mut self, owner: usize, port: usize, read: bool) {
        if let Some((is_on_path, is_read)) = self
            .ports
            .get_mut(owner)
            .and_then(|ports| ports.get_mut(port))
        {
            *is_on_path = true;
            *is_read |= read;
        }
    }

    /// Reports what is not used of the ports of an owner. `removable` is the model where they can
    /// be removed: what a task has stands in its
    /// firmware.
    fn report(
        &self,
        index: usize,
        owner: &str,
        declared: &[DataPort],
        removable: Option<&Model>,
        sink: &mut Sink,
    ) {
        // What has no state is reported itself.
        if !self.has_state.contains(&index) || self.may_hide.contains(&index) {
            return;
        }
        let mut seen = HashSet::new();
        let ports = self.ports.get(index).into_iter().flatten();
        for (port, &(is_on_path, is_read)) in declared.iter().zip(ports) {
            let name = &port.name;
            // Of two ports of one name the first counts.
            if !seen.insert(name) {
                continue;
            }
            // An input that must be on a path is an error where it is not (E008).
            let must_be_on_path = port.direction == Direction::In && port.must_be_on_net();
            let diagnostic = if is_on_path {
                if is_read || port.direction != Direction::Out {
                    continue;
                }
                unused(port.span, format!("nobody reads output `{name}` of {owner}")).hint(
                    "lead a path from its net to an input of a task, or leave out the path and the port",
                )
            } else if must_be_on_path {
                continue;
            } else {
                let message = format!("data port `{name}` of {owner} is on no path");
                let hint =
                    format!("write `path` with it where {owner} is used, or remove the port");
                let diagnostic = unused(port.span, message).hint(hint);
                match removable {
                    Some(model) => diagnostic.fix(remove("remove the port", port.span, model)),
                    None => diagnostic,
                }
            };
            sink.push(diagnostic);
        }
    }
}
