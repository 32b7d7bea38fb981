//! An emergency stop: latched at once for the real-time side, and kept across resets.

use core::sync::atomic::Ordering::Release;

use crate::heartbeats::Heartbeats;
use crate::retained_ram::RetainedRam;

impl Heartbeats {
    /// Lets the real-time side switch the motors off before it next exchanges anything with the
    /// body, and after each reset. Whoever wants that has counted the wish before.
    pub(crate) fn latch_emergency_stop(&self, kept: Option<&RetainedRam>) {
        if let Some(kept) = kept {
            kept.set_emergency_stop(true);
        }
        preemptible!();
        self.emergency_stop.store(true, Release);
        self.stops.call();
    }
}
