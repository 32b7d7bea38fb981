//! Records under test, and what is found wrong with them.

use core::ops::Deref;

use crate::format::Section;
use crate::layout::Record;
use crate::refusal::{Cause, Refusal};

/// What is wrong with one record.
#[derive(Clone, Copy)]
pub(super) struct Finding {
    section: Section,
    index: u16,
    cause: Cause,
}

impl Finding {
    /// A finding about a record that need not exist.
    pub(super) fn new(section: Section, index: usize, cause: Cause) -> Self {
        let index = index as u16;
        Self {
            section,
            index,
            cause,
        }
    }
}

impl From<Finding> for Refusal {
    fn from(
        Finding {
            section,
            index,
            cause,
        }: Finding,
    ) -> Self {
        Self::Record {
            section,
            index,
            cause,
        }
    }
}

/// A record with its number, by which findings name it.
pub(super) struct Entry<'a, T> {
    pub(super) record: &'a T,
    pub(super) index: usize,
}

impl<T> Deref for Entry<'_, T> {
    type Target = T;

    #[cfg_attr(feature = "speed", inline(always))]
    fn deref(&self) -> &T {
        self.record
    }
}

impl<T: Record> Entry<'_, T> {
    /// Finds the record wrong unless a rule holds.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn ensure(&self, holds: bool, cause: Cause) -> Result<(), Finding> {
        if holds {
            Ok(())
        } else {
            Err(Finding::new(T::SECTION, self.index, cause))
        }
    }
}

/// The record with a number. Where there is none, its absence has this cause.
#[cfg_attr(feature = "speed", inline(always))]
pub(super) fn entry<T: Record>(
    records: &[T],
    index: usize,
    cause: Cause,
) -> Result<Entry<'_, T>, Finding> {
    match records.get(index) {
        Some(record) => Ok(Entry { record, index }),
        None => Err(Finding::new(T::SECTION, index, cause)),
    }
}

/// All records of a table.
#[cfg_attr(feature = "speed", inline(always))]
pub(super) fn entries<T>(records: &[T]) -> impl Iterator<Item = Entry<'_, T>> {
    let records = records.iter().enumerate();
    records.map(|(index, record)| Entry { record, index })
}
