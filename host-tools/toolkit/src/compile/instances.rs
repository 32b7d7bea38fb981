//! The instance tree: every container instance with its regions, numbered depth first.

use esm_core::layout::{self as records, Short};

use super::layout::Layout;
use super::{Capacity, CompileError, MAX_RECORDS, Table, within};
use crate::model::{Model, StateKind};

/// A container instance.
#[derive(Clone, Debug, Default)]
pub(super) struct Instance {
    /// Number of its container.
    pub container: usize,
    /// Its region instances, in source order.
    pub regions: Vec<usize>,
    /// Its first flag bit.
    pub first_flag: usize,
    /// Its first channel.
    pub first_channel: usize,
    /// Its first task instance.
    pub first_task: usize,
    /// Region instance that it is inside of; 0 for the machine.
    pub around_region: usize,
    /// The instance around it; itself for the machine.
    pub around: usize,
    /// The instances inside its superstates: their region and state there, in source order, and
    /// their numbers.
    pub inside: Vec<((usize, usize), usize)>,
}

/// A region instance.
#[derive(Clone, Copy, Debug, Default)]
struct RegionInstance {
    next: usize,
    initial: usize,
    instance: usize,
}

/// A task instance.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TaskInstance {
    /// Its state in the tables.
    pub state: usize,
    /// Its region instance.
    pub region: usize,
    /// Its first flag bit in the whole machine.
    pub first_flag: usize,
    /// Its task's place in [`Model::tasks`].
    pub task: usize,
}

/// All instances.
pub(super) struct Tree {
    /// By number.
    pub instances: Vec<Instance>,
    /// By number.
    pub tasks: Vec<TaskInstance>,
    regions: Vec<RegionInstance>,
    /// First instance of each container in use.
    first_instances: Vec<usize>,
}

/// The tables of the tree.
#[derive(Default)]
pub(super) struct InstanceTables {
    pub instances: Table,
    pub region_instances: Table,
}

impl Tree {
    /// Unfolds the machine. Its size is known to be within the limits.
    pub(super) fn of(model: &Model, layout: &Layout) -> Result<Self, CompileError> {
        let spans = layout.root().spans;
        let mut tree = Self {
            instances: vec![Instance::default(); spans.instances],
            tasks: vec![TaskInstance::default(); spans.tasks],
            regions: vec![RegionInstance::default(); spans.regions],
            first_instances: vec![usize::MAX; layout.containers.len()],
        };
        // Every number follows from the template of the container around, so the order of the work
        // does not matter.
        let mut open = vec![(0, Instance::default(), 0, spans.regions)];
        while let Some((index, mut instance, first_region, after)) = open.pop() {
            let container = &layout.containers[instance.container];
            let declared = &model.containers[container.model_index];
            let first = &mut tree.first_instances[instance.container];
            *first = index.min(*first);
            let mut at = first_region;
            for (number, region) in container.regions.iter().enumerate() {
                let is_last = number + 1 == container.regions.len();
                let next = if is_last {
                    after
                } else {
                    at + region.region_span
                };
                tree.regions[at] = RegionInstance {
                    next,
                    initial: region.initial,
                    instance: index,
                };
                instance.regions.push(at);
                let states = region.states.iter().zip(&declared.regions[number].states);
                for (place, (state, declared)) in states.enumerate() {
                    match declared.kind {
                        StateKind::Simple => {}
                        StateKind::Task { task, .. } => {
                            let task_index = instance.first_task + state.begin.tasks;
                            tree.tasks[task_index] = TaskInstance {
                                state: state.index,
                                region: at,
                                first_flag: instance.first_flag + state.begin.flags,
                                task,
                            };
                        }
                        StateKind::Super { container } => {
                            let inside = index + state.begin.instances;
                            instance.inside.push(((number, place), inside));
                            let content = Instance {
                                container: layout.numbers[&container],
                                first_flag: instance.first_flag + state.begin.flags,
                                first_task: instance.first_task + state.begin.tasks,
                                around_region: at,
                                around: index,
                                ..Instance::default()
                            };
                            open.push((inside, content, at + state.begin.regions, next));
                        }
                    }
                }
                at += region.region_span;
            }
            tree.instances[index] = instance;
        }
        let mut channels = 0;
        for instance in &mut tree.instances {
            instance.first_channel = channels;
            channels += layout.containers[instance.container].sent.len();
        }
        within(Capacity::Channels, channels, MAX_RECORDS)?;
        Ok(tree)
    }

    /// The first instance of a container in use.
    pub(super) fn first_instance_of(&self, container: usize) -> usize {
        self.first_instances[container]
    }

    /// Writes the tables.
    pub(super) fn write(&self) -> InstanceTables {
        let mut tables = InstanceTables::default();
        for instance in &self.instances {
            tables.instances.push(records::Instance {
                container: Short::new(instance.container),
                first_region: Short::new(instance.regions.first().copied().unwrap_or(0)),
                first_flag: Short::new(instance.first_flag),
                first_channel: Short::new(instance.first_channel),
                first_task: Short::new(instance.first_task),
                around: Short::new(instance.around_region),
            });
        }
        for region in &self.regions {
            let first_flag = self.instances[region.instance].first_flag;
            tables.region_instances.push(records::RegionInstance {
                next: Short::new(region.next),
                first_flag: Short::new(first_flag),
                initial: Short::new(region.initial),
                instance: Short::new(region.instance),
            });
        }
        tables
    }
}
