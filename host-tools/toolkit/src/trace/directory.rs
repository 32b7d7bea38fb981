//! Where everything in a machine is, by name: the path of each state instance and of each flag.
//!
//! A path is region names and state names in turn from the root: `motion/Escape/turn/Back`. All
//! paths are worked out once, so that writing a trace or reading a scenario costs a look-up. A
//! directory is made of a verified blob; nothing else is needed to say what happened on a robot.
//! Where the blob's names were left out, numbered ones may stand for them.

use std::collections::{BTreeMap, HashMap};
use std::ops::Range;

use esm_core::format;
use esm_core::signature::{Direction, Port};
use esm_core::tables::{self, Code, Container, Region, Tables};
use thiserror::Error;

use crate::superstates::superstates;

/// The superstate around each container instance.
type Superstates = [Option<(usize, usize)>];

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
    /// What a transition says in all instances of its region, by its index in the blob.
    transitions: Vec<TransitionOutline>,
    by_path: HashMap<String, StateId>,
    /// Events by their numbers, from 1 on.
    events: Vec<String>,
    interpreter_period_us: u32,
    path_bytes: usize,
    /// Names of the task types, by the lower halves of the hashes of their signatures.
    task_names: BTreeMap<u16, String>,
}

/// The most bytes of the paths of all states. Superstates that are nested thousands deep have paths
/// that long that no trace of them can be read.
pub const MAX_PATH_BYTES: usize = 64 << 20;

/// Why nothing can be said about what a blob does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum NoDirectory {
    /// It was built without its names.
    #[error("the blob was built without names: build it again with them")]
    NoNames,
    /// The paths of its states have more than [`MAX_PATH_BYTES`].
    #[error(
        "the paths of all its states take more than {MAX_PATH_BYTES} bytes: nest superstates less deep, or give what is nested shorter names"
    )]
    PathsTooLong,
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
    /// The region instance where a walk through what is current goes on when it is done with this
    /// one and all in it; the number of region instances where it ends.
    pub next: usize,
    /// Its local states: `initial`, its states in source order, `final`.
    pub locals: Vec<StateEntry>,
    /// Index in the blob of the first of them.
    first_state: usize,
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
        /// The region instances in it, at any depth; the first one is the first region of its
        /// container.
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

/// What a transition says in all instances of its region.
#[derive(Clone, Debug)]
struct TransitionOutline {
    event: String,
    /// Indices in the blob of source and target.
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
    /// Reads the tables of a blob.
    ///
    /// # Errors
    /// See [`NoDirectory`].
    pub fn of(tables: &Tables<'_>) -> Result<Self, NoDirectory> {
        let mut table = tables.names().ok_or(NoDirectory::NoNames)?;
        let names = TemplateNames::of(tables, |_| {
            table.next().map(text).ok_or(NoDirectory::NoNames)
        })?;
        Self::with(tables, &names)
    }

    /// The same; of a blob without names with [numbers](Numbered) for them, as `esm inspect` shows
    /// it.
    ///
    /// # Errors
    /// [`NoDirectory::PathsTooLong`]
    pub fn named_or_numbered(tables: &Tables<'_>) -> Result<Self, NoDirectory> {
        if tables.names().is_some() {
            return Self::of(tables);
        }
        let mut numbered = Numbered::default();
        let names = TemplateNames::of(tables, |kind| Ok(numbered.next(kind)))?;
        Self::with(tables, &names)
    }

    fn with(tables: &Tables<'_>, names: &TemplateNames) -> Result<Self, NoDirectory> {
        let mut directory = Directory {
            tasks: vec![
                StateId {
                    region: 0,
                    local: 0
                };
                tables.task_instance_count()
            ],
            transitions: (0..tables.transition_count())
                .filter_map(|transition| names.transition(tables, transition))
                .collect(),
            interpreter_period_us: tables
                .slot(tables.interpreter_slot())
                .map_or(0, |slot| slot.period_us),
            task_names: (tables.tasks())
                .map(|task| (task.signature_hash as u16, text(task.signature.name())))
                .collect(),
            ..Directory::default()
        };
        directory.events.clone_from(&names.events);
        let superstates = superstates(tables);
        let mut path_bytes = 0_usize;
        for region in 0..tables.region_instance_count() {
            let bytes = directory.path_bytes(tables, names, &superstates, region);
            path_bytes = path_bytes.saturating_add(bytes.ok_or(NoDirectory::NoNames)?);
            if path_bytes > MAX_PATH_BYTES {
                return Err(NoDirectory::PathsTooLong);
            }
            let entry = directory
                .region_entry(tables, names, &superstates, region)
                .ok_or(NoDirectory::NoNames)?;
            for (local, state) in entry.locals.iter().enumerate() {
                let id = StateId { region, local };
                directory.by_path.insert(state.path.clone(), id);
                if let StateKind::Task { instance } = state.kind
                    && let Some(task) = directory.tasks.get_mut(instance)
                {
                    *task = id;
                }
            }
            directory.regions.push(entry);
        }
        directory.path_bytes = path_bytes;
        Ok(directory)
    }

    /// The superstate around an instance, if there is one. `None` for tables that no verified blob
    /// has.
    fn owner_of(&self, superstates: &Superstates, instance: usize) -> Option<Option<StateId>> {
        let superstate = *superstates.get(instance)?;
        Some(superstate.and_then(|(region, state)| self.state_at(region, state)))
    }

    /// Bytes of the paths of a region instance and its states, before they are made.
    fn path_bytes(
        &self,
        tables: &Tables<'_>,
        names: &TemplateNames,
        superstates: &Superstates,
        index: usize,
    ) -> Option<usize> {
        let region = tables.region_instance(index)?;
        let owner = self.owner_of(superstates, region.instance)?;
        let outline = names.regions.get(tables.region_of_state(region.initial))?;
        let around = owner.and_then(|owner| self.state(owner));
        let path = around.map_or(0, |owner| owner.path.len() + 1) + outline.name.len();
        let own = outline
            .states
            .iter()
            .map(|state| path + 1 + state.name.len());
        Some(path + own.sum::<usize>())
    }

    /// A region instance, when all those before it are known. `None` for tables that no verified
    /// blob has.
    fn region_entry(
        &self,
        tables: &Tables<'_>,
        names: &TemplateNames,
        superstates: &Superstates,
        index: usize,
    ) -> Option<RegionEntry> {
        let region = tables.region_instance(index)?;
        let instance = tables.instance(region.instance)?;
        let owner = self.owner_of(superstates, region.instance)?;
        let outline = names.regions.get(tables.region_of_state(region.initial))?;
        let path = match owner.and_then(|owner| self.state(owner)) {
            Some(owner) => format!("{}/{}", owner.path, outline.name),
            None => outline.name.clone(),
        };
        let mut locals = Vec::with_capacity(outline.states.len());
        for (local, state) in outline.states.iter().enumerate() {
            let kind = match tables.state(region.initial + local)?.kind {
                tables::StateKind::Initial | tables::StateKind::Final => StateKind::Pseudo,
                tables::StateKind::Simple => StateKind::Simple,
                tables::StateKind::Task { task_offset, .. } => StateKind::Task {
                    instance: instance.first_task + task_offset,
                },
                tables::StateKind::Super { instance_offset } => {
                    let inside = tables.instance(region.instance + instance_offset)?;
                    let first = inside.first_region;
                    let span = names.containers.get(inside.container)?.region_span;
                    StateKind::Super {
                        inside: first..first + span,
                    }
                }
            };
            let name_start = path.len() + 1;
            locals.push(StateEntry {
                path: format!("{path}/{}", state.name),
                name_start,
                kind,
                flags: state.flags.clone(),
            });
        }
        let (name, first_state, next) = (outline.name.clone(), region.initial, region.next);
        Some(RegionEntry {
            index,
            name,
            path,
            owner,
            next,
            locals,
            first_state,
        })
    }

    /// Bytes of the paths of all states.
    pub fn bytes_of_paths(&self) -> usize {
        self.path_bytes
    }

    /// Period of the interpreter's slot in microseconds.
    pub fn interpreter_period_us(&self) -> u32 {
        self.interpreter_period_us
    }

    /// The event with a number; `pulse` for that of none.
    pub fn event(&self, number: u16) -> &str {
        let index = usize::from(number).checked_sub(1);
        let name = index.and_then(|index| self.events.get(index));
        name.map_or("pulse", String::as_str)
    }

    /// The local state of a region instance that has an index in the blob.
    pub fn state_at(&self, region: usize, state: usize) -> Option<StateId> {
        let entry = self.regions.get(region)?;
        let local = state
            .checked_sub(entry.first_state)
            .filter(|local| *local < entry.locals.len())?;
        Some(StateId { region, local })
    }

    /// Index in the blob of a local state.
    pub fn index_of(&self, state: StateId) -> Option<usize> {
        let entry = self.regions.get(state.region)?;
        entry
            .locals
            .get(state.local)
            .map(|_| entry.first_state + state.local)
    }

    /// The region instances, depth first.
    pub fn regions(&self) -> &[RegionEntry] {
        &self.regions
    }

    /// The states of the task instances, in the order of the instance tree.
    pub fn task_states(&self) -> &[StateId] {
        &self.tasks
    }

    /// Names of the task types, by the lower halves of the hashes of their signatures, as a list of
    /// behaviours names them.
    pub fn task_names(&self) -> &BTreeMap<u16, String> {
        &self.task_names
    }

    /// A local state. `None` for a place that the machine does not have.
    pub fn state(&self, id: StateId) -> Option<&StateEntry> {
        self.regions.get(id.region)?.locals.get(id.local)
    }

    /// The state with a path.
    pub fn find(&self, path: &str) -> Option<StateId> {
        self.by_path.get(path).copied()
    }

    /// The regions directly inside a superstate, or those of the machine for `None`, in source
    /// order.
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
        let outline = self.transitions.get(transition)?;
        let (from, to) = (
            self.state_at(region, outline.from)?,
            self.state_at(region, outline.to)?,
        );
        let (from, to) = (self.state(from)?, self.state(to)?);
        let region = self.regions.get(region)?;
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

    /// The local states that are current, depth first: regions in source order, each superstate
    /// followed by what is in it. `current` gives the index in the blob of a region instance's
    /// current local state.
    pub fn active(&self, mut current: impl FnMut(usize) -> usize) -> impl Iterator<Item = StateId> {
        let mut region = 0;
        std::iter::from_fn(move || {
            let id = self.state_at(region, current(region))?;
            region = match &self.state(id)?.kind {
                StateKind::Super { inside } if !inside.is_empty() => inside.start,
                _ => self.regions.get(region)?.next,
            };
            Some(id)
        })
    }

    /// Whether every region of the machine itself has reached its final state, so that nothing
    /// happens any more.
    /// `current` answers with a state's index in the blob.
    pub fn has_finished(&self, mut current: impl FnMut(usize) -> usize) -> bool {
        let mut regions = self.regions_of(None).peekable();
        regions.peek().is_some()
            && regions.all(|region| {
                let state = self.state_at(region.index, current(region.index));
                state.is_some_and(|state| state.local + 1 == region.locals.len())
            })
    }
}

/// Names for what has none: the word for its kind, and a number. No two are the same, and none is a
/// reserved word. They are asked for in the order of a blob's name table.
#[derive(Debug, Default)]
pub struct Numbered(HashMap<&'static str, usize>);

impl Numbered {
    /// Of an event.
    pub const EVENT: &'static str = "Event";
    /// Of the machine.
    pub const MACHINE: &'static str = "Machine";
    /// Of another container.
    pub const CONTAINER: &'static str = "Container";
    /// Of a control flag of a container.
    pub const FLAG: &'static str = "flag";
    /// Of a region.
    pub const REGION: &'static str = "region";
    /// Of a state.
    pub const STATE: &'static str = "State";
    /// Of an exclusive group.
    pub const GROUP: &'static str = "group";

    /// The next name of a kind.
    pub fn next(&mut self, kind: &'static str) -> String {
        let number = self.0.entry(kind).or_default();
        *number += 1;
        format!("{kind}{number}")
    }
}

/// The names of containers, regions and states, before they are put together to paths.
struct TemplateNames {
    events: Vec<String>,
    containers: Vec<Container>,
    /// Control flags of each container.
    container_flags: Vec<Vec<String>>,
    regions: Vec<RegionNames>,
}

struct RegionNames {
    name: String,
    container: usize,
    first_state: usize,
    states: Vec<StateNames>,
}

struct StateNames {
    name: String,
    flags: Vec<FlagEntry>,
}

impl TemplateNames {
    /// Asks for the names in the order of a blob's table, each by its kind.
    fn of(
        tables: &Tables<'_>,
        mut next: impl FnMut(&'static str) -> Result<String, NoDirectory>,
    ) -> Result<Self, NoDirectory> {
        let containers: Vec<Container> = tables.containers().collect();
        let regions: Vec<Region> = tables.regions().collect();
        let events = (0..tables.event_count())
            .map(|_| next(Numbered::EVENT))
            .collect::<Result<_, _>>()?;
        let mut names = TemplateNames {
            events,
            containers,
            container_flags: Vec::new(),
            regions: Vec::new(),
        };
        for (index, container) in names.containers.iter().enumerate() {
            // The container's own name says which template it is, not where an instance stands.
            next(match index {
                0 => Numbered::MACHINE,
                _ => Numbered::CONTAINER,
            })?;
            names.container_flags.push(
                (0..container.flags)
                    .map(|_| next(Numbered::FLAG))
                    .collect::<Result<_, _>>()?,
            );
            let own = regions.iter().enumerate().skip(container.first_region);
            for (number, region) in own.take_while(|(_, region)| region.container == index) {
                let end = regions
                    .get(number + 1)
                    .map_or(tables.state_count(), |after| after.first_state);
                let name = next(Numbered::REGION)?;
                let mut states = Vec::with_capacity(end.saturating_sub(region.first_state));
                for state in (region.first_state..end).filter_map(|state| tables.state(state)) {
                    let name = match state.kind {
                        tables::StateKind::Initial => "initial".into(),
                        tables::StateKind::Final => "final".into(),
                        _ => next(Numbered::STATE)?,
                    };
                    states.push(StateNames {
                        name,
                        flags: Vec::new(),
                    });
                }
                names.regions.push(RegionNames {
                    name,
                    container: index,
                    first_state: region.first_state,
                    states,
                });
            }
        }
        names.add_flags(tables);
        Ok(names)
    }

    /// The control flags of states, which are named by a task's signature or by the container
    /// inside.
    fn add_flags(&mut self, tables: &Tables<'_>) {
        let task_flags: Vec<Vec<FlagEntry>> = tables
            .tasks()
            .map(|task| task.signature.ports().filter_map(flag).collect())
            .collect();
        for region in &mut self.regions {
            for (local, state) in region.states.iter_mut().enumerate() {
                state.flags = match tables
                    .state(region.first_state + local)
                    .map(|state| state.kind)
                {
                    Some(tables::StateKind::Task { .. }) => {
                        let task = tables
                            .task_state_at(region.first_state + local)
                            .and_then(|task_state| tables.task_state(task_state))
                            .map(|task_state| task_state.task);
                        task.and_then(|task| task_flags.get(task))
                            .cloned()
                            .unwrap_or_default()
                    }
                    Some(tables::StateKind::Super { instance_offset }) => {
                        // What is true of one instance of a template is true of all.
                        let first = self
                            .containers
                            .get(region.container)
                            .map_or(0, |container| container.first_instance);
                        let inside = tables
                            .instance(first + instance_offset)
                            .map(|instance| instance.container);
                        let flags = inside.and_then(|inside| self.container_flags.get(inside));
                        let entry = |name: &String| FlagEntry {
                            name: name.clone(),
                            is_out: false,
                        };
                        flags
                            .map(|flags| flags.iter().map(entry).collect())
                            .unwrap_or_default()
                    }
                    _ => Vec::new(),
                };
            }
        }
    }

    fn transition(&self, tables: &Tables<'_>, index: usize) -> Option<TransitionOutline> {
        let transition = tables.transition(index)?;
        let (from, to) = (tables.source_of_transition(index), transition.target);
        let region = self.regions.get(tables.region_of_state(to))?;
        let container = self.containers.get(region.container)?;
        let instance = tables.instance(container.first_instance)?;
        let mut actions = Vec::new();
        // Only what is true of all instances is used of this one.
        for code in tables.actions_of(index) {
            match code {
                Code::Send { channel, .. } => {
                    let event = tables.channel(instance.first_channel + channel)?.event;
                    actions.push(ActionOutline::Send {
                        event: self.event(event)?,
                    });
                }
                Code::Write { flag, value, .. } => {
                    actions.push(self.write(tables, region, to, flag, value)?)
                }
                Code::Test { .. } | Code::TestBusyInside { .. } | Code::End => {}
            }
        }
        Some(TransitionOutline {
            event: self.event(transition.event)?,
            from,
            to,
            actions,
        })
    }

    fn event(&self, number: u16) -> Option<String> {
        match number {
            format::PULSE => Some("pulse".into()),
            number => self.events.get(usize::from(number) - 1).cloned(),
        }
    }

    /// A write of the flag with that bit, relative to its container instance's first.
    fn write(
        &self,
        tables: &Tables<'_>,
        region: &RegionNames,
        to: usize,
        bit: usize,
        value: bool,
    ) -> Option<ActionOutline> {
        let parent_flags = self.container_flags.get(region.container)?;
        if let Some(flag) = bit
            .checked_sub(format::CONTAINER_CONTROL_FLAGS)
            .and_then(|index| parent_flags.get(index))
        {
            return Some(ActionOutline::WriteParent {
                flag: flag.clone(),
                value,
            });
        }
        let target = tables.state(to)?;
        let head = match target.kind {
            tables::StateKind::Task { .. } => format::TASK_CONTROL_FLAGS,
            _ => format::CONTAINER_CONTROL_FLAGS,
        };
        let flags = &region
            .states
            .get(to.checked_sub(region.first_state)?)?
            .flags;
        let flag = flags.get(bit.checked_sub(target.first_flag + head)?)?;
        Some(ActionOutline::WriteOwn {
            flag: flag.name.clone(),
            value,
        })
    }
}

/// A flag of a signature.
fn flag(port: Port<'_>) -> Option<FlagEntry> {
    match port {
        Port::Flag { direction, name } => Some(FlagEntry {
            name: text(name),
            is_out: direction == Direction::Out,
        }),
        Port::Data { .. } | Port::Param { .. } => None,
    }
}

/// Names in a verified blob are ASCII identifiers.
fn text(name: &[u8]) -> String {
    String::from_utf8_lossy(name).into_owned()
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    /// A machine with superstates nested `levels` deep, compiled.
    fn nested(levels: usize) -> Vec<u8> {
        let name = "x".repeat(100);
        let mut text = "interpreter slot 1; slot 1 period 10 ms duration 1 ms;\n\
            container C0 { region r { state S; initial -> S; S -> final; } }\n"
            .to_owned();
        for level in 0..levels {
            let inside =
                format!("super {name}: C{level}; initial -> {name}; {name} -> final on *;");
            text += &format!("container C{} {{ region r {{ {inside} }} }}\n", level + 1);
        }
        text += &format!(
            "machine M {{ region r {{ super S: C{levels}; initial -> S; S -> S on *; }} }}"
        );
        let mut checked = crate::lang::load_text("nested.esm", &text);
        let schedule = checked.lay_out(Duration::from_secs(1)).unwrap();
        crate::compile::compile(&checked.model.unwrap(), &schedule).unwrap()
    }

    #[test]
    fn paths_without_end_are_refused_before_they_are_made() {
        for (levels, expected) in [(10, None), (1_000, Some(NoDirectory::PathsTooLong))] {
            let verified = esm_core::verify(nested(levels)).unwrap();
            assert_eq!(Directory::of(&verified.tables()).err(), expected);
        }
    }
}
