//! Values that get old: what stays on a net when its writer is left (W111), and limits that no
//! writer can meet (W112).
//!
//! Both are questions about nets, so they are asked of the instances as [`nets`](super::nets) lays
//! them out. A writer is an `out` port of a task state. An `inout` port passes on what was on the
//! net, with its time: that makes no value fresh.
//!
//! Of a net that a container leads out of the set, as one can that is checked by itself, nothing is
//! said: who writes and reads it outside is not known.

use std::collections::{BTreeMap, BTreeSet};

use crate::model::{Direction, Model, SlotRef};

use super::activity::{Activity, StateId};
use super::nets::{Layout, Port};

/// How many levels and states are looked at for all nets of a set together; beyond that no more is
/// said.
pub const MAX_STEPS: usize = 4_000_000;

/// A state in which the last value of another stays on a net.
#[derive(Clone, Copy, Debug)]
pub(super) struct Staying {
    /// The state.
    pub(super) state: StateId,
    /// A state of its region that writes the net, or has something inside that does.
    pub(super) writer: StateId,
    /// A port that takes the value however old it is.
    pub(super) reader: Port,
}

/// A port that asks for values that are younger than any writer can keep them.
#[derive(Clone, Copy, Debug)]
pub(super) struct TooStrict {
    /// The port that reads.
    pub(super) reader: Port,
    /// How old a value may be, in microseconds.
    pub(super) within_us: u32,
    /// The writer that writes most often.
    pub(super) writer: Port,
    /// Its period in microseconds.
    pub(super) period_us: u32,
}

/// What gets old in a set of files.
#[derive(Default)]
pub(super) struct Found {
    /// For each state at most one, in the order of states.
    pub(super) staying: Vec<Staying>,
    /// For each port of a task state at most one, in the order of states and ports.
    pub(super) too_strict: Vec<TooStrict>,
}

/// What is known of the states of one net.
struct Net<'n> {
    /// Ports that write, of states that may be active.
    writers: Vec<&'n Port>,
    /// Ports that take a value however old it is, of states that can be active.
    readers: Vec<&'n Port>,
}

/// Which states of a region are, or have inside, a port of a net; with such a port. Of all regions
/// of all instances, the key's first part.
type Inside<'n> = BTreeMap<(usize, usize), BTreeMap<usize, &'n Port>>;

/// Finds out what gets old. `known` is what can happen in what is known of the set, `possible` what
/// may. `layout` is of the latter.
pub(super) fn find(
    model: &Model,
    known: &Activity,
    possible: &Activity,
    layout: &mut Layout<'_>,
) -> Found {
    let open = layout.open_nets();
    let nets = layout.ports();
    let mut search = Search {
        model,
        known,
        layout,
        staying: BTreeMap::new(),
        steps_left: MAX_STEPS,
    };
    let mut too_strict = BTreeMap::new();
    for ports in nets
        .iter()
        .filter(|(net, _)| !open.contains(net))
        .map(|(_, ports)| ports)
    {
        let declared = |port: &Port| model.tasks.get(port.task)?.data.get(port.port);
        let direction = |port: &Port| declared(port).map(|port| port.direction);
        let within_us = |port: &Port| declared(port).and_then(|port| port.within_us);
        let is_writer = |port: &&Port| {
            direction(port) == Some(Direction::Out) && possible.is_active(port.state)
        };
        let is_reader = |port: &&Port| {
            direction(port).is_some_and(|direction| direction != Direction::Out)
                && known.is_active(port.state)
        };
        let writers: Vec<&Port> = ports.iter().filter(is_writer).collect();
        let readers = || ports.iter().filter(is_reader);
        if let Some((writer, period_us)) = most_often(model, &writers) {
            for &reader in readers() {
                if let Some(within_us) = within_us(&reader).filter(|&within| within < period_us) {
                    let found = TooStrict {
                        reader,
                        within_us,
                        writer,
                        period_us,
                    };
                    too_strict
                        .entry((reader.state, reader.port))
                        .or_insert(found);
                }
            }
        }
        let net = Net {
            writers,
            readers: readers().filter(|port| within_us(port).is_none()).collect(),
        };
        if search.net(&net).is_none() {
            break;
        }
    }
    Found {
        staying: search.staying.into_values().collect(),
        too_strict: too_strict.into_values().collect(),
    }
}

/// The writer whose slot has the shortest period, with that; `None` without one, and where one
/// writes outside of all slots.
fn most_often(model: &Model, writers: &[&Port]) -> Option<(Port, u32)> {
    let mut best: Option<(Port, u32)> = None;
    for &&writer in writers {
        let SlotRef::Slot(slot) = writer.slot else {
            return None;
        };
        let period_us = model.slots.get(slot)?.period_us;
        if best.is_none_or(|(_, least)| period_us < least) {
            best = Some((writer, period_us));
        }
    }
    best
}

struct Search<'s, 'm> {
    model: &'s Model,
    known: &'s Activity,
    layout: &'s Layout<'m>,
    staying: BTreeMap<StateId, Staying>,
    steps_left: usize,
}

impl Search<'_, '_> {
    fn step(&mut self, steps: usize) -> Option<()> {
        self.steps_left = self.steps_left.checked_sub(steps)?;
        Some(())
    }

    /// The states around some ports, their own included.
    fn around<'n>(&mut self, ports: &[&'n Port]) -> Option<Inside<'n>> {
        let mut inside = Inside::new();
        for &port in ports {
            let mut level = Some((port.instance, port.state));
            while let Some((instance, state)) = level {
                self.step(1)?;
                let states = inside.entry((instance, state.region)).or_default();
                if states.contains_key(&state.state) {
                    // So are all around it.
                    break;
                }
                states.insert(state.state, port);
                level = self.layout.instances.get(instance)?.around;
            }
        }
        Some(inside)
    }

    /// A port that can be active together with the states of a region, and is in none of them: one
    /// in another region of the instance, or of one around it.
    fn beside<'n>(
        &mut self,
        inside: &Inside<'n>,
        instance: usize,
        region: usize,
    ) -> Option<Option<&'n Port>> {
        let mut level = Some((instance, region));
        while let Some((instance, region)) = level {
            self.step(1)?;
            let mut regions = inside.range((instance, 0)..=(instance, usize::MAX));
            // No more than one of them is the region itself.
            let other = regions.by_ref().take(2).find(|((_, it), _)| *it != region);
            if let Some((_, states)) = other {
                return Some(states.values().next().copied());
            }
            let around = self.layout.instances.get(instance)?.around;
            level = around.map(|(instance, state)| (instance, state.region));
        }
        Some(None)
    }

    /// Notes the states in which a value stays on a net. `None` where that takes too long to find
    /// out.
    fn net(&mut self, net: &Net<'_>) -> Option<()> {
        if net.writers.is_empty() || net.readers.is_empty() {
            return Some(());
        }
        let written = self.around(&net.writers)?;
        let read = self.around(&net.readers)?;
        let is_known: BTreeSet<StateId> = net
            .writers
            .iter()
            .map(|port| port.state)
            .filter(|state| self.known.is_active(*state))
            .collect();
        for (&(instance, region), states) in &written {
            let container = self.layout.instances.get(instance)?.container;
            let Some(declared) = self.model.containers.get(container) else {
                continue;
            };
            let count = declared.regions.get(region).map_or(0, |it| it.states.len());
            if states.len() == count {
                continue;
            }
            let Some(writer) = states
                .iter()
                .find(|(_, port)| is_known.contains(&port.state))
            else {
                continue;
            };
            if self.beside(&written, instance, region)?.is_some() {
                continue;
            }
            let Some(reader) = self.beside(&read, instance, region)? else {
                continue;
            };
            self.step(count)?;
            for state in (0..count).filter(|state| !states.contains_key(state)) {
                let id = |state| StateId {
                    container,
                    region,
                    state,
                };
                if self.known.is_active(id(state)) {
                    self.staying.entry(id(state)).or_insert(Staying {
                        state: id(state),
                        writer: id(*writer.0),
                        reader: *reader,
                    });
                }
            }
        }
        Some(())
    }
}
