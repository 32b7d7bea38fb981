//! When what goes wrong is too much, and how long nothing is looked at.

/// How long the real-time side leaves the link without an answer, and the watchdog without food,
/// when no slot is due.
pub const IDLE_POLL_US: u32 = 10_000;

/// How much may go wrong before the robot goes to its safe state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Activations of one slot, one after another, that take longer than its duration.
    pub overruns_in_a_row: u16,
    /// Activations of one slot, one after another, that do not start within their period.
    pub missed_in_a_row: u32,
}

impl Default for Limits {
    fn default() -> Self {
        Limits {
            overruns_in_a_row: 10,
            missed_in_a_row: 10,
        }
    }
}
