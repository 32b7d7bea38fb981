//! What the whole check has at hand: all tables of a blob, and how far it has come in them.

use core::ops::{Index, IndexMut};

use crate::format::Section;
use crate::layout::{
    Channel, Code, Connection, Container, Instance, Listener, Mask, Mission, Region,
    RegionInstance, Slot, State, Task, TaskInstance, TaskState, Timer, Transition,
};
use crate::tables::Tables;

/// The check of a blob. Each module beside this one has some of its steps.
pub(super) struct Pass<'a> {
    pub(super) records: Records<'a>,
    pub(super) checked: Checked,
    /// State instances that were checked.
    pub(super) state_instances: usize,
}

impl<'a> Pass<'a> {
    pub(super) fn of(tables: &Tables<'a>) -> Self {
        Self {
            records: Records::of(tables),
            checked: Checked::default(),
            state_instances: 0,
        }
    }
}

/// The records of all tables with rules of their own.
pub(super) struct Records<'a> {
    pub(super) mission: &'a [Mission],
    pub(super) slots: &'a [Slot],
    pub(super) containers: &'a [Container],
    pub(super) regions: &'a [Region],
    pub(super) states: &'a [State],
    pub(super) transitions: &'a [Transition],
    pub(super) code: &'a [Code],
    /// The same records as [`Self::code`], some of which are masks.
    pub(super) masks: &'a [Mask],
    pub(super) timers: &'a [Timer],
    pub(super) instances: &'a [Instance],
    pub(super) region_instances: &'a [RegionInstance],
    pub(super) channels: &'a [Channel],
    pub(super) listeners: &'a [Listener],
    pub(super) tasks: &'a [Task],
    pub(super) task_states: &'a [TaskState],
    pub(super) task_instances: &'a [TaskInstance],
    pub(super) connections: &'a [Connection],
}

impl<'a> Records<'a> {
    fn of(tables: &Tables<'a>) -> Self {
        Self {
            mission: tables.records(),
            slots: tables.records(),
            containers: tables.records(),
            regions: tables.records(),
            states: tables.records(),
            transitions: tables.records(),
            code: tables.records(),
            masks: tables.records(),
            timers: tables.records(),
            instances: tables.records(),
            region_instances: tables.records(),
            channels: tables.records(),
            listeners: tables.records(),
            tasks: tables.records(),
            task_states: tables.records(),
            task_instances: tables.records(),
            connections: tables.records(),
        }
    }
}

/// How many records of each section were checked: the parts of what comes next begin there.
#[derive(Default)]
pub(super) struct Checked([usize; Section::ALL.len()]);

impl Index<Section> for Checked {
    type Output = usize;

    #[cfg_attr(feature = "speed", inline(always))]
    fn index(&self, section: Section) -> &usize {
        &self.0[section as usize]
    }
}

impl IndexMut<Section> for Checked {
    #[cfg_attr(feature = "speed", inline(always))]
    fn index_mut(&mut self, section: Section) -> &mut usize {
        &mut self.0[section as usize]
    }
}
