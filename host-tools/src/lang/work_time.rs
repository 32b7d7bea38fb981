//! Time that tests measure work with.

use std::time::Duration;

use nix::time::{ClockId, clock_gettime};

/// Processor time that this thread has taken so far: a loaded machine makes work last longer, and does not make it more.
pub(super) fn taken() -> Duration {
    Duration::from(
        clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID).expect("every thread has a clock"),
    )
}
