//! Which events each container lists, and how, from what the blob says of their visibility.
//!
//! A blob has no lists of events: it has, for each instance and each event sent there, the set of instances that see it. But that set says all that is to
//! be known. Above the sender, each instance that sees the event proves that the container below it lists it as `out event`, and the first that does not
//! proves the opposite. Beside and below, an instance whose surroundings see the event sees it exactly if its container lists it as `in event`. What no set
//! decides, no sender can reach, and is left out.
//!
//! Events that a container only sends or receives are local to it. The order of the lists is that of the events' numbers, which is the order in which a
//! mission names them first; an event that nothing uses is listed where its number needs it.

use std::collections::{BTreeSet, HashMap};

use esm_core::format::PULSE;
use esm_core::tables::{Channel, StateKind, Tables};

use super::tree::Tree;
use super::{NoSource, Reader};
use crate::inspect::names::Names;

/// Looking at more places where an event may be visible takes too long.
const MAX_VISIBILITY_STEPS: usize = 1 << 27;

/// An event as a container lists it; local where it is neither.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Listed {
    /// Its number.
    pub(super) event: usize,
    /// `in event`
    pub(super) is_in: bool,
    /// `out event`
    pub(super) is_out: bool,
}

/// The lists of all containers.
///
/// # Errors
/// If no lists give the visibility that the blob has.
pub(super) fn lists(reader: &Reader<'_>, tree: &Tree) -> Result<Vec<Vec<Listed>>, NoSource> {
    let tables = &reader.tables;
    let forwarding = Forwarding::of(tables, tree).map_err(|stop| stop.explained(reader))?;
    let mut next = 1;
    let mut lists = Vec::with_capacity(tables.containers().len());
    for (container, events) in needed(tables, tree, &forwarding).into_iter().enumerate() {
        let mut list = Vec::with_capacity(events.len());
        for event in events {
            // Events below it that nobody has listed must be listed by now.
            list.extend((next..event).map(local));
            next = next.max(event + 1);
            list.push(Listed {
                event,
                is_in: forwarding.inward.get(&(container, event)) == Some(&true),
                is_out: forwarding.outward.get(&(container, event)) == Some(&true),
            });
        }
        lists.push(list);
    }
    if let Some(list) = lists.last_mut() {
        list.extend((next..=tables.event_count()).map(local));
    }
    Ok(lists)
}

fn local(event: usize) -> Listed {
    Listed {
        event,
        is_in: false,
        is_out: false,
    }
}

/// The events that each container sends, receives or forwards.
fn needed(tables: &Tables<'_>, tree: &Tree, forwarding: &Forwarding<'_>) -> Vec<BTreeSet<usize>> {
    let mut needed = vec![BTreeSet::new(); tables.containers().len()];
    let mut need = |container: usize, event: usize| {
        if let Some(events) = needed.get_mut(container) {
            events.insert(event);
        }
    };
    for (container, described) in tables.containers().enumerate() {
        let first = tree.instances.get(described.first_instance);
        let first_channel = first.map_or(0, |instance| instance.first_channel);
        let channels = first_channel..first_channel + described.channels;
        for channel in channels.filter_map(|channel| tables.channel(channel)) {
            need(container, usize::from(channel.event));
        }
    }
    for region in tables.regions() {
        let states = (region.first_state..).map_while(|state| Some((state, tables.state(state)?)));
        for (state, described) in states {
            for transition in tables.transitions_of(state) {
                match tables.transition(transition) {
                    Some(transition) if transition.event != PULSE => {
                        need(region.container, usize::from(transition.event));
                    }
                    _ => {}
                }
            }
            if described.kind == StateKind::Final {
                break;
            }
        }
    }
    for direction in [&forwarding.inward, &forwarding.outward] {
        for ((container, event), _) in direction.iter().filter(|(_, forwards)| **forwards) {
            need(*container, *event);
        }
    }
    needed
}

/// What the visible sets prove, by container and event.
struct Forwarding<'t> {
    tables: &'t Tables<'t>,
    tree: &'t Tree,
    inward: HashMap<(usize, usize), bool>,
    outward: HashMap<(usize, usize), bool>,
    steps: usize,
}

impl<'t> Forwarding<'t> {
    fn of(tables: &'t Tables<'t>, tree: &'t Tree) -> Result<Self, Stop> {
        let mut forwarding = Self {
            tables,
            tree,
            inward: HashMap::new(),
            outward: HashMap::new(),
            steps: 0,
        };
        // The same set belongs to many senders, and is looked through for the first.
        let mut first_senders = HashMap::new();
        for (sender, instance) in tree.instances.iter().enumerate() {
            let channels = tables
                .container(instance.container)
                .map_or(0, |container| container.channels);
            for index in instance.first_channel..instance.first_channel + channels {
                let Some(channel) = tables.channel(index) else {
                    continue;
                };
                forwarding.look_up(sender, &channel)?;
                let set = (
                    channel.event,
                    channel.first_instance,
                    channel.instances,
                    channel.bits,
                );
                match first_senders.get(&set) {
                    None => {
                        forwarding.look_down(sender, &channel)?;
                        first_senders.insert(set, sender);
                    }
                    Some(first) => forwarding.look_between(*first, sender, &channel)?,
                }
            }
        }
        Ok(forwarding)
    }

    /// From the sender up as far as the event is visible, and one farther.
    fn look_up(&mut self, sender: usize, channel: &Channel) -> Result<(), Stop> {
        let event = usize::from(channel.event);
        ensure(self.tables.is_visible(channel, sender), event)?;
        let mut at = sender;
        while at > 0 {
            let around = self.tree.around(at);
            let goes_up = self.tables.is_visible(channel, around);
            self.step()?;
            prove(&mut self.outward, (self.tree.container(at), event), goes_up)?;
            if !goes_up {
                break;
            }
            at = around;
        }
        Ok(())
    }

    /// Through all that see the event, and what is right inside them.
    fn look_down(&mut self, sender: usize, channel: &Channel) -> Result<(), Stop> {
        let event = usize::from(channel.event);
        let window = channel.first_instance..channel.first_instance + channel.instances;
        for at in window {
            self.step()?;
            if !self.tables.is_visible(channel, at) {
                continue;
            }
            // Nothing but the sender and what is around it can see the event where what is right around does not.
            let is_reached = self.tree.holds(at, sender)
                || self.tables.is_visible(channel, self.tree.around(at));
            ensure(is_reached, event)?;
            for inside in self.tree.inside.get(at).into_iter().flatten() {
                self.step()?;
                if !self.tree.holds(*inside, sender) {
                    let goes_down = self.tables.is_visible(channel, *inside);
                    let container = self.tree.container(*inside);
                    prove(&mut self.inward, (container, event), goes_down)?;
                }
            }
        }
        Ok(())
    }

    /// Down the way from which another sender of the same set sent, which was no way down for that one.
    fn look_between(&mut self, first: usize, sender: usize, channel: &Channel) -> Result<(), Stop> {
        let event = usize::from(channel.event);
        let mut at = first;
        while at > 0 && !self.tree.holds(at, sender) {
            self.step()?;
            let around = self.tree.around(at);
            if self.tables.is_visible(channel, around) {
                let goes_down = self.tables.is_visible(channel, at);
                prove(
                    &mut self.inward,
                    (self.tree.container(at), event),
                    goes_down,
                )?;
            }
            at = around;
        }
        Ok(())
    }

    fn step(&mut self) -> Result<(), Stop> {
        self.steps += 1;
        if self.steps <= MAX_VISIBILITY_STEPS {
            Ok(())
        } else {
            Err(Stop::TooManySteps)
        }
    }
}

/// Why there are no lists.
enum Stop {
    /// Nothing that a container could list makes this event visible as it is.
    Contradiction {
        event: usize,
    },
    TooManySteps,
}

impl Stop {
    fn explained(self, reader: &Reader<'_>) -> NoSource {
        match self {
            Self::Contradiction { event } => NoSource::Visibility {
                event: Names::get(&reader.names.events, event).to_owned(),
            },
            Self::TooManySteps => NoSource::TooMuch {
                what: "steps through the instances that see an event",
                limit: MAX_VISIBILITY_STEPS,
            },
        }
    }
}

fn ensure(holds: bool, event: usize) -> Result<(), Stop> {
    if holds {
        Ok(())
    } else {
        Err(Stop::Contradiction { event })
    }
}

/// Notes what was proved, unless the opposite was.
fn prove(
    known: &mut HashMap<(usize, usize), bool>,
    (container, event): (usize, usize),
    forwards: bool,
) -> Result<(), Stop> {
    let noted = *known.entry((container, event)).or_insert(forwards);
    ensure(noted == forwards, event)
}
