//! A sonar: a pin that triggers a ping, a timer that catches its echo.

use embedded_hal::digital::OutputPin;

use super::EchoTimer;

/// Half the speed of sound at 20 °C, in metres for each microsecond of echo time: sound goes there and back.
const METRES_PER_ECHO_US: f32 = 343.2 / 2.0 / 1e6;

/// A sonar.
#[derive(Debug)]
pub struct Sonar<T, E> {
    trigger: T,
    echo: E,
}

impl<T: OutputPin, E: EchoTimer> Sonar<T, E> {
    /// The sonar on these pins.
    pub fn new(trigger: T, echo: E) -> Self {
        Self { trigger, echo }
    }

    /// Sends a ping. Its range can be read when sound had the time to come back: 24 ms from 4 m.
    pub fn ping(&mut self) -> Result<(), T::Error> {
        self.trigger.set_high()?;
        self.trigger.set_low()
    }

    /// Range of the last finished ping in metres, from the sonar; `None` if no echo came back.
    pub fn range_m(&mut self) -> Option<f32> {
        let echo_us = self.echo.echo_us()?;
        Some(f32::from(echo_us) * METRES_PER_ECHO_US)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{PinImage, Sensors};

    #[test]
    fn a_ping_triggers_its_own_sonar() {
        let pins = PinImage::new();
        let parts = pins.parts();
        let [_, _, trigger, ..] = parts.sonar_triggers;
        let [_, _, echo, ..] = parts.echo_timers;
        Sonar::new(trigger, echo).ping().unwrap();
        assert_eq!(pins.take_actuators().sonar_triggers, 0b100);
    }

    #[test]
    fn echo_times_become_ranges() {
        let pins = PinImage::new();
        let parts = pins.parts();
        let [trigger, ..] = parts.sonar_triggers;
        let [echo, ..] = parts.echo_timers;
        let mut sonar = Sonar::new(trigger, echo);
        for (echo_us, expected_m) in [(0, None), (5_828, Some(1.0)), (23_310, Some(4.0))] {
            let mut sensors = Sensors::default();
            sensors.echo_us[0] = echo_us;
            pins.set_sensors(&sensors);
            let range_m = sonar.range_m();
            assert_eq!(range_m.is_some(), expected_m.is_some(), "{echo_us}");
            if let (Some(range_m), Some(expected_m)) = (range_m, expected_m) {
                assert!((range_m - expected_m).abs() < 1e-3, "{echo_us}: {range_m}");
            }
        }
    }
}
