//! The mask of interrupts, which is the core's.

use std::sync::atomic::{AtomicBool, Ordering::SeqCst};

static MASKED: AtomicBool = AtomicBool::new(false);

/// Whether interrupts are masked.
pub fn is_masked() -> bool {
    MASKED.load(SeqCst)
}

/// Does something while they are.
pub fn free<T>(act: impl FnOnce(&()) -> T) -> T {
    MASKED.store(true, SeqCst);
    let done = act(&());
    MASKED.store(false, SeqCst);
    done
}
