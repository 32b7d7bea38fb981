//! Counts how often its state was entered.

use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Counts the entries of its state since the mission started, and finishes at once.
#[derive(Clone, Copy, Debug, Default)]
pub struct Count {
    entries: u32,
    is_new: bool,
}

task! {
    /// Counts how often its state was entered since the mission started, and finishes at once. Each
    /// task state counts for itself.
    impl Count {
        slot 2;
        wcet 100 us;
        data {
            /// How often it was entered.
            out count: u32;
        }
        flags {
            /// Set on the way in: this entry is the first again.
            in anew;
            /// It was entered `limit` times or more.
            out reached;
        }
        params {
            /// How often it is to be entered until `reached` is set.
            limit: u32 = 1, 1..=1000000;
        }
    }
}

impl Task for Count {
    fn reset(&mut self) {
        self.entries = 0;
    }

    fn enter(&mut self) {
        self.is_new = true;
    }

    fn step(&mut self, io: &mut Io<'_>) -> Step {
        if core::mem::take(&mut self.is_new) {
            let before = if io.flag(Self::ANEW) { 0 } else { self.entries };
            self.entries = before.saturating_add(1);
        }
        *io.write(Self::COUNT) = self.entries;
        io.set(Self::REACHED, self.entries >= io.param(Self::LIMIT));
        Step::Finished
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;

    #[test]
    fn each_entry_counts_once_until_it_begins_anew() {
        let mut bench = TaskBench::new(Count::default());
        bench.param(Count::LIMIT, 3);
        for (anew, count, reached) in [
            (false, 1, false),
            (false, 2, false),
            (false, 3, true),
            (false, 4, true),
            (true, 1, false),
            (false, 2, false),
        ] {
            bench.enter_anew().set(Count::ANEW, anew);
            assert_eq!(bench.step(), Some(Step::Finished));
            assert_eq!(bench.output(Count::COUNT), Some(count));
            assert_eq!(bench.flag(Count::REACHED), reached, "{count}");
        }
    }

    #[test]
    fn a_mission_starts_at_zero() {
        let mut count = Count::default();
        count.enter();
        count.entries = 7;
        count.reset();
        assert_eq!(count.entries, 0);
    }
}
