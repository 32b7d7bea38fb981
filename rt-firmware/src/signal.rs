//! A word from another side to the real-time side: there is something to look at.
//!
//! *Invariant:* who sets a signal does so behind all that is to be seen. The real-time side takes
//! it back first, and looks then. So nothing is overlooked, wherever one interrupts the other.

use core::sync::atomic::{
    AtomicBool,
    Ordering::{Relaxed, Release, SeqCst},
    fence,
};

/// Set by anybody, taken back by the real-time side alone.
pub(crate) struct Signal(AtomicBool);

impl Signal {
    pub(crate) const fn new() -> Self {
        Signal(AtomicBool::new(false))
    }

    /// Says that there is something to look at. To be called behind all that is to be seen.
    pub(crate) fn set(&self) {
        preemptible!();
        fence(SeqCst);
        self.0.store(true, Release);
        preemptible!();
    }

    /// Whether it was set. The one look that is taken in each slot.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn is_set(&self) -> bool {
        self.0.load(Relaxed)
    }

    /// Takes it back. For the real-time side, before it looks.
    pub(crate) fn take_back(&self) {
        self.0.store(false, Relaxed);
        fence(SeqCst);
    }
}
