//! Watches battery and nearness.

use super::values::{Battery, Ranges};
use crate::drivers::{AnalogIn, BatteryGauge};
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Share of a new conversion in the smoothed voltage: motors that start pull the voltage down for a moment, which is no empty battery.
const SMOOTHING: f32 = 0.05;

/// Sets `close` while something is nearer to the rim than `close_m`, and `low_battery` while the smoothed voltage is below `low_v`.
#[derive(Debug)]
pub struct SafetyMonitor<A> {
    gauge: BatteryGauge<A>,
    smoothed_v: Option<f32>,
}

task! {
    impl[A: AnalogIn + Send] SafetyMonitor<A> {
        slot 3;
        wcet 300 us;
        data {
            in ranges: Ranges;
            out battery: Battery;
        }
        flags {
            out close;
            out low_battery;
        }
        params {
            close_m: f32 = 0.06, 0.0..=1.0;
            low_v: f32 = 6.6, 0.0..=20.0;
        }
    }
}

impl<A: AnalogIn> SafetyMonitor<A> {
    /// A monitor of the battery on this gauge.
    pub fn new(gauge: BatteryGauge<A>) -> Self {
        Self {
            gauge,
            smoothed_v: None,
        }
    }
}

impl<A: AnalogIn + Send> Task for SafetyMonitor<A> {
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
        let nearest_m = io.read(Self::RANGES).nearest_m();
        io.set(Self::CLOSE, nearest_m < io.param(Self::CLOSE_M));
        io.set(Self::LOW_BATTERY, smoothed_v < io.param(Self::LOW_V));
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;
    use crate::body::{AnalogChannel, PinImage, Sensors};

    type Task<'a> = SafetyMonitor<AnalogChannel<'a>>;

    fn bench(pins: &PinImage) -> TaskBench<'_> {
        let [battery, ..] = pins.parts().analog;
        let mut bench = TaskBench::new(Task::new(BatteryGauge::new(battery, 10.0)));
        bench.param(Task::CLOSE_M, 0.1).param(Task::LOW_V, 6.0);
        bench.give(Task::RANGES, Ranges::FREE);
        bench
    }

    fn set_battery_v(pins: &PinImage, voltage_v: f32) {
        let mut sensors = Sensors::default();
        sensors.adc_counts[0] = (voltage_v / 10.0 * 4_095.0) as u16;
        pins.set_sensors(&sensors);
    }

    #[test]
    fn a_dip_is_no_empty_battery_but_a_lasting_one_is() {
        let pins = PinImage::new();
        let mut bench = bench(&pins);
        for (voltage_v, steps, low) in [
            (8.0, 5, false),
            (4.0, 5, false),
            (8.0, 50, false),
            (5.0, 50, true),
        ] {
            set_battery_v(&pins, voltage_v);
            for _ in 0..steps {
                bench.step();
            }
            assert_eq!(
                bench.flag(Task::LOW_BATTERY),
                low,
                "{voltage_v} V, {steps} steps"
            );
        }
    }

    #[test]
    fn anything_near_on_any_side_is_close() {
        let pins = PinImage::new();
        let mut bench = bench(&pins);
        for sonar in 0..8 {
            for (range_m, close) in [(0.09, true), (0.11, false)] {
                let mut ranges = Ranges::FREE;
                ranges.range_m[sonar] = range_m;
                bench.give(Task::RANGES, ranges).step();
                assert_eq!(
                    bench.flag(Task::CLOSE),
                    close,
                    "sonar {sonar} at {range_m} m"
                );
            }
        }
    }
}
