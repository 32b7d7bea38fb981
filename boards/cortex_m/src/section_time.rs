//! How long the longest critical section was, by the time that [`sys_tick`] counts.
//!
//! A section delays what is below the slots: the line, the link, background tasks. Slots interrupt
//! it, and take their own time: a section in which one did is not measured.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use crate::sys_tick;

/// When the outermost section began, and how often the clock had been moved then, which each slot
/// does. Of whoever is in the section, which nobody else enters meanwhile.
static BEGUN_TICKS: AtomicU32 = AtomicU32::new(0);
static BEGUN_MOVES: AtomicU32 = AtomicU32::new(0);
/// The longest, in ticks.
static LONGEST_TICKS: AtomicU32 = AtomicU32::new(0);

/// The outermost section has begun.
pub(crate) fn begin() {
    BEGUN_MOVES.store(sys_tick::moves(), Relaxed);
    BEGUN_TICKS.store(sys_tick::count(), Relaxed);
}

/// The outermost section is about to end.
pub(crate) fn end() {
    let ticks = sys_tick::count().wrapping_sub(BEGUN_TICKS.load(Relaxed)) & sys_tick::MAX;
    if sys_tick::moves() == BEGUN_MOVES.load(Relaxed) && ticks > LONGEST_TICKS.load(Relaxed) {
        LONGEST_TICKS.store(ticks, Relaxed);
    }
}

/// The longest since the start, in nanoseconds, of a clock with so many ticks in a microsecond.
pub fn longest_ns(ticks_per_us: u32) -> u32 {
    let ns = u64::from(LONGEST_TICKS.load(Relaxed)) * 1_000 / u64::from(ticks_per_us.max(1));
    u32::try_from(ns).unwrap_or(u32::MAX - 1)
}
