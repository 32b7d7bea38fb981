//! Records under test, and what is found wrong with them.

use core::num::NonZeroU32;
use core::ops::Deref;

use crate::format::Section;
use crate::layout::Record;
use crate::refusal::{Cause, Refusal};

/// What is wrong with one record, in one word: checks have it in a register, and hand it on with a
/// comparison with 0. The position stands above the section, and that above the cause.
#[derive(Clone, Copy)]
pub(super) struct Finding(NonZeroU32);

impl Finding {
    const SECTION_SHIFT: u32 = u8::BITS;
    const INDEX_SHIFT: u32 = 2 * u8::BITS;

    /// A finding about a record that need not exist.
    pub(super) fn new(section: Section, index: usize, cause: Cause) -> Self {
        let section = (section as u32) << Self::SECTION_SHIFT;
        let index = (index as u32) << Self::INDEX_SHIFT;
        Self(cause.number() | section | index)
    }
}

impl From<Finding> for Refusal {
    fn from(Finding(word): Finding) -> Self {
        let [cause, section, ..] = word.get().to_le_bytes();
        Self::Record {
            section: Section::with_number(section),
            index: (word.get() >> Finding::INDEX_SHIFT) as u16,
            cause: Cause::with_number(cause),
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
