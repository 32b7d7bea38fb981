//! Where everything in a machine is, by name: the path of each state instance and of each flag.
//!
//! A path is region names and state names in turn from the root: `motion/Escape/turn/Back`. All paths are worked out once, so that
//! writing a trace or reading a scenario costs a look-up. A directory is made of a verified blob that has its names; nothing else
//! is needed to say what happened on a robot.

use std::collections::HashMap;
use std::ops::Range;

/// A local state of a region instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct StateId {
    /// Index of the region instance.
    pub region: usize,
    /// Index into [`RegionEntry::locals`].
    pub local: usize,
}

/// The instance tree of a machine, with its names.
#[derive(Clone, Debug, Default)]
pub struct Directory {
    regions: Vec<RegionEntry>,
    /// The state of each task instance, in the order of the instance tree.
    tasks: Vec<StateId>,
    /// What the region instances of one region of a container have in common.
    outlines: Vec<RegionOutline>,
    by_path: HashMap<String, StateId>,
}

/// A region instance.
#[derive(Clone, Debug)]
pub struct RegionEntry {
    /// Its own index.
    pub index: usize,
    /// Its name in its container.
    pub name: String,
    /// Its path.
    pub path: String,
    /// The superstate that it is in, `None` at the root.
    pub owner: Option<StateId>,
    /// The region instance where a walk through what is current goes on when it is done with this one and all in it; the number of
    /// region instances where it ends.
    pub next: usize,
    /// Index into the outlines: which region of which container it is an instance of.
    outline: usize,
    /// Its local states: [`INITIAL`], [`FINAL`], and from [`FIRST_STATE`] on its states in source order.
    pub locals: Vec<StateEntry>,
}

impl RegionEntry {
    /// Its local state of that name.
    pub fn find(&self, name: &str) -> Option<StateId> {
        let local = self.locals.iter().position(|state| state.name() == name)?;
        Some(StateId {
            region: self.index,
            local,
        })
    }
}

/// Index of the initial pseudo-state among a region's local states.
pub const INITIAL: usize = 0;
/// Index of the final pseudo-state among a region's local states.
pub const FINAL: usize = 1;
/// Index of the first state among a region's local states.
pub const FIRST_STATE: usize = 2;

/// A local state.
#[derive(Clone, Debug)]
pub struct StateEntry {
    /// Its path; [`StateEntry::name`] is the end of it.
    pub path: String,
    /// Where the name starts in the path.
    name_start: usize,
    /// What it is.
    pub kind: StateKind,
    /// Its control flags, in the order of the signature.
    pub flags: Vec<FlagEntry>,
}

impl StateEntry {
    /// Its name in its region.
    pub fn name(&self) -> &str {
        &self.path[self.name_start..]
    }
}

/// What a local state is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StateKind {
    /// `initial` or `final`.
    Pseudo,
    /// A simple state.
    Simple,
    /// A task state.
    Task {
        /// Index of the task instance.
        instance: usize,
    },
    /// A superstate.
    Super {
        /// The region instances in it, at any depth; the first one is the first region of its container.
        inside: Range<usize>,
    },
}

/// A control flag of a task state or superstate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FlagEntry {
    /// Its name.
    pub name: String,
    /// Whether the task sets it (`out`), or transitions do (`in`).
    pub is_out: bool,
}

/// What the instances of a region share: its transitions, by names that hold in each of them.
#[derive(Clone, Debug, Default)]
struct RegionOutline {
    transitions: Vec<TransitionOutline>,
}

#[derive(Clone, Debug)]
struct TransitionOutline {
    event: String,
    from: usize,
    to: usize,
    actions: Vec<ActionOutline>,
}

#[derive(Clone, Debug)]
enum ActionOutline {
    Send {
        event: String,
    },
    /// A flag of the transition's target.
    WriteOwn {
        flag: String,
        value: bool,
    },
    /// A flag of the superstate that holds the container.
    WriteParent {
        flag: String,
        value: bool,
    },
}

/// A transition of a region instance, in words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TransitionWords<'a> {
    /// The event that it is taken on; `pulse` also for `*`.
    pub event: &'a str,
    /// Path of its source.
    pub from: &'a str,
    /// Path of its target.
    pub to: &'a str,
    /// Events that its actions send, in order.
    pub sent: Vec<&'a str>,
    /// Paths of the flags that its actions set, in order.
    pub set: Vec<String>,
    /// Paths of the flags that its actions clear, in order.
    pub cleared: Vec<String>,
}

impl Directory {
    /// The region instances, depth first.
    pub fn regions(&self) -> &[RegionEntry] {
        &self.regions
    }

    /// The states of the task instances, in the order of the instance tree.
    pub fn task_states(&self) -> &[StateId] {
        &self.tasks
    }

    /// A local state. `None` for a place that the machine does not have.
    pub fn state(&self, id: StateId) -> Option<&StateEntry> {
        self.regions.get(id.region)?.locals.get(id.local)
    }

    /// The state with a path.
    pub fn find(&self, path: &str) -> Option<StateId> {
        self.by_path.get(path).copied()
    }

    /// The regions directly inside a superstate, or those of the machine for `None`, in source order.
    pub fn regions_of(&self, owner: Option<StateId>) -> impl Iterator<Item = &RegionEntry> {
        let first = match owner {
            None => self.regions.first(),
            Some(owner) => match self.state(owner).map(|state| &state.kind) {
                Some(StateKind::Super { inside }) => self.regions.get(inside.start),
                _ => None,
            },
        };
        let sibling = move |region: &&RegionEntry| {
            self.regions
                .get(region.next)
                .filter(|next| next.owner == owner)
        };
        std::iter::successors(first, sibling)
    }

    /// A transition of a region instance in words. `None` for one that the machine does not have.
    pub fn transition(&self, region: usize, transition: usize) -> Option<TransitionWords<'_>> {
        let region = self.regions.get(region)?;
        let outline = self
            .outlines
            .get(region.outline)?
            .transitions
            .get(transition)?;
        let (from, to) = (
            region.locals.get(outline.from)?,
            region.locals.get(outline.to)?,
        );
        // At the root no flag is written through `^`, so that there is no path to write before one.
        let parent = region
            .owner
            .and_then(|owner| self.state(owner))
            .map_or("", |owner| owner.path.as_str());
        let mut words = TransitionWords {
            event: &outline.event,
            from: &from.path,
            to: &to.path,
            sent: Vec::new(),
            set: Vec::new(),
            cleared: Vec::new(),
        };
        for action in &outline.actions {
            let (path, flag, value) = match action {
                ActionOutline::Send { event } => {
                    words.sent.push(event);
                    continue;
                }
                ActionOutline::WriteOwn { flag, value } => (to.path.as_str(), flag, value),
                ActionOutline::WriteParent { flag, value } => (parent, flag, value),
            };
            let written = if *value {
                &mut words.set
            } else {
                &mut words.cleared
            };
            written.push(format!("{path}.{flag}"));
        }
        Some(words)
    }

    /// The local states that are current, depth first: regions in source order, each superstate followed by what is in it.
    /// `current` gives the current local state of a region instance.
    pub fn active(&self, mut current: impl FnMut(usize) -> usize) -> impl Iterator<Item = StateId> {
        let mut region = 0;
        std::iter::from_fn(move || {
            let entry = self.regions.get(region)?;
            let id = StateId {
                region,
                local: current(region),
            };
            region = match self.state(id).map(|state| &state.kind) {
                Some(StateKind::Super { inside }) if !inside.is_empty() => inside.start,
                _ => entry.next,
            };
            Some(id)
        })
    }
}
