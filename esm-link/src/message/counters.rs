//! What a robot counts of slots, of task states and of the frames of links.

use serde::{Deserialize, Serialize};

/// Number of buckets that start delays are counted in.
pub const DELAY_BUCKETS: usize = 8;

/// What was counted of a slot since the mission started. What a reader wants to know of the slot
/// besides (period, duration, start) is in the mission's blob.
///
/// Counters of activations stay at their greatest value once they are there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SlotCounters {
    /// The slot's number in the `.esm` file.
    pub number: u32,
    /// Executions that ended, overruns included, while the mission ran. After a stop and in the
    /// safe state activations begin, and execute nothing.
    pub executed: u32,
    /// Activations that did not start within their period.
    pub missed: u32,
    /// Executions that took longer than the slot's duration; stays at 65,535.
    pub overruns: u32,
    /// Sum of all executions, in nanoseconds. It stands still where `executed` does.
    pub total_execution_ns: u64,
    /// Shortest execution, in nanoseconds.
    pub min_execution_ns: u32,
    /// Longest execution, in nanoseconds.
    pub max_execution_ns: u32,
    /// Shortest delay between nominal and actual start of an execution, in nanoseconds.
    pub min_delay_ns: u32,
    /// Longest delay between nominal and actual start of an execution, in nanoseconds.
    pub max_delay_ns: u32,
    /// Delays shorter than this are in the first bucket. Each further bucket reaches four times as
    /// far; the last has no end.
    pub first_bucket_ns: u32,
    /// Executions by their delay; each stays at 65,535. [`delay_counts`](Self::delay_counts) knows
    /// more.
    pub delays: [u16; DELAY_BUCKETS],
}

impl SlotCounters {
    /// Mean execution in nanoseconds, 0 before the first.
    pub fn mean_execution_ns(&self) -> u64 {
        self.total_execution_ns
            .checked_div(u64::from(self.executed))
            .unwrap_or(0)
    }

    /// Executions by their delay, and of each number whether it is the number, or there may be
    /// more. A bucket that is full by itself has what the others leave of all executions; of
    /// several, each has at least what it shows.
    pub fn delay_counts(&self) -> [(u32, bool); DELAY_BUCKETS] {
        let is_full = |count: u16| count == u16::MAX;
        let full = self.delays.iter().filter(|count| is_full(**count)).count();
        let others = self.delays.iter().filter(|count| !is_full(**count));
        let rest = others.fold(self.executed, |rest, count| {
            rest.saturating_sub(u32::from(*count))
        });
        self.delays.map(|count| match (is_full(count), full) {
            (false, _) => (u32::from(count), true),
            (true, 1) => (rest.max(u32::from(count)), self.executed < u32::MAX),
            (true, _) => (u32::from(count), false),
        })
    }

    /// Delays in this bucket are shorter than this, in nanoseconds; `None` for the last, which has
    /// no end.
    pub fn bucket_end_ns(&self, bucket: usize) -> Option<u64> {
        let factor = 4_u64.checked_pow(u32::try_from(bucket).ok()?)?;
        (bucket + 1 < DELAY_BUCKETS).then(|| u64::from(self.first_bucket_ns).saturating_mul(factor))
    }
}

/// How a task state is, and what was counted of it since the mission started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TaskCounters {
    /// Whether its task is enabled.
    pub enabled: bool,
    /// Whether it is enabled but cannot be executed.
    pub busy: bool,
    /// Executions that took longer than the slot's duration; saturates.
    pub overruns: u16,
}

/// What was counted of a frame of a link, and of the link, since the mission started. Where a
/// mission takes over warm from one that declares the link in the same way, counting goes on.
///
/// Counters stay at their greatest value once they are there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrameCounters {
    /// Occurrences that went to the device, or came as they should.
    pub passed: u32,
    /// Of a frame that is sent: occurrences that the device had no room for. Of one that is
    /// received: numbers that were left out since the first that came.
    pub missing: u32,
    /// Received: those that came twice, and were dropped.
    pub repeated: u32,
    /// Received: those that a newer one overtook before a task could see them.
    pub older: u32,
    /// Whatever came over the link with a wrong checksum, length or configuration, or with an
    /// identifier that no frame has.
    pub link_errors: u32,
    /// Whatever came over the link while no state received.
    pub link_dropped: u32,
}
