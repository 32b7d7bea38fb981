//! Watches whether something comes too close.

use super::values::Ranges;
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Sets `close` while something is nearer to the rim than `close_m`, on any side, or a sonar does
/// not know whether there is, or there are no ranges that are young enough.
#[derive(Clone, Copy, Debug, Default)]
pub struct ProximityMonitor;

task! {
    /// Watches whether something comes close, on any side.
    impl ProximityMonitor {
        slot 3;
        wcet 200 us;
        endless;
        monitor;
        data {
            /// What is around the robot.
            in ranges: Ranges optional within 200 ms;
        }
        flags {
            /// Something is nearer than `close_m`, or nobody knows.
            out close;
        }
        params {
            /// How near is close, in metres from the rim.
            close_m: f32 = 0.1, 0.0..=1.0;
        }
    }
}

impl Task for ProximityMonitor {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let close_m = io.param(Self::CLOSE_M);
        let close = io
            .try_read(Self::RANGES)
            .is_none_or(|ranges| ranges.nearest_m() < close_m);
        io.set(Self::CLOSE, close);
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;
    use crate::body::SONARS;

    #[test]
    fn who_does_not_know_says_close() {
        let mut bench = TaskBench::new(ProximityMonitor);
        bench.param(ProximityMonitor::CLOSE_M, 0.1).step();
        assert!(bench.flag(ProximityMonitor::CLOSE));
        bench.give(ProximityMonitor::RANGES, Ranges::FREE).step();
        assert!(!bench.flag(ProximityMonitor::CLOSE));
        bench.take_away(ProximityMonitor::RANGES).step();
        assert!(bench.flag(ProximityMonitor::CLOSE));
    }

    #[test]
    fn anything_near_on_any_side_is_close() {
        let mut bench = TaskBench::new(ProximityMonitor);
        bench.param(ProximityMonitor::CLOSE_M, 0.1);
        for sonar in 0..SONARS {
            for (range_m, close) in [(0.09, true), (0.11, false), (0.0, true)] {
                let mut ranges = Ranges::FREE;
                ranges.range_m[sonar] = range_m;
                bench.give(ProximityMonitor::RANGES, ranges).step();
                let seen = bench.flag(ProximityMonitor::CLOSE);
                assert_eq!(seen, close, "sonar {sonar} at {range_m} m");
            }
        }
    }
}
