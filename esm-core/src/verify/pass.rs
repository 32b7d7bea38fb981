//! What the whole check has at hand: the tables of a blob, and how far it has come in them.

use core::ops::{Index, IndexMut, Range};

use super::finding::{Entry, Finding};
use crate::format::Section;
use crate::layout::Record;
use crate::refusal::Cause;
use crate::tables::Tables;

/// The check of a blob. Each module beside this one has some of its steps.
pub(super) struct Pass<'a> {
    pub(super) tables: Tables<'a>,
    pub(super) checked: Checked,
    /// State instances that were checked.
    pub(super) state_instances: usize,
}

impl<'a> Pass<'a> {
    pub(super) fn of(tables: Tables<'a>) -> Self {
        Self {
            tables,
            checked: Checked::default(),
            state_instances: 0,
        }
    }

    /// The record with a number. Where there is none, its absence has this cause.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn entry<T: Record>(
        &self,
        index: usize,
        cause: Cause,
    ) -> Result<Entry<'a, T>, Finding> {
        match self.tables.record(index) {
            Some(record) => Ok(Entry { record, index }),
            None => Err(Finding::new(T::SECTION, index, cause)),
        }
    }

    /// The first record of a table that was not checked, which counts as checked from now on.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn next<T: Record>(&mut self, absent: Cause) -> Result<Entry<'a, T>, Finding> {
        let entry = self.entry(self.checked[T::SECTION], absent)?;
        self.checked[T::SECTION] += 1;
        Ok(entry)
    }

    /// Numbers of all records of a table.
    pub(super) fn numbers(&self, section: Section) -> Range<usize> {
        0..self.tables.count(section)
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
