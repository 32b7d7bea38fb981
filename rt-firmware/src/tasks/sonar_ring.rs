//! Measures the ranges around the robot.

use embedded_hal::digital::OutputPin;

use super::values::Ranges;
use crate::body::SONARS;
use crate::drivers::{EchoTimer, Sonar};
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Pings half of the sonars in each occurrence of its slot and collects the echoes in the next, so that neighbours never hear each
/// other. The slot's period must leave sound the time to come back: at least 30 ms.
///
/// A single missed echo is not believed; the second in a row means that nothing is there.
#[derive(Debug)]
pub struct SonarRing<T, E> {
    sonars: [Sonar<T, E>; SONARS],
    range_m: [f32; SONARS],
    missed: [bool; SONARS],
    /// Pings sent since the mission started, in halves of the ring.
    halves_pinged: u8,
    /// Whether the sonars with an odd number were pinged last.
    odd: bool,
}

task! {
    impl[T: OutputPin + Send, E: EchoTimer + Send] SonarRing<T, E> {
        slot 3;
        wcet 600 us;
        data {
            out ranges: Ranges;
        }
    }
}

impl<T: OutputPin, E: EchoTimer> SonarRing<T, E> {
    /// A ring of sonars on these pins, counter-clockwise from the one that looks ahead.
    pub fn new(triggers: [T; SONARS], echo_timers: [E; SONARS]) -> Self {
        let [t0, t1, t2, t3, t4, t5, t6, t7] = triggers;
        let [e0, e1, e2, e3, e4, e5, e6, e7] = echo_timers;
        Self {
            sonars: [
                Sonar::new(t0, e0),
                Sonar::new(t1, e1),
                Sonar::new(t2, e2),
                Sonar::new(t3, e3),
                Sonar::new(t4, e4),
                Sonar::new(t5, e5),
                Sonar::new(t6, e6),
                Sonar::new(t7, e7),
            ],
            range_m: [Ranges::FAR_M; SONARS],
            missed: [false; SONARS],
            halves_pinged: 0,
            odd: false,
        }
    }

    /// The sonars of the half that was pinged last, each with its range and whether it missed an echo.
    fn half(&mut self) -> impl Iterator<Item = (&mut Sonar<T, E>, &mut f32, &mut bool)> {
        let sensed = self.range_m.iter_mut().zip(self.missed.iter_mut());
        (self.sonars.iter_mut().zip(sensed))
            .map(|(sonar, (range_m, missed))| (sonar, range_m, missed))
            .skip(usize::from(self.odd))
            .step_by(2)
    }

    fn collect(&mut self) {
        for (sonar, range_m, missed) in self.half() {
            match sonar.range_m() {
                Some(measured_m) => {
                    *range_m = measured_m.min(Ranges::FAR_M);
                    *missed = false;
                }
                None if *missed => *range_m = Ranges::FAR_M,
                None => *missed = true,
            }
        }
    }

    fn ping(&mut self) {
        for (sonar, _, missed) in self.half() {
            // A sonar whose trigger fails sends no ping: its last echo must not be believed for ever.
            if sonar.ping().is_err() {
                *missed = true;
            }
        }
    }
}

impl<T: OutputPin + Send, E: EchoTimer + Send> Task for SonarRing<T, E> {
    fn reset(&mut self) {
        self.range_m = [Ranges::FAR_M; SONARS];
        self.missed = [false; SONARS];
    }

    fn enter(&mut self) {
        self.halves_pinged = 0;
    }

    fn step(&mut self, io: &mut Io<'_>) -> Step {
        if self.halves_pinged > 0 {
            self.collect();
        }
        // Nobody shall act on half a picture.
        if self.halves_pinged >= 2 {
            *io.write(Self::RANGES) = Ranges {
                range_m: self.range_m,
            };
        }
        self.odd = !self.odd;
        self.ping();
        self.halves_pinged = self.halves_pinged.saturating_add(1);
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;
    use crate::body::{EchoCapture, PinImage, Sensors, TriggerPin};

    type Ring<'a> = SonarRing<TriggerPin<'a>, EchoCapture<'a>>;

    fn ring(pins: &PinImage) -> Ring<'_> {
        let parts = pins.parts();
        SonarRing::new(parts.sonar_triggers, parts.echo_timers)
    }

    fn echoes(pins: &PinImage, echo_us: [u16; SONARS]) {
        pins.set_sensors(&Sensors {
            echo_us,
            ..Sensors::default()
        });
    }

    #[test]
    fn neighbours_ping_in_turns_and_the_first_picture_is_a_whole_one() {
        let pins = PinImage::new();
        let mut bench = TaskBench::new(ring(&pins));
        echoes(&pins, [5_828; SONARS]);
        for (triggers, published) in [
            (0b1010_1010, false),
            (0b0101_0101, false),
            (0b1010_1010, true),
            (0b0101_0101, true),
        ] {
            bench.step();
            assert_eq!(pins.take_actuators().sonar_triggers, triggers);
            assert_eq!(bench.output(Ring::RANGES).is_some(), published);
        }
        let ranges = bench.output(Ring::RANGES).unwrap();
        assert!(
            ranges
                .range_m
                .iter()
                .all(|range_m| (range_m - 1.0).abs() < 1e-3)
        );
    }

    #[test]
    fn one_missed_echo_is_not_believed_and_two_are() {
        let pins = PinImage::new();
        let mut bench = TaskBench::new(ring(&pins));
        let mut ahead_m = |echo_us| {
            echoes(&pins, [echo_us; SONARS]);
            bench.step();
            bench.step();
            bench.output(Ring::RANGES).map(|ranges| ranges.ahead_m())
        };
        ahead_m(2_914);
        for (echo_us, expected_m) in [(2_914, 0.5), (0, 0.5), (2_914, 0.5), (0, 0.5), (0, 4.0)] {
            let seen_m = ahead_m(echo_us).unwrap();
            assert!((seen_m - expected_m).abs() < 1e-3, "{echo_us}: {seen_m}");
        }
    }
}
