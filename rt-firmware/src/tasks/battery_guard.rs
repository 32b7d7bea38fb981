//! Stops a robot whose battery is empty.

use super::values::Battery;
use crate::link::message::SafeReason;
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// While its state is active and the battery is below `stop_v`, the runtime switches the motors off, whatever the mission does: safe state, until the host
/// says start. A mission that wants to drive home first looks at `low` of [`BatteryMonitor`](super::BatteryMonitor), with a higher voltage.
#[derive(Clone, Copy, Debug, Default)]
pub struct BatteryGuard;

task! {
    impl BatteryGuard {
        slot 3;
        wcet 100 us;
        data {
            in battery: Battery;
        }
        params {
            stop_v: f32 = 6.0, 0.0..=20.0;
        }
    }
}

impl Task for BatteryGuard {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        if io.read(Self::BATTERY).voltage_v < io.param(Self::STOP_V) {
            io.fail_safe(SafeReason::LowBattery);
        }
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;

    #[test]
    fn a_battery_below_its_limit_stops_the_robot() {
        let mut bench = TaskBench::new(BatteryGuard);
        bench.param(BatteryGuard::STOP_V, 6.2);
        for (voltage_v, expected) in [
            (7.0, None),
            (6.2, None),
            (6.1, Some(SafeReason::LowBattery)),
        ] {
            bench
                .give(BatteryGuard::BATTERY, Battery { voltage_v })
                .step();
            assert_eq!(bench.failure(), expected, "{voltage_v} V");
        }
    }
}
