//! Watches for a line on the floor.

use super::values::Line;
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Sets `seen` while there is a line under the sensors, `crossing` while another one goes across
/// it; neither while it does not know.
#[derive(Clone, Copy, Debug, Default)]
pub struct LineMonitor;

task! {
    /// Watches for a line on the floor and for crossings.
    impl LineMonitor {
        slot 2;
        wcet 100 us;
        endless;
        monitor;
        data {
            /// Where the line is.
            in line: Line optional within 100 ms;
        }
        flags {
            /// There is a line under the sensors.
            out seen;
            /// Another line goes across it.
            out crossing;
        }
    }
}

impl Task for LineMonitor {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let line = io.try_read(Self::LINE);
        io.set(Self::SEEN, line.is_some_and(Line::is_seen));
        io.set(Self::CROSSING, line.is_some_and(Line::is_crossing));
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;

    #[test]
    fn a_line_is_seen_by_one_sensor_and_a_crossing_by_all() {
        let mut bench = TaskBench::new(LineMonitor);
        for (dark_sensors, seen, crossing) in [
            (0, false, false),
            (1, true, false),
            (2, true, false),
            (3, true, true),
        ] {
            let line = Line {
                left_um: 0,
                dark_sensors,
            };
            bench.give(LineMonitor::LINE, line).step();
            assert_eq!(bench.flag(LineMonitor::SEEN), seen, "{dark_sensors}");
            assert_eq!(
                bench.flag(LineMonitor::CROSSING),
                crossing,
                "{dark_sensors}"
            );
        }
        bench.take_away(LineMonitor::LINE).step();
        assert!(!bench.flag(LineMonitor::SEEN) && !bench.flag(LineMonitor::CROSSING));
    }
}
