//! Watches whether slots keep their times.

use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Sets `overrun` when an activation of any slot has lasted too long since the last step, and
/// `missed` when one did not start within its period. Both stay set until the state is entered
/// anew, so that no macro step can overlook them. While the state is active, `limit` is how many
/// activations of one slot in a row may last too long; one more leads to the safe state.
#[derive(Clone, Copy, Debug, Default)]
pub struct SlotMonitor {
    /// What the runtime had counted at the last step; nothing before the first one of a mission.
    seen: Option<Counted>,
}

#[derive(Clone, Copy, Debug)]
struct Counted {
    overruns: u32,
    missed: u32,
}

task! {
    /// Watches whether all slots keep their times.
    impl SlotMonitor {
        slot 3;
        wcet 100 us;
        endless;
        monitor;
        flags {
            /// A slot has lasted too long since the state was entered.
            out overrun;
            /// A slot has not started within its period since the state was entered.
            out missed;
        }
        params {
            /// So many overruns of one slot in a row are allowed. One more, and the motors go off.
            limit: u32 = 10, 0..=1000;
        }
    }
}

impl Task for SlotMonitor {
    fn reset(&mut self) {
        self.seen = None;
    }

    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let now = Counted {
            overruns: io.overruns(),
            missed: io.missed(),
        };
        let seen = self.seen.replace(now).unwrap_or(now);
        if now.overruns != seen.overruns {
            io.set(Self::OVERRUN, true);
        }
        if now.missed != seen.missed {
            io.set(Self::MISSED, true);
        }
        io.allow_overruns(io.param(Self::LIMIT));
        io.beat();
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;

    #[test]
    fn what_was_counted_since_the_last_step_is_told_until_the_state_is_entered_anew() {
        let mut bench = TaskBench::new(SlotMonitor::default());
        bench.param(SlotMonitor::LIMIT, 7);
        // Counted in all; whether the state is entered anew; the flags after the step.
        for (overruns, missed, enter, told) in [
            (5, 2, false, [false, false]),
            (5, 2, false, [false, false]),
            (6, 2, false, [true, false]),
            (6, 2, false, [true, false]),
            (6, 9, false, [true, true]),
            (6, 9, true, [false, false]),
            (7, 9, true, [true, false]),
        ] {
            if enter {
                bench.enter_anew();
            }
            bench.counted(overruns, missed).step();
            let flags = [SlotMonitor::OVERRUN, SlotMonitor::MISSED].map(|flag| bench.flag(flag));
            assert_eq!(flags, told, "{overruns} overruns, {missed} missed");
            assert_eq!(bench.allowed_overruns(), Some(7));
        }
    }
}
