//! Measures the ranges around a robot with many sonars.

use embedded_hal::digital::OutputPin;

use super::values::{ARRAY_SONARS, ArrayRanges};
use crate::body::{ARRAY_BANKS, SONARS};
use crate::drivers::{Answer, EchoTimer, Sound, answer_to};
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

const _: () = assert!(
    ARRAY_BANKS * SONARS == ARRAY_SONARS,
    "a range for each sonar"
);

/// Pings one bank of the array in each activation of its slot and collects the answers in the next,
/// one bank after the other. The slot's period must leave a sonar the time to answer: at least
/// 40 ms.
///
/// It publishes a picture when all banks have answered, each sonar once in each picture. Nothing is
/// filtered: a range is what a sonar said to its last ping. What is not known is never far: a sonar
/// that does not answer has no range ([`ArrayRanges`]).
///
/// The sonars of a bank ping at the same moment, so they must not hear each other. Array and ring
/// share the echo pins: a mission has one of the two.
#[derive(Debug)]
pub struct SonarArray<T, E> {
    /// Triggers and echo timers; none where the robot has no array.
    pins: Option<([T; ARRAY_BANKS], [E; SONARS])>,
    /// The bank that pings next; its answers complete a picture if it is the first.
    bank: usize,
    /// The bank whose answers are due.
    asked: Option<Asked>,
    ranges: ArrayRanges,
}

/// A bank that was to ping.
#[derive(Clone, Copy, Debug)]
struct Asked {
    bank: usize,
    is_sent: bool,
}

task! {
    /// Measures with 24 sonars what is around the robot, in three banks one after the other: the
    /// slot's period is at least 40 ms, and three periods are a picture. Use it or `SonarRing`:
    /// they share pins.
    impl[T: OutputPin + Send, E: EchoTimer + Send] SonarArray<T, E> {
        slot 3;
        wcet 600 us;
        endless;
        data {
            /// The range of each sonar in millimetres; 0 where it is not known.
            out ranges: ArrayRanges;
        }
        params {
            /// Temperature of the air, in °C: sound is 0.17 % faster with each degree.
            air_c: f32 = 20.0, -20.0..=50.0;
        }
    }
}

impl<T: OutputPin, E: EchoTimer> SonarArray<T, E> {
    /// The array on these pins: a trigger for each bank, an echo timer for the sonars of one number
    /// in all banks. Where there is no array, no sonar answers.
    pub fn new(pins: Option<([T; ARRAY_BANKS], [E; SONARS])>) -> Self {
        Self {
            pins,
            bank: 0,
            asked: None,
            ranges: ArrayRanges::NONE,
        }
    }

    fn collect(&mut self, asked: Asked, sound: Sound) {
        let first = asked.bank * SONARS;
        let Some(row) = self.ranges.range_mm.get_mut(first..first + SONARS) else {
            return;
        };
        row.fill(0);
        if let (Some((_, echo_timers)), true) = (&mut self.pins, asked.is_sent) {
            for (range_mm, timer) in row.iter_mut().zip(echo_timers) {
                *range_mm = match answer_to(timer.pulse(), sound) {
                    Answer::Echo { range_m } => ArrayRanges::millimetres(range_m),
                    Answer::NothingInRange => ArrayRanges::FAR_MM,
                    Answer::None => 0,
                };
            }
        }
    }

    fn ping(&mut self) {
        let bank = self.bank;
        let triggers = self.pins.as_mut().map(|(triggers, _)| triggers);
        let trigger = triggers.and_then(|triggers| triggers.get_mut(bank));
        // A ping that cannot be sent has no answer: its bank is not known.
        let is_sent = trigger
            .is_some_and(|trigger| trigger.set_high().and_then(|()| trigger.set_low()).is_ok());
        self.asked = Some(Asked { bank, is_sent });
    }
}

impl<T: OutputPin + Send, E: EchoTimer + Send> Task for SonarArray<T, E> {
    fn enter(&mut self) {
        self.bank = 0;
        self.asked = None;
        self.ranges = ArrayRanges::NONE;
    }

    fn step(&mut self, io: &mut Io<'_>) -> Step {
        if let Some(asked) = self.asked {
            self.collect(asked, Sound::at(io.param(Self::AIR_C)));
            if self.bank == 0 {
                let rows = io
                    .write(Self::RANGES)
                    .range_mm
                    .iter_mut()
                    .zip(self.ranges.range_mm);
                rows.for_each(|(to_mm, range_mm)| *to_mm = range_mm.min(ArrayRanges::FAR_MM));
            }
        }
        self.ping();
        self.bank = (self.bank + 1) % ARRAY_BANKS;
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;
    use crate::body::{EchoCapture, PinImage, Sensors, TriggerPin};

    type Array<'a> = SonarArray<TriggerPin<'a>, EchoCapture<'a>>;

    #[test]
    fn banks_ping_in_turn_and_a_picture_is_a_whole_round() {
        let pins = PinImage::new();
        let parts = pins.parts();
        let array = Array::new(Some((parts.array_triggers, parts.array_echo_timers)));
        let mut bench = TaskBench::new(array);
        bench.period_us(40_000).param(Array::AIR_C, 20.0);
        // The echoes of each bank are longer than those of the one before; one sonar waits in
        // vain, one does not answer.
        for step in 0..7_u16 {
            let mut echo_us = [1_000 * step; SONARS];
            echo_us[1] = 38_000;
            echo_us[2] = 0;
            pins.set_sensors(&Sensors {
                echo_us,
                ..Sensors::default()
            });
            bench.step();
            assert_eq!(pins.take_actuators().array_triggers, 1 << (step % 3));
            let picture = bench.output(Array::RANGES);
            assert_eq!(picture.is_some(), step >= 3, "after {step}");
            if let Some(ranges) = picture {
                // The picture of the last whole round: 1 to 3 ms, or 4 to 6.
                let first = if step < 6 { 1 } else { 4 };
                let mm = |us: u16| (f32::from(us) * 0.1716 + 0.5) as u16;
                for bank in 0..ARRAY_BANKS as u16 {
                    let at = usize::from(bank) * SONARS;
                    assert_eq!(ranges.range_mm[at], mm(1_000 * (first + bank)));
                    assert_eq!(ranges.range_mm[at + 1], 4_000, "nothing in range");
                    assert_eq!(ranges.range_mm[at + 2], 0, "no answer");
                }
            }
        }
    }

    #[test]
    fn without_an_array_nothing_is_known() {
        let mut bench = TaskBench::new(Array::new(None));
        for _ in 0..4 {
            bench.step();
        }
        assert_eq!(bench.output(Array::RANGES), Some(ArrayRanges::NONE));
    }

    #[test]
    fn what_was_seen_before_is_forgotten_where_the_state_is_entered_again() {
        let pins = PinImage::new();
        let parts = pins.parts();
        let array = Array::new(Some((parts.array_triggers, parts.array_echo_timers)));
        let mut bench = TaskBench::new(array);
        bench.period_us(40_000).param(Array::AIR_C, 20.0);
        pins.set_sensors(&Sensors {
            echo_us: [5_000; SONARS],
            ..Sensors::default()
        });
        bench.step();
        bench.step();
        bench.enter_anew();
        bench.step();
        pins.set_sensors(&Sensors::default());
        for _ in 0..3 {
            bench.step();
        }
        let ranges = bench.output(Array::RANGES).expect("a picture");
        assert_eq!(ranges, ArrayRanges::NONE);
    }
}
