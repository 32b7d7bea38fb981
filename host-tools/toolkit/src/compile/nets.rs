//! Which data ports share a net, over all container borders: a net is worked out anew in each
//! instance of a container, and joined with the net outside where a path leads to a container port.

use esm_core::format::NONE;
use esm_core::layout::{Connection, Net, Short, TaskInstance};
use esm_core::signature::fnv1a;

use super::instances::Tree;
use super::layout::Layout;
use super::templates::Templates;
use super::{Capacity, CompileError, MAX_RECORDS, Table, within};
use crate::model::{Model, PathEnd, Span, StateKind};

/// The tables of task instances and their connections.
#[derive(Default)]
pub(super) struct Nets {
    pub task_instances: Table,
    pub connections: Table,
    pub nets: Table,
}

/// Ports of the whole instance tree: those of each container instance, then those of each task
/// instance.
struct Ports {
    /// First port of each container instance.
    of_instances: Vec<usize>,
    /// First port of each task instance.
    of_tasks: Vec<usize>,
    /// Each port's way to the one that stands for its net.
    joined_with: Vec<usize>,
    /// Whether any path mentions the port.
    on_path: Vec<bool>,
}

/// Writes task instances, connections and nets. Nets are numbered in the order of the first task
/// port on them.
pub(super) fn write(
    model: &Model,
    layout: &Layout,
    tree: &Tree,
    templates: &Templates,
) -> Result<Nets, CompileError> {
    let mut ports = Ports::of(model, layout, tree);
    ports.join_all(model, layout, tree)?;
    let mut tables = Nets::default();
    let mut net_of = vec![None; ports.joined_with.len()];
    let mut nets = 0;
    let mut connections = 0;
    for (instance, first) in tree.tasks.iter().zip(ports.of_tasks.clone()) {
        tables.task_instances.push(TaskInstance {
            state: Short::new(instance.state),
            region: Short::new(instance.region),
            first_connection: Short::new(connections),
            first_flag: Short::new(instance.first_flag),
            task_state: Short::new(templates.task_state_numbers[&instance.state]),
        });
        for (offset, port) in model.tasks[instance.task].data.iter().enumerate() {
            let net = if ports.on_path[first + offset] {
                let representative = ports.find(first + offset);
                *net_of[representative].get_or_insert_with(|| {
                    let hash = fnv1a(port.type_name.as_bytes());
                    tables.nets.push(Net {
                        type_hash: hash.into(),
                    });
                    nets += 1;
                    nets - 1
                })
            } else {
                usize::from(NONE)
            };
            tables.connections.push(Connection {
                net: Short::new(net),
            });
            connections += 1;
        }
        within(Capacity::Ports, connections, MAX_RECORDS)?;
    }
    within(Capacity::Nets, nets, MAX_RECORDS)?;
    Ok(tables)
}

impl Ports {
    fn of(model: &Model, layout: &Layout, tree: &Tree) -> Self {
        let mut count = 0;
        let mut take = |ports: usize| {
            count += ports;
            count - ports
        };
        let of_instances = tree
            .instances
            .iter()
            .map(|instance| {
                let container = &layout.containers[instance.container];
                take(model.containers[container.model_index].data.len())
            })
            .collect();
        let of_tasks = tree
            .tasks
            .iter()
            .map(|instance| take(model.tasks[instance.task].data.len()))
            .collect();
        Self {
            of_instances,
            of_tasks,
            joined_with: (0..count).collect(),
            on_path: vec![false; count],
        }
    }

    /// Joins the ends of every path in every instance.
    fn join_all(
        &mut self,
        model: &Model,
        layout: &Layout,
        tree: &Tree,
    ) -> Result<(), CompileError> {
        for (index, instance) in tree.instances.iter().enumerate() {
            let container = &layout.containers[instance.container];
            for path in &model.containers[container.model_index].paths {
                let mut first = None;
                for end in path.from.iter().chain(&path.to) {
                    let port = self.port(model, layout, tree, index, *end, path.span)?;
                    self.on_path[port] = true;
                    self.join(*first.get_or_insert(port), port);
                }
            }
        }
        Ok(())
    }

    /// The port that a path written in the container of `index` means there.
    fn port(
        &self,
        model: &Model,
        layout: &Layout,
        tree: &Tree,
        index: usize,
        end: PathEnd,
        span: Span,
    ) -> Result<usize, CompileError> {
        let contradiction = CompileError::Contradiction(span);
        let instance = &tree.instances[index];
        let container = &layout.containers[instance.container];
        let declared = &model.containers[container.model_index];
        match end {
            PathEnd::Container { port } if port < declared.data.len() => {
                Ok(self.of_instances[index] + port)
            }
            PathEnd::Container { .. } => Err(contradiction),
            PathEnd::State {
                region,
                state,
                port,
            } => {
                let kind = declared
                    .regions
                    .get(region)
                    .and_then(|region| region.states.get(state))
                    .map(|state| &state.kind);
                match kind {
                    Some(StateKind::Task { task, .. }) if port < model.tasks[*task].data.len() => {
                        let begin = container.regions[region].states[state].begin;
                        Ok(self.of_tasks[instance.first_task + begin.tasks] + port)
                    }
                    Some(StateKind::Super { container: used })
                        if port < model.containers[*used].data.len() =>
                    {
                        let begin = container.regions[region].states[state].begin;
                        Ok(self.of_instances[index + begin.instances] + port)
                    }
                    _ => Err(contradiction),
                }
            }
        }
    }

    /// The port that stands for the net of a port.
    fn find(&mut self, port: usize) -> usize {
        let mut at = port;
        while self.joined_with[at] != at {
            // Halving the way each time keeps all ways short.
            self.joined_with[at] = self.joined_with[self.joined_with[at]];
            at = self.joined_with[at];
        }
        at
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.find(a), self.find(b));
        self.joined_with[a.max(b)] = a.min(b);
    }
}
