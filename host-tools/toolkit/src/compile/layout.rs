//! Which containers the machine uses, and how an instance of each is laid out: where in its flags,
//! task instances, region instances and container instances each of its states begins.

use std::collections::hash_map::Entry;
use std::collections::{HashMap, HashSet};

use esm_core::format::{
    CONTAINER_CONTROL_FLAGS, MAX_EVENT, MAX_STATE_FLAGS, MAX_STATE_INSTANCES, TASK_CONTROL_FLAGS,
};

use super::{Capacity, CompileError, MAX_RECORDS, within};
use crate::model::{Action, Container, Guard, Model, Region, Source, State, StateKind, Transition};

/// What something takes of an instance's ranges, or how far into them it begins.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Spans {
    /// Flag bits.
    pub flags: usize,
    /// Task instances.
    pub tasks: usize,
    /// Region instances.
    pub regions: usize,
    /// Container instances.
    pub instances: usize,
    /// State instances, pseudo-states included.
    pub states: usize,
}

/// A state of a container in use.
pub(super) struct StateLayout {
    /// Its number in the table of states.
    pub index: usize,
    /// Where it begins: flags, tasks and instances relative to the instance, regions relative to
    /// the region instance.
    pub begin: Spans,
    /// Flags that entering it resets.
    pub flags: usize,
}

/// A region of a container in use.
pub(super) struct RegionLayout {
    /// The number of its `initial` in the table of states.
    pub initial: usize,
    /// The number of its `final`.
    pub last: usize,
    /// In source order, pseudo-states left out.
    pub states: Vec<StateLayout>,
    /// Region instances of the region and inside it.
    pub region_span: usize,
}

/// A container in use.
pub(super) struct ContainerLayout {
    /// Its place in [`Model::containers`].
    pub model_index: usize,
    /// In source order.
    pub regions: Vec<RegionLayout>,
    /// What one instance of it takes.
    pub spans: Spans,
    /// Events that its transitions send, as places in [`Model::events`]: each once, in the order of
    /// their first mention.
    pub sent: Vec<usize>,
}

/// All containers in use.
pub(super) struct Layout {
    /// In the order in which the instance tree first uses them, the machine first.
    pub containers: Vec<ContainerLayout>,
    /// Number of each container in use, by its place in [`Model::containers`].
    pub numbers: HashMap<usize, usize>,
    /// The events of the containers in use, as places in [`Model::events`]. The first has the
    /// number 1.
    pub events: Vec<usize>,
    /// Number of each event, by its place in [`Model::events`].
    pub event_numbers: HashMap<usize, usize>,
}

impl Layout {
    /// Lays out all that `machine` uses.
    pub(super) fn of(model: &Model, machine: usize) -> Result<Self, CompileError> {
        let (first_use, children_first) = orders(model, machine);
        within(Capacity::Containers, first_use.len(), MAX_RECORDS)?;
        let numbers: HashMap<_, _> = first_use.iter().copied().zip(0..).collect();
        let mut laid_out = HashMap::new();
        for index in children_first {
            let container = lay_out(model, index, &laid_out)
                .map_err(|error| error.at(model.containers[index].span))?;
            laid_out.insert(index, container);
        }
        let mut layout = Self {
            containers: first_use
                .iter()
                .filter_map(|index| laid_out.remove(index))
                .collect(),
            numbers,
            events: Vec::new(),
            event_numbers: HashMap::new(),
        };
        layout.number_states()?;
        layout.number_events(model)?;
        Ok(layout)
    }

    /// The machine.
    pub(super) fn root(&self) -> &ContainerLayout {
        &self.containers[0]
    }

    /// The containers in use with what the model says of them.
    pub(super) fn with_models<'a>(
        &'a self,
        model: &'a Model,
    ) -> impl Iterator<Item = (&'a ContainerLayout, &'a Container)> {
        self.containers
            .iter()
            .map(|container| (container, &model.containers[container.model_index]))
    }

    fn number_states(&mut self) -> Result<(), CompileError> {
        let mut regions = 0;
        let mut next = 0;
        for region in self.containers.iter_mut().flat_map(|c| &mut c.regions) {
            regions += 1;
            region.initial = next;
            next += 1;
            for state in &mut region.states {
                state.index = next;
                next += 1;
            }
            region.last = next;
            next += 1;
        }
        within(Capacity::Regions, regions, MAX_RECORDS)?;
        within(Capacity::States, next, MAX_RECORDS)
    }

    fn number_events(&mut self, model: &Model) -> Result<(), CompileError> {
        for container in &self.containers {
            for declared in &model.containers[container.model_index].events {
                let number = self.events.len() + 1;
                if let Entry::Vacant(place) = self.event_numbers.entry(declared.event) {
                    place.insert(number);
                    self.events.push(declared.event);
                }
            }
        }
        within(Capacity::Events, self.events.len(), usize::from(MAX_EVENT))
    }
}

/// The containers that `machine` uses, once in the order of their first use in the instance tree,
/// once with every container behind those that it uses. Works with a stack of its own, since
/// containers can be nested deeper than calls should be.
fn orders(model: &Model, machine: usize) -> (Vec<usize>, Vec<usize>) {
    let mut first_use = vec![machine];
    let mut children_first = Vec::new();
    let mut seen = HashSet::from([machine]);
    let mut open = vec![(machine, used_by(model, machine).into_iter())];
    while let Some((container, uses)) = open.last_mut() {
        match uses.next() {
            Some(used) if seen.insert(used) => {
                first_use.push(used);
                open.push((used, used_by(model, used).into_iter()));
            }
            Some(_) => {}
            None => {
                children_first.push(*container);
                open.pop();
            }
        }
    }
    (first_use, children_first)
}

/// The containers of a container's superstates, in source order.
fn used_by(model: &Model, container: usize) -> Vec<usize> {
    let states = model.containers[container]
        .regions
        .iter()
        .flat_map(|region| &region.states);
    states
        .filter_map(|state| match state.kind {
            StateKind::Super { container } => Some(container),
            _ => None,
        })
        .collect()
}

/// Lays out one container, whose superstates' containers are in `inside`.
fn lay_out(
    model: &Model,
    index: usize,
    inside: &HashMap<usize, ContainerLayout>,
) -> Result<ContainerLayout, CompileError> {
    let container = &model.containers[index];
    let mut at = Spans {
        flags: CONTAINER_CONTROL_FLAGS + container.flags.len(),
        instances: 1,
        ..Spans::default()
    };
    let mut region_instances = 0;
    let mut regions = Vec::new();
    for region in &container.regions {
        at.regions = 1;
        let mut states = Vec::new();
        let timeouts_read = timeouts_read(region);
        for (number, state) in region.states.iter().enumerate() {
            let begin = at;
            let flags = flags_of(model, state, timeouts_read.contains(&Source::State(number)));
            within(Capacity::StateFlags, flags, usize::from(MAX_STATE_FLAGS))
                .map_err(|error| error.at(state.span))?;
            match &state.kind {
                StateKind::Simple => at.flags += flags,
                StateKind::Task { .. } => {
                    at.flags += flags;
                    at.tasks += 1;
                }
                StateKind::Super { container } => {
                    let content = inside
                        .get(container)
                        .ok_or(CompileError::Contradiction(state.span))?;
                    at.flags += content.spans.flags;
                    at.tasks += content.spans.tasks;
                    at.regions += content.spans.regions;
                    at.instances += content.spans.instances;
                    at.states += content.spans.states;
                }
            }
            states.push(StateLayout {
                index: 0,
                begin,
                flags,
            });
        }
        let pseudo_states = 2;
        at.states += region.states.len() + pseudo_states;
        region_instances += at.regions;
        regions.push(RegionLayout {
            initial: 0,
            last: 0,
            states,
            region_span: at.regions,
        });
        // Checked as they grow, since nesting can make them grow exponentially.
        within(Capacity::Flags, at.flags, usize::from(u16::MAX))?;
        within(Capacity::TaskInstances, at.tasks, MAX_RECORDS)?;
        within(Capacity::RegionInstances, region_instances, MAX_RECORDS)?;
        within(Capacity::Instances, at.instances, MAX_RECORDS)?;
        within(Capacity::StateInstances, at.states, MAX_STATE_INSTANCES)?;
    }
    at.regions = region_instances;
    Ok(ContainerLayout {
        model_index: index,
        regions,
        spans: at,
        sent: sent_by(container),
    })
}

/// Flags that entering a state resets.
fn flags_of(model: &Model, state: &State, reads_timeout: bool) -> usize {
    match state.kind {
        StateKind::Simple => usize::from(reads_timeout || state.timeout_us.is_some()),
        StateKind::Task { task, .. } => TASK_CONTROL_FLAGS + model.tasks[task].flags.len(),
        StateKind::Super { container } => {
            CONTAINER_CONTROL_FLAGS + model.containers[container].flags.len()
        }
    }
}

/// The states whose timeout flag a guard reads.
fn timeouts_read(region: &Region) -> HashSet<Source> {
    let reads_timeout = |transition: &&Transition| {
        let guard = transition.guard.as_ref();
        guard.is_some_and(mentions_timeout)
    };
    let readers = region.transitions.iter().filter(reads_timeout);
    readers.map(|transition| transition.source).collect()
}

fn mentions_timeout(guard: &Guard) -> bool {
    match guard {
        Guard::Timeout => true,
        Guard::Exit | Guard::Busy | Guard::Own(_) | Guard::Parent(_) => false,
        Guard::Not(inner) => mentions_timeout(inner),
        Guard::And(terms) | Guard::Or(terms) => terms.iter().any(mentions_timeout),
    }
}

/// Events that a container's transitions send.
fn sent_by(container: &Container) -> Vec<usize> {
    let mut sent = Vec::new();
    let mut seen = HashSet::new();
    let transitions = container.regions.iter().flat_map(|r| &r.transitions);
    for action in transitions.flat_map(|transition| &transition.actions) {
        if let Action::Send(event) = *action
            && seen.insert(event)
        {
            sent.push(event);
        }
    }
    sent
}
