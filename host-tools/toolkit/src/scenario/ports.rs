//! The data ports of a machine's task states, by name, with the nets that they are on.

use esm_core::signature::{Direction, Port};
use esm_core::tables::Tables;

use crate::trace::directory::Directory;

/// A data port of a task state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DataPort {
    /// Index of the task instance.
    pub task: usize,
    /// Its name in the task's declaration.
    pub name: String,
    /// The net that it is on; none where no path of the mission leads to it.
    pub net: Option<usize>,
    /// Whether the task reads it.
    pub is_in: bool,
    /// Whether the task writes it.
    pub is_out: bool,
}

/// All data ports of a machine.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Ports(Vec<DataPort>);

impl Ports {
    /// Those of the machine whose tables and names these are.
    pub fn of(tables: &Tables<'_>, directory: &Directory) -> Self {
        let mut found = Vec::new();
        for task in 0..directory.task_states().len() {
            let (Some(declared), Some(place)) = (
                tables
                    .task_state_of(task)
                    .and_then(|task_state| tables.task(task_state.task)),
                tables.task_instance(task),
            ) else {
                continue;
            };
            let ports = declared.signature.ports().filter_map(|port| match port {
                Port::Data {
                    direction, name, ..
                } => Some((direction, name)),
                _ => None,
            });
            for (port, (direction, name)) in ports.enumerate() {
                let connection = tables.connection(place.first_connection + port);
                found.push(DataPort {
                    task,
                    name: String::from_utf8_lossy(name).into_owned(),
                    net: connection.flatten(),
                    is_in: direction != Direction::Out,
                    is_out: direction != Direction::In,
                });
            }
        }
        Ports(found)
    }

    /// The data ports of a task instance, in the order of its task's declaration.
    pub fn of_task(&self, task: usize) -> impl Iterator<Item = &DataPort> {
        self.0.iter().filter(move |port| port.task == task)
    }
}
