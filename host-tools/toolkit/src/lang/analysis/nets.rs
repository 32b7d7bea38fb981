//! The nets of a set of files, and which two writers of one net can be active together (W110).
//!
//! Nets are joined through the ports of containers, so which they are depends on the instances. The
//! instances are laid out here, up to [`MAX_INSTANCES`] and [`MAX_ENDS`]; of a larger set, which no
//! blob could hold, nothing is said. In each instance, from the inside out, it is known of each
//! superstate on which nets something inside it writes: two writers then meet where they are in two
//! regions of one instance.
//!
//! A writer is an `out` port of a task state. An `inout` port publishes again what was on the net,
//! and disturbs nobody.

use std::collections::{BTreeMap, HashMap, HashSet};

use crate::lang::forest::Forest;
use crate::model::{Direction, Model, Path, PathEnd, SlotRef, StateKind};

use super::activity::{Activity, StateId, Uses};

/// The most container instances whose nets are laid out.
pub const MAX_INSTANCES: usize = 1 << 16;

/// The most ends of data paths in all instances together.
pub const MAX_ENDS: usize = 1 << 20;

/// An end of a path behind which something writes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Writer {
    /// Index into [`Container::paths`](crate::model::Container).
    pub(super) path: usize,
    /// The task state, or the superstate that it is inside.
    pub(super) state: StateId,
    /// Index into the data ports of the state's task or container.
    pub(super) port: usize,
}

/// Two writers of one net in two regions of one container.
#[derive(Clone, Copy, Debug)]
pub(super) struct Meeting {
    pub(super) first: Writer,
    pub(super) second: Writer,
}

/// A container instance.
pub(super) struct Instance {
    /// Index into [`Model::containers`].
    pub(super) container: usize,
    /// The instance around it, and which superstate of that one it is.
    pub(super) around: Option<(usize, StateId)>,
    /// The net node of its port 0; those of the others follow.
    first_port: usize,
    /// Instances in its superstates, by region and state.
    inside: HashMap<(usize, usize), usize>,
}

/// A data port of a task state in an instance.
#[derive(Clone, Copy, Debug)]
pub(super) struct Port {
    /// Index into [`Layout::instances`].
    pub(super) instance: usize,
    /// The task state.
    pub(super) state: StateId,
    /// Index into [`Model::tasks`].
    pub(super) task: usize,
    /// The slot of the task state.
    pub(super) slot: SlotRef,
    /// Index into the data ports of the task.
    pub(super) port: usize,
}

/// For each path on which a second writer of a net stands, the first such meeting; in the order of
/// containers and paths.
pub(super) fn meetings(model: &Model, activity: &Activity, uses: &Uses) -> Vec<Meeting> {
    lay_out(model, activity, uses).map_or_else(Vec::new, |layout| layout.meetings())
}

/// The instances of a set of files and their nets.
pub(super) struct Layout<'m> {
    model: &'m Model,
    activity: &'m Activity,
    /// Each behind the one that it is inside.
    pub(super) instances: Vec<Instance>,
    nets: Forest,
    /// Per instance, the net nodes of the ports of its task states that are on a path.
    task_ports: Vec<HashMap<PathEnd, usize>>,
}

/// Lays out the instances that can be active. `None` where there are no paths, where a container
/// uses itself, and beyond the limits.
pub(super) fn lay_out<'m>(
    model: &'m Model,
    activity: &'m Activity,
    uses: &Uses,
) -> Option<Layout<'m>> {
    let has_paths = model.containers.iter().any(|it| !it.paths.is_empty());
    if !has_paths || activity.children_first().is_none() {
        return None;
    }
    let mut layout = Layout {
        model,
        activity,
        instances: Vec::new(),
        nets: Forest::default(),
        task_ports: Vec::new(),
    };
    match model.machine {
        Some(machine) => layout.add(machine, None)?,
        None => {
            // Whatever nothing else puts into the whole is a whole itself.
            let mut is_used = vec![false; model.containers.len()];
            for container in 0..model.containers.len() {
                for (state, used) in uses.of_container(container) {
                    if let (true, Some(is_used)) =
                        (activity.is_active(*state), is_used.get_mut(*used))
                    {
                        *is_used = true;
                    }
                }
            }
            for (container, is_used) in is_used.into_iter().enumerate() {
                if !is_used {
                    layout.add(container, None)?;
                }
            }
        }
    }
    let mut ends = 0;
    let mut next = 0;
    while let Some(instance) = layout.instances.get(next) {
        let container = instance.container;
        for (state, used) in uses.of_container(container) {
            if activity.is_active(*state) {
                let inside = layout.instances.len();
                layout.add(*used, Some((next, *state)))?;
                if let Some(instance) = layout.instances.get_mut(next) {
                    instance.inside.insert((state.region, state.state), inside);
                }
            }
        }
        for path in model
            .containers
            .get(container)
            .map_or(&[][..], |it| &it.paths)
        {
            ends += path.from.len() + path.to.len();
            if ends > MAX_ENDS {
                return None;
            }
            layout.join(next, path);
        }
        next += 1;
    }
    Some(layout)
}

fn ends(path: &Path) -> impl Iterator<Item = &PathEnd> {
    path.from.iter().chain(&path.to)
}

impl Layout<'_> {
    /// Adds an instance of a container, of which nothing is known yet but its ports.
    fn add(&mut self, container: usize, around: Option<(usize, StateId)>) -> Option<()> {
        if self.instances.len() == MAX_INSTANCES {
            return None;
        }
        let first_port = self.nets.len();
        let ports = self.model.containers.get(container)?.data.len();
        if first_port + ports > MAX_ENDS {
            return None;
        }
        for _ in 0..ports {
            self.nets.add();
        }
        self.instances.push(Instance {
            container,
            around,
            first_port,
            inside: HashMap::new(),
        });
        self.task_ports.push(HashMap::new());
        Some(())
    }

    /// The net node of an end of a path in an instance; `None` for one of a superstate that is
    /// never active.
    fn node(&mut self, instance: usize, end: PathEnd) -> Option<usize> {
        let here = self.instances.get(instance)?;
        let (region, state, port) = match end {
            PathEnd::Container { port } => return Some(here.first_port + port),
            PathEnd::State {
                region,
                state,
                port,
            } => (region, state, port),
        };
        let container = self.model.containers.get(here.container)?;
        match container.regions.get(region)?.states.get(state)?.kind {
            StateKind::Super { .. } => {
                let inside = *here.inside.get(&(region, state))?;
                Some(self.instances.get(inside)?.first_port + port)
            }
            _ => {
                let nets = &mut self.nets;
                let ports = self.task_ports.get_mut(instance)?;
                Some(*ports.entry(end).or_insert_with(|| nets.add()))
            }
        }
    }

    fn join(&mut self, instance: usize, path: &Path) {
        let mut first = None;
        for end in ends(path) {
            if let Some(node) = self.node(instance, *end) {
                self.nets.join(*first.get_or_insert(node), node);
            }
        }
    }

    /// The ports of task states that are on a net, by net; of a net in the order of the instances.
    pub(super) fn ports(&mut self) -> BTreeMap<usize, Vec<Port>> {
        let mut nets: BTreeMap<usize, Vec<Port>> = BTreeMap::new();
        for (instance, (here, ports)) in self.instances.iter().zip(&self.task_ports).enumerate() {
            let Some(container) = self.model.containers.get(here.container) else {
                continue;
            };
            for (&end, &node) in ports {
                if let PathEnd::State {
                    region,
                    state,
                    port,
                } = end
                    && let Some(declared) = container.regions.get(region)
                    && let Some(declared) = declared.states.get(state)
                    && let StateKind::Task { task, slot, .. } = declared.kind
                {
                    nets.entry(self.nets.root(node)).or_default().push(Port {
                        instance,
                        state: StateId {
                            container: here.container,
                            region,
                            state,
                        },
                        task,
                        slot,
                        port,
                    });
                }
            }
        }
        for ports in nets.values_mut() {
            ports.sort_unstable_by_key(|port| (port.instance, port.state, port.port));
        }
        nets
    }

    /// The nets that a container's ports lead out of the set: what is on them outside nobody knows.
    pub(super) fn open_nets(&mut self) -> HashSet<usize> {
        let mut open = HashSet::new();
        for instance in self.instances.iter().filter(|it| it.around.is_none()) {
            let container = self.model.containers.get(instance.container);
            let ports = container.map_or(0, |container| container.data.len());
            for node in instance.first_port..instance.first_port + ports {
                open.insert(self.nets.root(node));
            }
        }
        open
    }

    fn meetings(mut self) -> Vec<Meeting> {
        let model = self.model;
        // Per instance, the nets of its ports on which something inside it writes.
        let mut written: Vec<HashSet<usize>> = vec![HashSet::new(); self.instances.len()];
        let mut found: HashMap<(usize, usize), Meeting> = HashMap::new();
        for index in (0..self.instances.len()).rev() {
            let Some(instance) = self.instances.get(index) else {
                continue;
            };
            let (id, first_port) = (instance.container, instance.first_port);
            let Some(container) = model.containers.get(id) else {
                continue;
            };
            // Per net, the first writer, and the first one in another region.
            let mut writers: HashMap<usize, (Writer, Option<Writer>)> = HashMap::new();
            for (path_index, path) in container.paths.iter().enumerate() {
                for &end in ends(path) {
                    let Some((net, writer)) = self.writer(index, path_index, end, &written) else {
                        continue;
                    };
                    let Some((first, second)) = writers.get_mut(&net) else {
                        writers.insert(net, (writer, None));
                        continue;
                    };
                    let region = writer.state.region;
                    let other = if first.state.region != region {
                        second.get_or_insert(writer);
                        Some(*first)
                    } else {
                        *second
                    };
                    if let Some(other) = other {
                        found.entry((id, path_index)).or_insert(Meeting {
                            first: other,
                            second: writer,
                        });
                    }
                }
            }
            let ports = (first_port..first_port + container.data.len())
                .map(|node| self.nets.root(node))
                .filter(|net| writers.contains_key(net))
                .collect();
            if let Some(written) = written.get_mut(index) {
                *written = ports;
            }
        }
        let mut found: Vec<((usize, usize), Meeting)> = found.into_iter().collect();
        found.sort_unstable_by_key(|(place, _)| *place);
        found.into_iter().map(|(_, meeting)| meeting).collect()
    }

    /// The net of an end and what writes on it there, if something does.
    fn writer(
        &mut self,
        instance: usize,
        path: usize,
        end: PathEnd,
        written: &[HashSet<usize>],
    ) -> Option<(usize, Writer)> {
        let PathEnd::State {
            region,
            state,
            port,
        } = end
        else {
            return None;
        };
        let node = self.node(instance, end)?;
        let net = self.nets.root(node);
        let here = self.instances.get(instance)?;
        let id = StateId {
            container: here.container,
            region,
            state,
        };
        let container = self.model.containers.get(here.container)?;
        let writes = match container.regions.get(region)?.states.get(state)?.kind {
            StateKind::Simple => false,
            StateKind::Task { task, .. } => {
                let port = self.model.tasks.get(task)?.data.get(port)?;
                port.direction == Direction::Out && self.activity.is_active(id)
            }
            StateKind::Super { .. } => {
                let inside = *here.inside.get(&(region, state))?;
                written.get(inside)?.contains(&net)
            }
        };
        writes.then_some((
            net,
            Writer {
                path,
                state: id,
                port,
            },
        ))
    }
}
