//! Where events are visible: for each instance and each event that it sends, the set of instances that see it.

use std::collections::{BTreeSet, HashMap, HashSet};

use esm_core::format::CHANNEL_NO_BITS;

use super::instances::Tree;
use super::layout::Layout;
use super::{Capacity, CompileError, Table, within};
use crate::model::Model;

/// The tables of events.
#[derive(Default)]
pub(super) struct Channels {
    pub channels: Table,
    pub visibility: Vec<u8>,
}

/// A window of instances, with a bit for each that sees the event where not all do.
#[derive(Clone, Copy)]
struct Window {
    first: usize,
    count: usize,
    bits: u32,
}

/// Visibility bits are as many as instances squared at worst; a blob with more than this is not meant seriously.
const MAX_VISIBILITY_BYTES: usize = 1 << 24;

/// Works out the visibility of all events.
struct Visibility<'a> {
    tree: &'a Tree,
    /// Pairs of container number and event that the container lists as `in event`.
    forwarded_in: HashSet<(usize, usize)>,
    /// The same for `out event`.
    forwarded_out: HashSet<(usize, usize)>,
    /// Windows by sender and event.
    windows: HashMap<(usize, usize), Window>,
    /// Where equal bits already are.
    rows: HashMap<Vec<u8>, u32>,
    bits: Vec<u8>,
}

/// Writes the channels of all instances.
pub(super) fn write(model: &Model, layout: &Layout, tree: &Tree) -> Result<Channels, CompileError> {
    let mut visibility = Visibility {
        tree,
        forwarded_in: HashSet::new(),
        forwarded_out: HashSet::new(),
        windows: HashMap::new(),
        rows: HashMap::new(),
        bits: Vec::new(),
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
    }
    let mut channels = Table::default();
    for (index, instance) in tree.instances.iter().enumerate() {
        for event in &layout.containers[instance.container].sent {
            let window = visibility.window(index, *event)?;
            let number = layout.event_numbers.get(event).copied().unwrap_or(0);
            channels.words([number, window.first, window.count]);
            channels.longs([window.bits]);
        }
    }
    Ok(Channels {
        channels,
        visibility: visibility.bits,
    })
}

impl Visibility<'_> {
    /// Who sees an event that is sent in an instance.
    fn window(&mut self, sender: usize, event: usize) -> Result<Window, CompileError> {
        // Up as far as the event is forwarded. Where it would come down the same way again, the instance above sees it with the same ones: one
        // set for both.
        let mut owner = sender;
        while self.goes_up(owner, event) && self.goes_down(owner, event) {
            owner = self.tree.instances[owner].around;
        }
        if let Some(window) = self.windows.get(&(owner, event)) {
            return Ok(*window);
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
        let window = self.write_window(&seen, owner)?;
        self.windows.insert((owner, event), window);
        Ok(window)
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

    fn write_window(
        &mut self,
        seen: &BTreeSet<usize>,
        sender: usize,
    ) -> Result<Window, CompileError> {
        let first = seen.first().copied().unwrap_or(sender);
        let last = seen.last().copied().unwrap_or(sender);
        let count = last - first + 1;
        if count == seen.len() {
            return Ok(Window {
                first,
                count,
                bits: CHANNEL_NO_BITS,
            });
        }
        let mut row = vec![0_u8; count.div_ceil(8)];
        for instance in seen {
            let offset = instance - first;
            row[offset / 8] |= 1 << (offset % 8);
        }
        let start = self.bits.len();
        let bits = match self.rows.get(&row) {
            Some(bits) => *bits,
            None => {
                within(
                    Capacity::VisibilityBytes,
                    start + row.len(),
                    MAX_VISIBILITY_BYTES,
                )?;
                self.bits.extend_from_slice(&row);
                self.rows.insert(row, start as u32);
                start as u32
            }
        };
        Ok(Window { first, count, bits })
    }
}
