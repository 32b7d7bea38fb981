//! A blob back to tables that people and programs can read, by the code that the firmware uses.
//!
//! [`Report::of`] takes a verified blob apart; its [`Display`](std::fmt::Display) is for people,
//! its serde form for programs. Names come from the blob's name table; where that was left out,
//! they are made up.

pub mod changes;
mod flags;
mod guard;
pub mod guards;
mod links;
mod names;
mod reader;
pub mod refusal;
mod source;
#[cfg(test)]
mod tests;
mod text;

use esm_core::Verified;
use esm_core::signature::{Port, Signature};
use esm_core::tables::{State, StateKind};
use serde::Serialize;

use guard::Written;
use names::Names;
use reader::{Reader, readable};

use crate::superstates::superstates;

pub(crate) use links::rows as link_rows;
pub use links::{FrameRow, LinkRow};
pub use source::{NoSource, source};

/// Bytes of a transition, and of a record of its guard or actions.
const TRANSITION_BYTES: usize = 8;
const CODE_BYTES: usize = 4;

/// How much of everything a mission has.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Length of the blob.
    pub bytes: usize,
    /// States of all containers, each stored once; `initial` and `final` are not counted.
    pub states: usize,
    /// Transitions of all containers, each stored once.
    pub transitions: usize,
    /// Containers in use, the machine included.
    pub containers: usize,
    /// Container instances: the machine, and one for each superstate in the instance tree.
    pub instances: usize,
    /// Event names.
    pub events: usize,
    /// Flag bits of all instances, system flags included.
    pub flags: usize,
    /// Bytes of RAM that the interpreter needs for it.
    pub ram_bytes: usize,
}

impl Counts {
    /// Counts what is in a blob.
    #[must_use]
    pub fn of(blob: &Verified<Vec<u8>>) -> Self {
        let tables = blob.tables();
        let pseudo_states = 2 * tables.regions().len();
        Self {
            bytes: blob.bytes().len(),
            states: tables.state_count() - pseudo_states,
            transitions: tables.transition_count(),
            containers: tables.containers().len(),
            instances: tables.instance_count(),
            events: tables.event_count(),
            flags: tables.flag_count(),
            ram_bytes: blob.ram_bytes(),
        }
    }
}

/// What is in a blob.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The mission hash, eight hexadecimal digits.
    pub hash: String,
    /// Sizes and numbers.
    #[serde(flatten)]
    pub counts: Counts,
    /// Whether names come from the blob; otherwise they are made up.
    pub has_names: bool,
    /// Name of the machine.
    pub machine: String,
    /// Capacity of the event queue.
    pub queue: usize,
    /// Number of the slot that runs the interpreter.
    pub interpreter_slot: u32,
    /// Bytes of transitions, guards and actions for each transition, on average.
    pub bytes_per_transition: f64,
    /// The slots in the order of their declaration.
    pub slots: Vec<SlotRow>,
    /// The tasks in use.
    pub tasks: Vec<TaskRow>,
    /// The containers in use, the machine first.
    pub container_tables: Vec<ContainerTable>,
    /// The task states of all instances, in the order in which they run.
    pub task_states: Vec<TaskStateRow>,
    /// The nets.
    pub nets: Vec<NetRow>,
    /// The links.
    pub links: Vec<LinkRow>,
}

/// A slot.
#[derive(Clone, Debug, Serialize)]
pub struct SlotRow {
    /// Its number.
    pub slot: u32,
    /// First start in microseconds.
    pub start_us: u32,
    /// Period in microseconds.
    pub period_us: u32,
    /// Duration in microseconds.
    pub duration_us: u32,
}

/// A task.
#[derive(Clone, Debug, Serialize)]
pub struct TaskRow {
    /// Its name.
    pub name: String,
    /// Its signature.
    pub signature: String,
    /// Hash of the signature, sixteen hexadecimal digits.
    pub hash: String,
    /// Its exclusive group.
    pub exclusive: Option<String>,
}

/// A container.
#[derive(Clone, Debug, Serialize)]
pub struct ContainerTable {
    /// Its name.
    pub name: String,
    /// How many instances it has.
    pub instances: usize,
    /// Its control flags.
    pub flags: Vec<String>,
    /// Its regions.
    pub regions: Vec<RegionTable>,
}

/// A region.
#[derive(Clone, Debug, Serialize)]
pub struct RegionTable {
    /// Its name.
    pub name: String,
    /// Its states, pseudo-states left out.
    pub states: Vec<StateRow>,
    /// Its transitions, state by state.
    pub transitions: Vec<TransitionRow>,
}

/// A state.
#[derive(Clone, Debug, Serialize)]
pub struct StateRow {
    /// Its name.
    pub name: String,
    /// `state`, `task` or `super`.
    pub kind: &'static str,
    /// The task or container.
    pub of: Option<String>,
    /// Slot number of a task state, 0 for the time that is left.
    pub slot: Option<u32>,
    /// Timeout in microseconds.
    pub timeout_us: Option<u32>,
    /// Parameter values with their names.
    pub params: Vec<(String, String)>,
}

/// A transition.
#[derive(Clone, Debug, Serialize)]
pub struct TransitionRow {
    /// Its source.
    pub from: String,
    /// Its target.
    pub to: String,
    /// The event.
    pub event: String,
    /// The guard.
    pub guard: Option<String>,
    /// The actions.
    pub actions: Vec<String>,
}

/// A task state of an instance.
#[derive(Clone, Debug, Serialize)]
pub struct TaskStateRow {
    /// Its path.
    pub path: String,
    /// Its task.
    pub task: String,
    /// Slot number, 0 for the time that is left.
    pub slot: u32,
    /// The net of each data port: the port's name and the net's number.
    pub nets: Vec<(String, Option<usize>)>,
}

/// A net.
#[derive(Clone, Debug, Serialize)]
pub struct NetRow {
    /// Name of the type.
    pub type_name: String,
    /// Paths of the ports that write it.
    pub writers: Vec<String>,
    /// Paths of the ports that read it.
    pub readers: Vec<String>,
}

impl Report {
    /// Takes a blob apart.
    #[must_use]
    pub fn of(blob: &Verified<Vec<u8>>) -> Self {
        Reader {
            tables: blob.tables(),
            names: Names::of(blob),
        }
        .report(blob)
    }
}

impl Reader<'_> {
    fn report(&self, blob: &Verified<Vec<u8>>) -> Report {
        let tables = &self.tables;
        let counts = Counts::of(blob);
        let code_bytes =
            TRANSITION_BYTES * tables.transition_count() + CODE_BYTES * tables.code_count();
        let task_states = self.task_states();
        Report {
            hash: format!("{:08x}", blob.hash()),
            has_names: self.names.are_original,
            machine: Names::get(&self.names.containers, 0).to_owned(),
            queue: tables.queue_capacity(),
            interpreter_slot: self.slot_number(Some(tables.interpreter_slot())),
            bytes_per_transition: code_bytes as f64 / counts.transitions.max(1) as f64,
            slots: tables
                .slots()
                .map(|slot| SlotRow {
                    slot: slot.number,
                    start_us: slot.start_us,
                    period_us: slot.period_us,
                    duration_us: slot.duration_us,
                })
                .collect(),
            tasks: tables
                .tasks()
                .map(|task| TaskRow {
                    name: readable(task.signature.name()),
                    signature: readable(task.signature.text()),
                    hash: format!("{:016x}", task.signature_hash),
                    exclusive: task
                        .exclusive
                        .map(|group| Names::get(&self.names.groups, usize::from(group)).to_owned()),
                })
                .collect(),
            container_tables: self.containers(),
            nets: self.nets(&task_states),
            links: links::rows(tables),
            task_states,
            counts,
        }
    }

    fn containers(&self) -> Vec<ContainerTable> {
        let tables = &self.tables;
        let mut instances = vec![0; tables.containers().len()];
        for instance in (0..tables.instance_count()).filter_map(|index| tables.instance(index)) {
            if let Some(count) = instances.get_mut(instance.container) {
                *count += 1;
            }
        }
        tables
            .containers()
            .enumerate()
            .zip(instances)
            .map(|((index, container), instances)| ContainerTable {
                name: Names::get(&self.names.containers, index).to_owned(),
                instances,
                flags: self.names.flags.get(index).cloned().unwrap_or_default(),
                regions: self
                    .regions_of(index, &container)
                    .map(|(number, region)| self.region(number, region.first_state))
                    .collect(),
            })
            .collect()
    }

    fn region(&self, number: usize, first_state: usize) -> RegionTable {
        let tables = &self.tables;
        let mut table = RegionTable {
            name: Names::get(&self.names.regions, number).to_owned(),
            states: Vec::new(),
            transitions: Vec::new(),
        };
        for index in first_state..tables.state_count() {
            let Some(state) = tables.state(index) else {
                break;
            };
            if state.kind == StateKind::Final {
                break;
            }
            if state.kind != StateKind::Initial {
                table.states.push(self.state(index, &state));
            }
            for transition in tables.transitions_of(index) {
                table
                    .transitions
                    .extend(self.transition(index, &state, transition));
            }
        }
        table
    }

    fn state(&self, index: usize, state: &State) -> StateRow {
        let mut row = StateRow {
            name: Names::get(&self.names.states, index).to_owned(),
            kind: "state",
            of: None,
            slot: None,
            timeout_us: state.timeout_us,
            params: Vec::new(),
        };
        match state.kind {
            StateKind::Task { .. } => {
                row.kind = "task";
                if let Some(task_state) = self.task_state(index)
                    && let Some(task) = self.tables.task(task_state.task)
                {
                    row.of = Some(readable(task.signature.name()));
                    row.slot = Some(self.slot_number(task_state.slot));
                    row.params = self.params(task.signature, task_state.first_param);
                }
            }
            StateKind::Super { .. } => {
                row.kind = "super";
                row.of = self
                    .container_inside(index)
                    .map(|container| Names::get(&self.names.containers, container).to_owned());
            }
            _ => {}
        }
        row
    }

    fn transition(&self, from: usize, source: &State, index: usize) -> Option<TransitionRow> {
        let transition = self.tables.transition(index)?;
        let guard = match self.guard(from, source, index)? {
            Written::Nothing => None,
            Written::Expression(expression) => Some(expression.to_string()),
            Written::Tests(tests) => Some(guard::listing(&tests)),
        };
        let name = |state| Names::get(&self.names.states, state).to_owned();
        Some(TransitionRow {
            from: name(from),
            to: name(transition.target),
            event: Names::get(&self.names.events, usize::from(transition.event)).to_owned(),
            guard,
            actions: self.actions(from, index)?,
        })
    }

    fn task_states(&self) -> Vec<TaskStateRow> {
        let superstates = superstates(&self.tables);
        (0..self.tables.task_instance_count())
            .filter_map(|index| {
                let instance = self.tables.task_instance(index)?;
                let task_state = self.tables.task_state_of(index)?;
                let task = self.tables.task(task_state.task)?;
                let connections = instance.first_connection..;
                let nets = data_ports(task.signature).zip(connections);
                Some(TaskStateRow {
                    path: self.path(&superstates, instance.region, instance.state),
                    task: readable(task.signature.name()),
                    slot: self.slot_number(task_state.slot),
                    nets: nets
                        .map(|((name, ..), at)| (name, self.tables.connection(at).flatten()))
                        .collect(),
                })
            })
            .collect()
    }

    fn nets(&self, task_states: &[TaskStateRow]) -> Vec<NetRow> {
        use esm_core::signature::Direction;
        let empty = || NetRow {
            type_name: String::new(),
            writers: Vec::new(),
            readers: Vec::new(),
        };
        let mut nets: Vec<_> = (0..self.tables.net_count()).map(|_| empty()).collect();
        for (index, row) in task_states.iter().enumerate() {
            let task = self
                .tables
                .task_state_of(index)
                .and_then(|task_state| self.tables.task(task_state.task));
            let ports = task
                .into_iter()
                .flat_map(|task| data_ports(task.signature))
                .zip(&row.nets);
            for ((name, type_name, direction), (_, net)) in ports {
                let Some(net) = net.and_then(|net| nets.get_mut(net)) else {
                    continue;
                };
                let path = format!("{}.{name}", row.path);
                net.type_name = type_name;
                if direction != Direction::In {
                    net.writers.push(path.clone());
                }
                if direction != Direction::Out {
                    net.readers.push(path);
                }
            }
        }
        nets
    }
}

/// Name, type and direction of a signature's data ports.
fn data_ports(
    signature: Signature<'_>,
) -> impl Iterator<Item = (String, String, esm_core::signature::Direction)> {
    signature.ports().filter_map(|port| match port {
        Port::Data {
            direction,
            name,
            type_name,
            ..
        } => Some((readable(name), readable(type_name), direction)),
        _ => None,
    })
}
