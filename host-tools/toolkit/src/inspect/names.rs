//! The name of everything in a blob, from its name table, or made up where that was left out.

use esm_core::Verified;
use esm_core::tables::{StateKind, Tables};

use crate::trace::directory::Numbered;

/// Names by index in the tables.
pub(super) struct Names {
    /// Whether they come from the blob.
    pub are_original: bool,
    /// By number; the first is the pulse.
    pub events: Vec<String>,
    pub containers: Vec<String>,
    /// Control flags by container.
    pub flags: Vec<Vec<String>>,
    pub regions: Vec<String>,
    pub states: Vec<String>,
    /// Exclusive groups.
    pub groups: Vec<String>,
}

impl Names {
    pub(super) fn of(blob: &Verified<Vec<u8>>) -> Self {
        let tables = blob.tables();
        let mut table = tables.names();
        let are_original = table.is_some();
        let mut numbered = Numbered::default();
        let mut next = |kind| match table.as_mut().and_then(Iterator::next) {
            Some(name) => String::from_utf8_lossy(name).into_owned(),
            None => numbered.next(kind),
        };
        let mut names = Self {
            are_original,
            events: vec!["pulse".to_owned()],
            containers: Vec::new(),
            flags: Vec::new(),
            regions: Vec::new(),
            states: Vec::new(),
            groups: Vec::new(),
        };
        names
            .events
            .extend((0..tables.event_count()).map(|_| next(Numbered::EVENT)));
        for (index, container) in tables.containers().enumerate() {
            names.containers.push(next(match index {
                0 => Numbered::MACHINE,
                _ => Numbered::CONTAINER,
            }));
            let flags = (0..container.flags).map(|_| next(Numbered::FLAG)).collect();
            names.flags.push(flags);
            let inside = container.first_region..tables.regions().len();
            let inside = inside.map_while(|region| tables.region(region));
            for region in inside.take_while(|region| region.container == index) {
                names.regions.push(next(Numbered::REGION));
                names.add_states(&tables, region.first_state, &mut next);
            }
        }
        let groups = (0..tables.exclusive_group_count()).map(|_| next(Numbered::GROUP));
        names.groups.extend(groups);
        names
    }

    /// The states of one region, from `initial` to `final`.
    fn add_states(
        &mut self,
        tables: &Tables<'_>,
        first: usize,
        next: &mut impl FnMut(&'static str) -> String,
    ) {
        for state in (first..tables.state_count()).filter_map(|index| tables.state(index)) {
            match state.kind {
                StateKind::Initial => self.states.push("initial".to_owned()),
                StateKind::Final => {
                    self.states.push("final".to_owned());
                    return;
                }
                _ => self.states.push(next(Numbered::STATE)),
            }
        }
    }

    /// A name by index; empty outside the list, which a verified blob never asks for.
    pub(super) fn get(list: &[String], index: usize) -> &str {
        list.get(index).map_or("", String::as_str)
    }
}
