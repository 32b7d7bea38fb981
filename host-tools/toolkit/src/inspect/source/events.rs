//! Which events each container lists, and how, from what the blob says of those who listen.
//!
//! A blob has no lists of events: it has, for each instance and each event sent there, the region
//! instances that listen. There is one way through the tree from the sender to each of them, up and
//! then down: on the way up each container must list the event as `out event`, on the way down as
//! `in event`. That is all that comes back. Every list that makes the event heard by all who listen
//! has at least these, so whoever else could hear it by these lists alone would listen according to
//! the blob, too.
//!
//! Events that a container only sends or receives are local to it. The order of the lists is that
//! of the events' numbers, which is the order in which a mission names them first; an event that
//! nothing uses is listed where its number needs it.

use std::collections::{BTreeSet, HashMap, HashSet};

use esm_core::format::PULSE;
use esm_core::tables::{Channel, StateKind, Tables};

use super::tree::Tree;
use super::{NoSource, Reader};

/// Looking at more places where somebody may listen to an event takes too long.
const MAX_STEPS: usize = 1 << 27;

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
/// If that would take too long.
pub(super) fn lists(reader: &Reader<'_>, tree: &Tree) -> Result<Vec<Vec<Listed>>, NoSource> {
    let tables = &reader.tables;
    let forwarding = Forwarding::of(tables, tree)?;
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
                is_in: forwarding.inward.contains(&(container, event)),
                is_out: forwarding.outward.contains(&(container, event)),
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
        for (container, event) in direction {
            need(*container, *event);
        }
    }
    needed
}

/// What containers must pass on: pairs of container and event.
struct Forwarding<'t> {
    tables: &'t Tables<'t>,
    tree: &'t Tree,
    inward: HashSet<(usize, usize)>,
    outward: HashSet<(usize, usize)>,
    steps: usize,
}

/// Those who listen to an event, whoever sends it.
struct Row {
    /// The first instance that sends to them.
    first_sender: usize,
    /// Their instances, ascending.
    listeners: Vec<usize>,
}

impl Row {
    /// Whether somebody inside an instance listens, at any depth.
    fn reaches_into(&self, tree: &Tree, instance: usize) -> bool {
        let from = self.listeners.partition_point(|it| *it < instance);
        let first = self.listeners.get(from);
        first.is_some_and(|first| tree.holds(instance, *first))
    }

    /// Whether somebody outside of an instance listens.
    fn reaches_beyond(&self, tree: &Tree, instance: usize) -> bool {
        let ends = [self.listeners.first(), self.listeners.last()];
        ends.into_iter()
            .flatten()
            .any(|end| !tree.holds(instance, *end))
    }
}

impl<'t> Forwarding<'t> {
    fn of(tables: &'t Tables<'t>, tree: &'t Tree) -> Result<Self, NoSource> {
        let mut forwarding = Self {
            tables,
            tree,
            inward: HashSet::new(),
            outward: HashSet::new(),
            steps: 0,
        };
        // The same row belongs to many senders, and is looked through for the first.
        let mut rows: HashMap<_, Row> = HashMap::new();
        for (sender, instance) in tree.instances.iter().enumerate() {
            let channels = tables
                .container(instance.container)
                .map_or(0, |container| container.channels);
            for index in instance.first_channel..instance.first_channel + channels {
                let Some(channel) = tables.channel(index) else {
                    continue;
                };
                let event = usize::from(channel.event);
                let place = (
                    channel.event,
                    channel.first_row_word,
                    channel.first_region_word,
                    channel.region_words,
                );
                match rows.get(&place) {
                    Some(row) => {
                        forwarding.look_up(sender, event, row)?;
                        forwarding.look_between(sender, event, row)?;
                    }
                    None => {
                        let row = Row {
                            first_sender: sender,
                            listeners: forwarding.listeners(&channel)?,
                        };
                        forwarding.look_up(sender, event, &row)?;
                        forwarding.look_down(sender, event, &row)?;
                        rows.insert(place, row);
                    }
                }
            }
        }
        Ok(forwarding)
    }

    /// The instances of the regions that listen to a channel.
    fn listeners(&mut self, channel: &Channel) -> Result<Vec<usize>, NoSource> {
        const WORD_BITS: usize = u32::BITS as usize;
        let first = WORD_BITS * channel.first_region_word;
        let mut instances = BTreeSet::new();
        for region in first..first + WORD_BITS * channel.region_words {
            self.step()?;
            if self.tables.is_listening(channel, region)
                && let Some(region) = self.tables.region_instance(region)
            {
                instances.insert(region.instance);
            }
        }
        Ok(instances.into_iter().collect())
    }

    /// From the sender up, as long as somebody beyond listens.
    fn look_up(&mut self, sender: usize, event: usize, row: &Row) -> Result<(), NoSource> {
        let mut at = sender;
        while at > 0 && row.reaches_beyond(self.tree, at) {
            self.step()?;
            self.outward.insert((self.tree.container(at), event));
            at = self.tree.around(at);
        }
        Ok(())
    }

    /// From all who listen up to what is around the sender, too.
    fn look_down(&mut self, sender: usize, event: usize, row: &Row) -> Result<(), NoSource> {
        let mut seen = HashSet::new();
        for listener in &row.listeners {
            let mut at = *listener;
            while !self.tree.holds(at, sender) && seen.insert(at) {
                self.step()?;
                self.inward.insert((self.tree.container(at), event));
                at = self.tree.around(at);
            }
        }
        Ok(())
    }

    /// Down the way from which the first sender of the row sent, which was no way down for that
    /// one.
    fn look_between(&mut self, sender: usize, event: usize, row: &Row) -> Result<(), NoSource> {
        let mut at = row.first_sender;
        while !self.tree.holds(at, sender) {
            self.step()?;
            if row.reaches_into(self.tree, at) {
                self.inward.insert((self.tree.container(at), event));
            }
            at = self.tree.around(at);
        }
        Ok(())
    }

    fn step(&mut self) -> Result<(), NoSource> {
        self.steps += 1;
        if self.steps <= MAX_STEPS {
            Ok(())
        } else {
            Err(NoSource::TooMuch {
                what: "steps through the instances that listen to an event",
                limit: MAX_STEPS,
            })
        }
    }
}
