//! The memory of a machine: words that its owner lends it, and how they are divided.

use core::ops::Deref;

use crate::tables::Tables;
use crate::verify::Verified;

pub(crate) const WORD_BITS: usize = u32::BITS as usize;

/// How the arena is divided: the word at which each part begins. The parts stand in this order.
///
/// The current states come first, two a word, the one of the lower region instance in the low half.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ArenaLayout {
    /// Numbers of region instances and of task instances.
    pub(crate) regions: usize,
    pub(crate) tasks: usize,
    /// For each 32 region instances a word that says who is active, and one that says who is awake.
    pub(crate) active: usize,
    /// All flags, the first in the lowest bit.
    pub(crate) flags: usize,
    /// Bits of the words with flags.
    pub(crate) flag_bits: usize,
    /// The enable bits of the task instances, the first in the lowest bit.
    pub(crate) enabled: usize,
    /// For each region instance the low 32 bits of the number of the macro step in which its state
    /// was entered, if that has a timeout.
    pub(crate) entered: usize,
    /// The channels of events that wait, two a word.
    pub(crate) queue: usize,
    pub(crate) end: usize,
}

impl ArenaLayout {
    pub(crate) fn of(tables: &Tables<'_>) -> Self {
        Self::new(
            tables.region_instance_count(),
            tables.task_instance_count(),
            tables.flag_count(),
            tables.queue_capacity(),
        )
    }

    pub(crate) fn new(
        regions: usize,
        tasks: usize,
        flag_count: usize,
        queue_capacity: usize,
    ) -> Self {
        let active = regions.div_ceil(2);
        let flags = active + 2 * words_for(regions);
        let enabled = flags + words_for(flag_count);
        let entered = enabled + words_for(tasks);
        let queue = entered + regions;
        let end = queue + queue_words(queue_capacity);
        Self {
            regions,
            tasks,
            active,
            flags,
            flag_bits: WORD_BITS * (enabled - flags),
            enabled,
            entered,
            queue,
            end,
        }
    }

    /// Words of the whole arena.
    pub(crate) fn words(&self) -> usize {
        self.end
    }
}

/// Words that have so many bits. There are less than a carry would take, which a division that
/// rounds up would have to think of.
fn words_for(bits: usize) -> usize {
    (bits + (WORD_BITS - 1)) >> WORD_BITS.trailing_zeros()
}

/// Words of the event queue, of two places each: a power of two, so that going round is cheap.
fn queue_words(capacity: usize) -> usize {
    // One place has a word of its own, as two have.
    let last = capacity.wrapping_sub(1) | 1;
    (usize::MAX / 2 + 1) >> last.leading_zeros()
}

impl<B: Deref<Target = [u8]>> Verified<B> {
    /// 32-bit words that [`Interpreter::new`](crate::Interpreter::new) needs: one and a half and
    /// two bits for each region instance, a bit for each flag and each task instance, and half a
    /// word for each place in the queue.
    #[must_use]
    pub fn arena_words(&self) -> usize {
        ArenaLayout::of(&self.tables()).words()
    }

    /// [`Self::arena_words`] in bytes.
    #[must_use]
    pub fn ram_bytes(&self) -> usize {
        self.arena_words() * size_of::<u32>()
    }
}
