//! What enters a simulated run from outside of virtual time, so that the host board can have the
//! same run again.
//!
//! Two things do: when a task in slot 0 ended (it runs in the time that is left, and how much that
//! is depends on the processor), and when a mission took over from another (its bytes came over a
//! line that has a time of its own). Everything else follows from the missions, the world and the
//! seed.

use crate::recording::file::BackgroundRunEnd;

/// What entered a run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Entered {
    /// The seed of the plant's noise.
    pub seed: u64,
    /// Hashes of the missions, in the order in which they ran.
    pub missions: Vec<u32>,
    /// Robot time of the first macro step of each, in microseconds.
    pub starts_us: Vec<u64>,
    /// Where runs of background tasks ended, in order.
    pub ends: Vec<BackgroundRunEnd>,
}
