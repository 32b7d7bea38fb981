//! What a machine was behind a micro step, in words: regions with their current states, flags,
//! timers, and the events of the macro step.

use esm_core::format;
use esm_core::tables::Tables;

use super::retold::{Queued, Retold};
use crate::trace::directory::{Directory, StateId, StateKind};

/// What a machine was behind a micro step.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Surroundings {
    /// The active regions, depth first.
    pub regions: Vec<RegionThen>,
    /// The flags of the states that were current, and those of other states that are new, in the
    /// order of the regions.
    pub flags: Vec<FlagThen>,
    /// The timers that ran, in the order of the regions.
    pub timers: Vec<TimerThen>,
    /// The events of the macro step, as far as they had been sent, in order.
    pub events: Vec<EventThen>,
}

/// An active region.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RegionThen {
    /// Superstates around it.
    pub depth: usize,
    /// Its name.
    pub name: String,
    /// Name of its current state.
    pub state: String,
    /// Whether it was entered in this micro step.
    pub is_new: bool,
}

/// A flag of a state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FlagThen {
    /// Path of the state.
    pub state: String,
    /// Its name.
    pub name: String,
    /// Its bit in the whole machine.
    pub bit: usize,
    /// Its value behind the micro step.
    pub is_set: bool,
    /// Whether it is one that every such state has: `exit`, `timeout`, `busy`.
    pub of_system: bool,
    /// Whether its value was another one behind the moment before.
    pub is_new: bool,
}

/// A timer of a state that was current.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TimerThen {
    /// Path of the state.
    pub state: String,
    /// For how long it had been current, in microseconds.
    pub age_us: u64,
    /// Its timeout, in microseconds.
    pub limit_us: u64,
    /// Whether its `timeout` is set.
    pub is_over: bool,
}

/// An event of a macro step.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EventThen {
    /// Number of its micro step.
    pub micro: usize,
    /// Its name.
    pub name: String,
    /// Path of the state that was left by the transition that sent it; none for the pulse.
    pub sent_by: Option<String>,
    /// Paths of the active regions that see it and have a transition on it; empty for the pulse,
    /// which all see.
    pub heard_by: Vec<String>,
}

/// A flag of a state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct NamedFlag<'d> {
    pub name: &'d str,
    pub of_system: bool,
    /// Its bit in the whole machine.
    pub bit: usize,
}

/// The flags of a state, in the order of its block.
pub(super) fn flags_of<'d>(
    directory: &'d Directory,
    tables: &Tables<'_>,
    id: StateId,
) -> Vec<NamedFlag<'d>> {
    const EXIT: (&str, usize) = ("exit", format::FLAG_EXIT);
    const TIMEOUT: (&str, usize) = ("timeout", format::FLAG_TIMEOUT);
    const BUSY: (&str, usize) = ("busy", format::FLAG_BUSY);
    let block = directory
        .index_of(id)
        .and_then(|state| tables.flags_of_state(id.region, state));
    let (Some(state), Some((first, length))) = (directory.state(id), block) else {
        return Vec::new();
    };
    let (system, control): (&[_], usize) = match state.kind {
        StateKind::Pseudo => (&[], 0),
        StateKind::Simple => (&[("timeout", 0)], 0),
        StateKind::Task { .. } => (&[EXIT, TIMEOUT, BUSY], format::TASK_CONTROL_FLAGS),
        StateKind::Super { .. } => (&[EXIT, TIMEOUT], format::CONTAINER_CONTROL_FLAGS),
    };
    let system = system.iter().map(|&(name, offset)| (name, true, offset));
    let own = state.flags.iter().enumerate();
    let own = own.map(|(place, flag)| (flag.name.as_str(), false, control + place));
    system
        .chain(own)
        // A state that needs no timeout flag has no room for one.
        .filter(|(_, _, offset)| *offset < length)
        .map(|(name, of_system, offset)| NamedFlag {
            name,
            of_system,
            bit: first + offset,
        })
        .collect()
}

impl Surroundings {
    /// What a machine is now; `begun` are the regions that were entered in this micro step,
    /// `was_set` tells flags behind the moment before.
    pub(super) fn of(
        retold: &Retold<'_>,
        begun: &[usize],
        was_set: impl Fn(usize) -> bool,
    ) -> Self {
        let directory = retold.directory;
        let mut surroundings = Surroundings::default();
        let active: Vec<StateId> = directory.active(|region| retold.current(region)).collect();
        for &id in &active {
            let (Some(region), Some(state)) =
                (directory.regions().get(id.region), directory.state(id))
            else {
                continue;
            };
            surroundings.regions.push(RegionThen {
                depth: state.path.matches('/').count() / 2,
                name: region.name.clone(),
                state: state.name().to_owned(),
                is_new: begun.contains(&id.region),
            });
            if let Some((flag, age_us, limit_us)) = retold.timer(id.region) {
                surroundings.timers.push(TimerThen {
                    state: state.path.clone(),
                    age_us,
                    limit_us,
                    is_over: retold.flag(flag),
                });
            }
        }
        let states = directory.regions().iter().flat_map(|region| {
            let locals = region.locals.iter().enumerate();
            locals.map(|(local, state)| {
                let region = region.index;
                (StateId { region, local }, state)
            })
        });
        for (id, state) in states {
            let is_current = active.contains(&id);
            for flag in flags_of(directory, &retold.tables, id) {
                let is_set = retold.flag(flag.bit);
                let is_new = is_set != was_set(flag.bit);
                if is_current || is_new {
                    surroundings.flags.push(FlagThen {
                        state: state.path.clone(),
                        name: flag.name.to_owned(),
                        bit: flag.bit,
                        is_set,
                        of_system: flag.of_system,
                        is_new,
                    });
                }
            }
        }
        let events = retold.queue.iter().enumerate();
        surroundings.events = events
            .map(|(micro, queued)| event(retold, &active, micro, queued))
            .collect();
        surroundings
    }
}

fn event(retold: &Retold<'_>, active: &[StateId], micro: usize, queued: &Queued) -> EventThen {
    let directory = retold.directory;
    let channel = queued
        .channel
        .and_then(|channel| retold.tables.channel(channel));
    let sender = queued
        .by
        .and_then(|(region, transition)| directory.transition(region, transition));
    let hears = |id: &&StateId| {
        channel.is_some_and(|channel| retold.tables.is_listening(&channel, id.region))
    };
    EventThen {
        micro,
        name: channel
            .map_or("pulse", |channel| directory.event(channel.event))
            .to_owned(),
        sent_by: sender.map(|words| words.from.to_owned()),
        heard_by: active
            .iter()
            .filter(hears)
            .filter_map(|id| directory.regions().get(id.region))
            .map(|region| region.path.clone())
            .collect(),
    }
}
