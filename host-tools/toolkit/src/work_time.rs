//! Time that work is measured with.

use std::time::Duration;

use nix::time::{ClockId, clock_gettime};

/// Processor time that this thread has taken so far. A machine that is loaded, or stands still for
/// a while, makes work last longer, and does not make it more: so what is limited by this ends at
/// the same place on both.
pub(crate) fn taken() -> Duration {
    // Every thread has this clock.
    clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID).map_or(Duration::ZERO, Duration::from)
}
