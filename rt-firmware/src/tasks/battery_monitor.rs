//! Watches the battery.

use super::values::Battery;
use crate::drivers::{AnalogIn, BatteryGauge};
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Share of a new conversion in the smoothed voltage: motors that start pull the voltage down for a
/// moment, which is no empty battery.
const SMOOTHING: f32 = 0.05;

/// Publishes the battery's smoothed voltage and sets `low` while it is below `low_v`.
#[derive(Debug)]
pub struct BatteryMonitor<A> {
    gauge: BatteryGauge<A>,
    smoothed_v: Option<f32>,
}

task! {
    /// Measures the battery.
    impl[A: AnalogIn + Send] BatteryMonitor<A> {
        slot 3;
        wcet 200 us;
        endless;
        monitor;
        data {
            /// Its voltage, smoothed.
            out battery: Battery;
        }
        flags {
            /// It is below `low_v`.
            out low;
        }
        params {
            /// The voltage below which `low` is set, in volts.
            low_v: f32 = 6.6, 0.0..=20.0;
        }
    }
}

impl<A: AnalogIn> BatteryMonitor<A> {
    /// A monitor of the battery on this gauge.
    pub fn new(gauge: BatteryGauge<A>) -> Self {
        Self {
            gauge,
            smoothed_v: None,
        }
    }
}

impl<A: AnalogIn + Send> Task for BatteryMonitor<A> {
    fn reset(&mut self) {
        self.smoothed_v = None;
    }

    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let voltage_v = self.gauge.voltage_v();
        let smoothed_v = self.smoothed_v.map_or(voltage_v, |smoothed_v| {
            smoothed_v + SMOOTHING * (voltage_v - smoothed_v)
        });
        self.smoothed_v = Some(smoothed_v);
        *io.write(Self::BATTERY) = Battery {
            voltage_v: smoothed_v,
        };
        io.set(Self::LOW, smoothed_v < io.param(Self::LOW_V));
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;
    use crate::body::{AnalogChannel, PinImage, Sensors};

    type Task<'a> = BatteryMonitor<AnalogChannel<'a>>;

    #[test]
    fn a_dip_is_no_empty_battery_but_a_lasting_one_is() {
        let pins = PinImage::new();
        let [battery, ..] = pins.parts().analog;
        let mut bench = TaskBench::new(Task::new(BatteryGauge::new(battery, 10.0)));
        bench.param(Task::LOW_V, 6.0);
        for (voltage_v, steps, low) in [
            (8.0, 5, false),
            (4.0, 5, false),
            (8.0, 50, false),
            (5.0, 50, true),
        ] {
            let mut sensors = Sensors::default();
            sensors.adc_counts[0] = (voltage_v / 10.0 * 4_095.0) as u16;
            pins.set_sensors(&sensors);
            for _ in 0..steps {
                bench.step();
            }
            assert_eq!(bench.flag(Task::LOW), low, "{voltage_v} V, {steps} steps");
        }
        let battery = bench.output(Task::BATTERY).unwrap();
        assert!((5.0..5.5).contains(&battery.voltage_v), "{battery:?}");
    }
}
