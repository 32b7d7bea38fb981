//! How much memory a mission's machine needs.

use core::ops::Deref;

use crate::interpreter::ArenaLayout;
use crate::verify::Verified;

impl<B: Deref<Target = [u8]>> Verified<B> {
    /// 32-bit words that [`Interpreter::new`](crate::Interpreter::new) needs: one and a half and two bits for each
    /// region instance, a bit for each flag and each task instance, and half a word for each place in the queue.
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
