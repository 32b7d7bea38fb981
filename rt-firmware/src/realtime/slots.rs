//! What is counted of each slot.

use crate::link::message::SlotCounters;

/// What is kept for a slot. Times in ticks of the board's clock.
#[derive(Clone, Copy, Debug)]
pub struct SlotEntry {
    executed: u32,
    overruns: u32,
    min_execution_ticks: u32,
    max_execution_ticks: u32,
    min_delay_ticks: u32,
    max_delay_ticks: u32,
    overruns_in_a_row: u16,
    /// The first task instance of the slot.
    pub(crate) first_task: Option<u16>,
}

impl SlotEntry {
    /// A slot of which nothing happened yet.
    pub const EMPTY: SlotEntry = SlotEntry {
        executed: 0,
        overruns: 0,
        min_execution_ticks: u32::MAX,
        max_execution_ticks: 0,
        min_delay_ticks: u32::MAX,
        max_delay_ticks: 0,
        overruns_in_a_row: 0,
        first_task: None,
    };

    /// The place of a slot before any mission, which makes it [`EMPTY`](Self::EMPTY). All zeros, so that a static of it takes no flash.
    pub(crate) const UNUSED: SlotEntry = SlotEntry {
        min_execution_ticks: 0,
        min_delay_ticks: 0,
        ..Self::EMPTY
    };

    /// Overruns since the last occurrence without one.
    pub(crate) fn overruns_in_a_row(&self) -> u16 {
        self.overruns_in_a_row
    }

    /// An occurrence began so long after its nominal start.
    pub(crate) fn began(&mut self, delay_ticks: u32) {
        self.executed = self.executed.wrapping_add(1);
        self.min_delay_ticks = self.min_delay_ticks.min(delay_ticks);
        self.max_delay_ticks = self.max_delay_ticks.max(delay_ticks);
    }

    /// An occurrence ended. Returns whether it took longer than `duration_ticks`.
    pub(crate) fn ended(&mut self, execution_ticks: u32, duration_ticks: u64) -> bool {
        self.min_execution_ticks = self.min_execution_ticks.min(execution_ticks);
        self.max_execution_ticks = self.max_execution_ticks.max(execution_ticks);
        let overrun = u64::from(execution_ticks) > duration_ticks;
        if overrun {
            self.overruns = self.overruns.saturating_add(1);
            self.overruns_in_a_row = self.overruns_in_a_row.saturating_add(1);
        } else {
            self.overruns_in_a_row = 0;
        }
        overrun
    }

    pub(crate) fn counters(&self, number: u32, missed: u32, ticks_per_us: u32) -> SlotCounters {
        let ns = |ticks| nanoseconds(ticks, ticks_per_us);
        let or_none = |ticks| if self.executed == 0 { 0 } else { ticks };
        SlotCounters {
            number,
            executed: self.executed,
            missed,
            overruns: self.overruns,
            min_execution_ns: ns(or_none(self.min_execution_ticks)),
            max_execution_ns: ns(self.max_execution_ticks),
            min_delay_ns: ns(or_none(self.min_delay_ticks)),
            max_delay_ns: ns(self.max_delay_ticks),
        }
    }
}

/// Ticks in nanoseconds; saturates after four seconds.
pub(crate) fn nanoseconds(ticks: u32, ticks_per_us: u32) -> u32 {
    const NS_PER_US: u32 = 1_000;
    let ticks_per_us = ticks_per_us.max(1);
    let (us, rest) = (ticks / ticks_per_us, ticks % ticks_per_us);
    us.checked_mul(NS_PER_US)
        .and_then(|ns| ns.checked_add(rest * NS_PER_US / ticks_per_us))
        .unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_become_nanoseconds() {
        for (ticks, ticks_per_us, ns) in [
            (0, 50, 0),
            (1, 50, 20),
            (49, 50, 980),
            (51, 50, 1_020),
            (7, 1, 7_000),
            (5, 12, 416),
            (u32::MAX, 12, 357_913_941_250_u64),
        ] {
            assert_eq!(
                nanoseconds(ticks, ticks_per_us),
                u32::try_from(ns).unwrap_or(u32::MAX),
                "{ticks} ticks"
            );
        }
    }

    #[test]
    fn a_slot_counts_what_happens() {
        let mut slot = SlotEntry::EMPTY;
        assert_eq!(
            slot.counters(3, 0, 1),
            SlotCounters {
                number: 3,
                ..SlotCounters::default()
            }
        );
        for (delay, execution, overrun, in_a_row) in [
            (2, 90, false, 0),
            (1, 101, true, 1),
            (9, 150, true, 2),
            (3, 100, false, 0),
        ] {
            slot.began(delay);
            assert_eq!(slot.ended(execution, 100), overrun);
            assert_eq!(slot.overruns_in_a_row(), in_a_row);
        }
        let expected = SlotCounters {
            number: 3,
            executed: 4,
            missed: 5,
            overruns: 2,
            min_execution_ns: 90_000,
            max_execution_ns: 150_000,
            min_delay_ns: 1_000,
            max_delay_ns: 9_000,
        };
        assert_eq!(slot.counters(3, 5, 1), expected);
    }
}
