//! A battery behind a voltage divider on an analogue input.

use super::AnalogIn;

/// A battery's voltage, measured.
#[derive(Debug)]
pub struct BatteryGauge<A> {
    input: A,
    full_scale_v: f32,
}

impl<A: AnalogIn> BatteryGauge<A> {
    /// The battery on this input; `full_scale_v` is the battery's voltage that reads as full scale,
    /// in volts.
    pub fn new(input: A, full_scale_v: f32) -> Self {
        Self {
            input,
            full_scale_v,
        }
    }

    /// The battery's voltage now, in volts.
    pub fn voltage_v(&mut self) -> f32 {
        let share = f32::from(self.input.counts()) / f32::from(self.input.full_scale());
        share * self.full_scale_v
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Counts(u16);

    impl AnalogIn for Counts {
        fn counts(&mut self) -> u16 {
            self.0
        }
        fn full_scale(&self) -> u16 {
            1_000
        }
    }

    #[test]
    fn counts_become_volts() {
        for (counts, expected_v) in [(0, 0.0), (500, 6.0), (1_000, 12.0)] {
            assert_eq!(
                BatteryGauge::new(Counts(counts), 12.0).voltage_v(),
                expected_v
            );
        }
    }
}
