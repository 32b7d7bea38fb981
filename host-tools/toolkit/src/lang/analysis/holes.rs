//! What of a set of files could not be read or resolved.
//!
//! A file with mistakes still has a model, of what could be understood. The rest is written down
//! here, so that whoever looks at the model knows where it is not the whole: a warning that is true
//! of the model alone may be false of what was meant, and would only repeat a mistake that is
//! reported already. A set of files without errors has no holes.
//!
//! Everything is in the order of the model: `containers[c].regions[r].states[s]` is about state `s`
//! of region `r` of container `c`.

use crate::model::{Model, Source, Target};

/// The holes of a set of files.
#[derive(Clone, Debug, Default)]
pub struct Holes {
    /// There may be declarations beyond those of the model: a file could not be read, is circular,
    /// or has something between its declarations that was not understood.
    pub set: bool,
    /// The number or the times of a slot are not known.
    pub slots: bool,
    /// One for each task of the model.
    pub tasks: Vec<TaskHoles>,
    /// One for each container of the model.
    pub containers: Vec<ContainerHoles>,
}

/// What is not known of a task.
#[derive(Clone, Debug, Default)]
pub struct TaskHoles {
    /// There may be ports, flags or parameters beyond those of the model, or one of those could not
    /// be read whole.
    pub declarations: bool,
    /// Another task of this name came first: whoever uses the name gets that one.
    pub is_twin: bool,
}

/// What is not known of a container.
#[derive(Clone, Debug, Default)]
pub struct ContainerHoles {
    /// There may be events, flags, ports or regions beyond those of the model, or one of those
    /// could not be read whole.
    pub declarations: bool,
    /// There may be data paths, or ends of data paths, beyond those of the model, or one of those
    /// cannot be right.
    pub paths: bool,
    /// Another container of this name came first, or another machine.
    pub is_twin: bool,
    /// One for each region of the model.
    pub regions: Vec<RegionHoles>,
}

/// What is not known of a region.
#[derive(Clone, Debug, Default)]
pub struct RegionHoles {
    /// There may be states and transitions beyond those of the model and those below, or none leads
    /// from `initial`.
    pub body: bool,
    /// One for each state of the model.
    pub states: Vec<StateHoles>,
    /// Transitions that are there, but not in the model.
    pub transitions: Vec<LooseTransition>,
    /// Transitions of the model whose guard is not known: indices into
    /// [`Region::transitions`](crate::model::Region), ascending.
    pub guards: Vec<usize>,
    /// Transitions of the model that have more actions than it says: indices, ascending.
    pub actions: Vec<usize>,
}

/// What is not known of a state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StateHoles {
    /// Its task or container is not known: what the model says of it means nothing.
    pub kind: bool,
    /// Whether it has a limit of time, or which, is not known.
    pub limit: bool,
    /// It has no name that a transition could use: another state of this name came first, or the
    /// name could not be read.
    pub is_twin: bool,
}

/// A transition that is not in the model, because an end or the trigger of it is not known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LooseTransition {
    /// Its source, where that is known.
    pub source: Option<Source>,
    /// Its target, where that is known.
    pub target: Option<Target>,
}

impl Holes {
    /// The holes of a model that has none.
    pub fn none(model: &Model) -> Self {
        Holes {
            set: false,
            slots: false,
            tasks: vec![TaskHoles::default(); model.tasks.len()],
            containers: model
                .containers
                .iter()
                .map(|container| ContainerHoles {
                    regions: container
                        .regions
                        .iter()
                        .map(|region| RegionHoles {
                            states: vec![StateHoles::default(); region.states.len()],
                            ..RegionHoles::default()
                        })
                        .collect(),
                    ..ContainerHoles::default()
                })
                .collect(),
        }
    }

    /// Whether all tasks, containers, ports, states and data paths of the set are known, whatever
    /// transitions lead to what.
    pub fn are_parts_known(&self) -> bool {
        let is_known = |region: &RegionHoles| {
            !region.body
                && region
                    .states
                    .iter()
                    .all(|state| !state.kind && !state.is_twin)
        };
        !self.set
            && self
                .tasks
                .iter()
                .all(|task| !task.declarations && !task.is_twin)
            && self.containers.iter().all(|container| {
                !container.declarations
                    && !container.paths
                    && !container.is_twin
                    && container.regions.iter().all(is_known)
            })
    }

    /// Whether anything is not known.
    pub fn any(&self) -> bool {
        self.set
            || self.slots
            || self
                .tasks
                .iter()
                .any(|task| task.declarations || task.is_twin)
            || self.containers.iter().any(ContainerHoles::any)
    }
}

impl ContainerHoles {
    /// Whether anything of the container, its regions included, is not known.
    pub fn any(&self) -> bool {
        self.declarations || self.paths || self.is_twin || self.regions.iter().any(RegionHoles::any)
    }
}

impl RegionHoles {
    /// Whether anything of the region is not known.
    pub fn any(&self) -> bool {
        self.body
            || !self.transitions.is_empty()
            || !self.guards.is_empty()
            || !self.actions.is_empty()
            || self
                .states
                .iter()
                .any(|state| *state != StateHoles::default())
    }

    /// Whether the guard of a transition of the model is not known.
    pub fn lacks_guard(&self, transition: usize) -> bool {
        self.guards.binary_search(&transition).is_ok()
    }

    /// Whether a transition of the model has more actions than it says.
    pub fn lacks_actions(&self, transition: usize) -> bool {
        self.actions.binary_search(&transition).is_ok()
    }
}
