//! Who listens to events: for each instance and each event that it sends, the region instances that
//! see the event and have a transition on it.

use std::collections::{BTreeSet, HashMap, HashSet};

use esm_core::layout::{Channel, Listener, Short};

use super::instances::Tree;
use super::layout::Layout;
use super::{Capacity, CompileError, MAX_RECORDS, Table, within};
use crate::model::{Model, Region, Trigger};

/// The tables of events.
#[derive(Default)]
pub(super) struct Channels {
    pub channels: Table,
    pub listeners: Table,
}

/// Where the bits of those who listen are: region instances 32 a word, the first of a word in its
/// highest bit.
#[derive(Clone, Copy, Default)]
struct Row {
    /// First word in the table.
    first_word: usize,
    /// The word of region instances that it is for.
    first_region_word: usize,
    words: usize,
}

const WORD_BITS: usize = u32::BITS as usize;

/// Works out the visibility of all events.
struct Visibility<'a> {
    tree: &'a Tree,
    /// Pairs of container number and event that the container lists as `in event`.
    forwarded_in: HashSet<(usize, usize)>,
    /// The same for `out event`.
    forwarded_out: HashSet<(usize, usize)>,
    /// Pairs of container number and event with the places of the regions that have transitions on
    /// it.
    receivers: HashMap<(usize, usize), Vec<usize>>,
    /// Rows by sender and event.
    rows: HashMap<(usize, usize), Row>,
    /// Where equal words already are.
    places: HashMap<Vec<u32>, usize>,
    listeners: Table,
}

/// Writes the channels of all instances.
pub(super) fn write(model: &Model, layout: &Layout, tree: &Tree) -> Result<Channels, CompileError> {
    let mut visibility = Visibility {
        tree,
        forwarded_in: HashSet::new(),
        forwarded_out: HashSet::new(),
        receivers: HashMap::new(),
        rows: HashMap::new(),
        places: HashMap::new(),
        listeners: Table::default(),
    };
    for (number, (_, declared)) in layout.with_models(model).enumerate() {
        for event in &declared.events {
            if event.forwarded_in {
                visibility.forwarded_in.insert((number, event.event));
            }
            if event.forwarded_out {
                visibility.forwarded_out.insert((number, event.event));
            }
        }
        for (place, region) in declared.regions.iter().enumerate() {
            for event in received(region) {
                let receivers = visibility.receivers.entry((number, event));
                receivers.or_default().push(place);
            }
        }
    }
    let mut channels = Table::default();
    for (index, instance) in tree.instances.iter().enumerate() {
        for event in &layout.containers[instance.container].sent {
            let row = visibility.row(index, *event)?;
            let number = layout.event_numbers.get(event).copied().unwrap_or(0);
            channels.push(Channel {
                event: (number as u16).into(),
                first_row_word: Short::new(row.first_word),
                first_region_word: Short::new(row.first_region_word),
                region_words: Short::new(row.words),
            });
        }
    }
    Ok(Channels {
        channels,
        listeners: visibility.listeners,
    })
}

/// The events that a region has transitions on, each once.
fn received(region: &Region) -> BTreeSet<usize> {
    let triggers = region.transitions.iter().map(|it| it.trigger);
    triggers
        .filter_map(|trigger| match trigger {
            Trigger::Event(event) => Some(event),
            Trigger::Pulse | Trigger::Star => None,
        })
        .collect()
}

impl Visibility<'_> {
    /// Who listens to an event that is sent in an instance.
    fn row(&mut self, sender: usize, event: usize) -> Result<Row, CompileError> {
        // Up as far as the event is forwarded. Where it would come down the same way again, the
        // instance above sees it with the same ones: one set for both.
        let mut owner = sender;
        while self.goes_up(owner, event) && self.goes_down(owner, event) {
            owner = self.tree.instances[owner].around;
        }
        if let Some(row) = self.rows.get(&(owner, event)) {
            return Ok(*row);
        }
        let mut seen = BTreeSet::from([owner]);
        let mut open = vec![owner];
        let mut above = owner;
        while self.goes_up(above, event) {
            above = self.tree.instances[above].around;
            seen.insert(above);
            open.push(above);
        }
        while let Some(instance) = open.pop() {
            for (_, inside) in &self.tree.instances[instance].inside {
                if self.goes_down(*inside, event) && seen.insert(*inside) {
                    open.push(*inside);
                }
            }
        }
        let row = self.write_row(&self.listeners_among(&seen, event))?;
        self.rows.insert((owner, event), row);
        Ok(row)
    }

    /// Whether an event is visible around an instance that it is visible in.
    fn goes_up(&self, instance: usize, event: usize) -> bool {
        let container = self.tree.instances[instance].container;
        instance != 0 && self.forwarded_out.contains(&(container, event))
    }

    /// Whether an event is visible in an instance that it is visible around.
    fn goes_down(&self, instance: usize, event: usize) -> bool {
        let container = self.tree.instances[instance].container;
        self.forwarded_in.contains(&(container, event))
    }

    /// The region instances that have transitions on an event, of the instances that see it.
    fn listeners_among(&self, seen: &BTreeSet<usize>, event: usize) -> Vec<usize> {
        let mut listeners = Vec::new();
        for instance in seen.iter().map(|seen| &self.tree.instances[*seen]) {
            let places = self.receivers.get(&(instance.container, event));
            let regions = places.into_iter().flatten();
            listeners.extend(regions.map(|place| instance.regions[*place]));
        }
        listeners
    }

    fn write_row(&mut self, listeners: &[usize]) -> Result<Row, CompileError> {
        let (Some(first), Some(last)) = (listeners.iter().min(), listeners.iter().max()) else {
            return Ok(Row::default());
        };
        let first_region_word = first / WORD_BITS;
        let mut words = vec![0_u32; last / WORD_BITS - first_region_word + 1];
        for region in listeners {
            let highest = 1 << (WORD_BITS - 1);
            words[region / WORD_BITS - first_region_word] |= highest >> (region % WORD_BITS);
        }
        let count = words.len();
        let next = self.listeners.bytes.len() / size_of::<u32>();
        let first_word = match self.places.get(&words) {
            Some(place) => *place,
            None => {
                within(Capacity::ListenerWords, next + count, MAX_RECORDS)?;
                for word in &words {
                    self.listeners.push(Listener {
                        regions: (*word).into(),
                    });
                }
                self.places.insert(words, next);
                next
            }
        };
        Ok(Row {
            first_word,
            first_region_word,
            words: count,
        })
    }
}
