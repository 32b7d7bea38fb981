//! Watches whether the host still calls.

use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};
use esm_link::message::SafeReason;

/// Sets `warn`, `slow` and `stop` while no request has come over the link for so many milliseconds,
/// and clears them when one comes. Once `stop` has been set for a period of its slot, and the link
/// is silent still, the runtime switches the motors off by itself, whatever the mission does: safe
/// state, until the host says start.
///
/// Any request that arrives whole counts; where the robot has a key, only its owner's. What the
/// robot sends does not.
#[derive(Clone, Copy, Debug, Default)]
pub struct LinkMonitor {
    /// The machine has been told that the time is up.
    told: bool,
}

task! {
    /// Watches whether the host still calls. Each request that arrives whole counts. Where the
    /// robot has a key, only those of its owner count. After `stop` the motors go off by
    /// themselves, until `esm start`.
    impl LinkMonitor {
        slot 3;
        wcet 100 us;
        endless;
        monitor;
        flags {
            /// There was no request for `warn_ms`.
            out warn;
            /// There was none for `slow_ms`.
            out slow;
            /// There was none for `stop_ms`.
            out stop;
        }
        params {
            /// In milliseconds.
            warn_ms: u32 = 500, 50..=60000;
            /// In milliseconds.
            slow_ms: u32 = 1000, 50..=60000;
            /// In milliseconds.
            stop_ms: u32 = 2000, 50..=60000;
        }
    }
}

impl Task for LinkMonitor {
    // Not when it is entered anew: a mission that does so all the time is stopped, too.
    fn reset(&mut self) {
        self.told = false;
    }

    fn step(&mut self, io: &mut Io<'_>) -> Step {
        const US_PER_MS: u32 = 1_000;
        let silent_ms = io.link_silent_us() / US_PER_MS;
        let over = |limit_ms: u32| silent_ms >= limit_ms;
        let stop = over(io.param(Self::STOP_MS));
        let (warn, slow) = (over(io.param(Self::WARN_MS)), over(io.param(Self::SLOW_MS)));
        io.set(Self::WARN, warn);
        io.set(Self::SLOW, slow);
        io.set(Self::STOP, stop);
        if stop && self.told {
            io.fail_safe(SafeReason::LinkLost);
        }
        self.told = stop;
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;

    #[test]
    fn a_silence_passes_through_its_stages_and_ends_in_the_safe_state() {
        let mut bench = TaskBench::new(LinkMonitor::default());
        bench
            .param(LinkMonitor::WARN_MS, 100)
            .param(LinkMonitor::SLOW_MS, 200)
            .param(LinkMonitor::STOP_MS, 300);
        // Silence in ms; the flags after the step; whether the motors go off.
        for (silent_ms, told, stopped) in [
            (0, [false, false, false], false),
            (99, [false, false, false], false),
            (100, [true, false, false], false),
            (200, [true, true, false], false),
            (300, [true, true, true], false),
            // A word in the last moment.
            (10, [false, false, false], false),
            (301, [true, true, true], false),
            (311, [true, true, true], true),
        ] {
            // A mission that enters the state anew each time changes nothing.
            bench.enter_anew();
            bench.link_silent_us(silent_ms * 1_000).step();
            let flags = [LinkMonitor::WARN, LinkMonitor::SLOW, LinkMonitor::STOP];
            assert_eq!(flags.map(|flag| bench.flag(flag)), told, "{silent_ms} ms");
            let expected = stopped.then_some(SafeReason::LinkLost);
            assert_eq!(bench.failure(), expected, "{silent_ms} ms");
        }
    }
}
