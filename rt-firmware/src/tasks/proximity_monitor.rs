//! Watches whether something comes too close.

use super::values::Ranges;
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Sets `close` while something is nearer to the rim than `close_m`, on any side, or a sonar does not know whether there is.
#[derive(Clone, Copy, Debug, Default)]
pub struct ProximityMonitor;

task! {
    impl ProximityMonitor {
        slot 3;
        wcet 200 us;
        data {
            in ranges: Ranges;
        }
        flags {
            out close;
        }
        params {
            close_m: f32 = 0.1, 0.0..=1.0;
        }
    }
}

impl Task for ProximityMonitor {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let nearest_m = io.read(Self::RANGES).nearest_m();
        io.set(Self::CLOSE, nearest_m < io.param(Self::CLOSE_M));
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;
    use crate::body::SONARS;

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
