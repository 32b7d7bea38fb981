//! Stops a robot whose battery is empty.

use super::values::Battery;
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};
use esm_link::message::SafeReason;

/// A guard that has not known the voltage for so long takes the battery for empty: whoever measures
/// it has had its chance, also at the start.
const UNKNOWN_US: u32 = 1_000_000;

/// While its state is active and the battery is below `stop_v`, or its voltage has not been known
/// for a second, the runtime switches the motors off, whatever the mission does: safe state, until
/// the host says start. A mission that wants to drive home first looks at `low` of
/// [`BatteryMonitor`](super::BatteryMonitor), with a higher voltage.
#[derive(Clone, Copy, Debug, Default)]
pub struct BatteryGuard {
    unknown_us: u32,
}

task! {
    /// Switches the motors off, whatever the mission does, while the battery is below `stop_v`, or
    /// its voltage has not been known for a second. `esm start` ends that.
    impl BatteryGuard {
        slot 3;
        wcet 100 us;
        endless;
        monitor;
        data {
            /// The battery, at any load.
            in battery: Battery optional within 200 ms;
        }
        params {
            /// The least voltage to drive with, in volts.
            stop_v: f32 = 6.0, 0.0..=20.0;
        }
    }
}

impl Task for BatteryGuard {
    // Not when it is entered anew: a mission that does so all the time is stopped, too.
    fn reset(&mut self) {
        self.unknown_us = 0;
    }

    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let low = match io.try_read(Self::BATTERY) {
            Some(battery) => {
                self.unknown_us = 0;
                battery.voltage_v < io.param(Self::STOP_V)
            }
            None => {
                self.unknown_us = self.unknown_us.saturating_add(io.period_us());
                self.unknown_us > UNKNOWN_US
            }
        };
        io.beat();
        if low {
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
    fn a_battery_that_nobody_measures_stops_the_robot() {
        let mut bench = TaskBench::new(BatteryGuard::default());
        bench.param(BatteryGuard::STOP_V, 6.2).period_us(100_000);
        for given in [true, false] {
            if given {
                bench
                    .give(BatteryGuard::BATTERY, Battery { voltage_v: 7.0 })
                    .step();
                bench.take_away(BatteryGuard::BATTERY);
            }
            let mut steps = 0;
            while bench.failure().is_none() && steps < 100 {
                steps += 1;
                bench.step();
            }
            assert_eq!(steps, 11, "a second, and the step after");
            bench = TaskBench::new(BatteryGuard::default());
            bench.param(BatteryGuard::STOP_V, 6.2).period_us(100_000);
        }
    }

    #[test]
    fn a_battery_below_its_limit_stops_the_robot() {
        let mut bench = TaskBench::new(BatteryGuard::default());
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
