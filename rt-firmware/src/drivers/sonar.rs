//! A sonar: a pin that triggers a ping, a timer at its echo pin.
//!
//! A sonar of the common kind (HC-SR04, SRF04) answers each trigger with one pulse on its echo pin,
//! also where nothing is in range: it raises the pin when its burst is out, and lowers it when the
//! echo comes, or when it has waited long enough. The data sheets give 38 ms for an HC-SR04, 36 ms
//! for an SRF04; an echo from 4 m takes 23.3 ms. So there are three answers, and none of them is
//! silence:
//!
//! | echo pin after a trigger | means |
//! |---|---|
//! | high for up to [`LONGEST_ECHO_US`] | an echo, from as far as sound goes in half of that |
//! | high for longer | the sonar has listened and heard nothing |
//! | not high at all | no sonar: dead, unplugged, or its pin hangs |
//!
//! Sonars on a bus say the same in other words: an SRF08 has 0 as its first echo where it heard
//! nothing, and does not acknowledge its address where it is not there. A driver for one gives its
//! answers as [`Answer`], too.
//!
//! A sonar whose receiver is broken says that nothing is in range, over and over. From one sonar
//! alone that cannot be told from an empty hall.

use embedded_hal::digital::OutputPin;

use super::{EchoPulse, EchoTimer};

/// Half the speed of sound at 20 °C, in metres for each microsecond of echo time: sound goes there
/// and back.
const METRES_PER_ECHO_US: f32 = 343.2 / 2.0 / 1e6;

/// The temperature of that room, in °C.
const ROOM_C: f32 = 20.0;

/// By which part of its speed at 20 °C sound is faster for each degree: the speed grows with the
/// root of the absolute temperature, so half of a degree's part of 293.15 K.
const FASTER_FOR_EACH_C: f32 = 0.5 / 293.15;

/// How fast sound is in the air around the robot.
///
/// In an ideal gas that is 343.2 m/s · √(T / 293.15 K), 331.3 m/s at 0 °C; here it is the straight
/// line that touches this at 20 °C, which is 0.06 % too fast at 0 °C and at 40 °C, and 0.3 % at
/// -20 °C. Humidity adds 0.4 % at most at 20 °C (Bohn, "Environmental effects on the speed of
/// sound", J. Audio Eng. Soc. 36(4), 1988).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sound {
    metres_per_echo_us: f32,
}

impl Sound {
    /// In a room at 20 °C.
    pub const IN_A_ROOM: Self = Self {
        metres_per_echo_us: METRES_PER_ECHO_US,
    };

    /// In air of this temperature, in °C; at 20 °C exactly [`IN_A_ROOM`](Self::IN_A_ROOM).
    pub fn at(air_c: f32) -> Self {
        let faster = (air_c - ROOM_C) * FASTER_FOR_EACH_C;
        Self {
            metres_per_echo_us: METRES_PER_ECHO_US + METRES_PER_ECHO_US * faster,
        }
    }

    /// How far away something is whose echo takes so long, in metres.
    pub fn range_m(self, echo_us: u16) -> f32 {
        f32::from(echo_us) * self.metres_per_echo_us
    }
}

/// A pulse longer than this is no echo but the end of the sonar's patience, in microseconds. The
/// longest echo that the HC-SR04's data sheet knows is 25 ms, which is 4.3 m; the shortest patience
/// of its kind is 30 ms (SRF05).
pub const LONGEST_ECHO_US: u16 = 25_000;

/// What a sonar says to a ping.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Answer {
    /// Something is there, so many metres from the sonar.
    Echo {
        /// Its distance in metres.
        range_m: f32,
    },
    /// The sonar has listened, and heard nothing.
    NothingInRange,
    /// The sonar says nothing, or is not done.
    None,
}

/// A sonar.
#[derive(Debug)]
pub struct Sonar<T, E> {
    trigger: T,
    echo: E,
    /// The last ping was not sent: what the timer shows is older.
    unsent: bool,
}

impl<T: OutputPin, E: EchoTimer> Sonar<T, E> {
    /// The sonar on these pins.
    pub fn new(trigger: T, echo: E) -> Self {
        Self {
            trigger,
            echo,
            unsent: true,
        }
    }

    /// Sends a ping. Its answer can be had when the sonar had the time to hear what it can:
    /// [`LONGEST_ECHO_US`] and half a millisecond for its burst. The pin stays high for longer
    /// where nothing is there, and a trigger means nothing to a sonar until it is low again.
    pub fn ping(&mut self) -> Result<(), T::Error> {
        self.unsent = true;
        self.trigger.set_high()?;
        self.trigger.set_low()?;
        self.unsent = false;
        Ok(())
    }

    /// What it says to the last ping. A ping that could not be sent has no answer.
    pub fn answer(&mut self, sound: Sound) -> Answer {
        if self.unsent {
            return Answer::None;
        }
        answer_to(self.echo.pulse(), sound)
    }
}

/// What a sonar says by a pulse on its echo pin.
pub fn answer_to(pulse: EchoPulse, sound: Sound) -> Answer {
    match pulse {
        EchoPulse::High { us } | EchoPulse::Over { us } if us > LONGEST_ECHO_US => {
            Answer::NothingInRange
        }
        EchoPulse::Over { us } => Answer::Echo {
            range_m: sound.range_m(us),
        },
        EchoPulse::High { .. } | EchoPulse::None => Answer::None,
    }
}

#[cfg(test)]
mod tests {
    use embedded_hal::digital;

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
    fn silence_is_no_answer_and_a_long_pulse_is_one() {
        let pins = PinImage::new();
        let parts = pins.parts();
        let [trigger, ..] = parts.sonar_triggers;
        let [echo, ..] = parts.echo_timers;
        let mut sonar = Sonar::new(trigger, echo);
        let metres = |range_m| Answer::Echo { range_m };
        // The width of the pulse; whether the pin is high still.
        for (width_us, high, expected) in [
            (0, false, Answer::None),
            (5_828, false, metres(1.0)),
            (23_310, false, metres(4.0)),
            (25_000, false, metres(4.29)),
            (25_001, false, Answer::NothingInRange),
            (38_000, false, Answer::NothingInRange),
            (u16::MAX, false, Answer::NothingInRange),
            // Asked while it listens: it may hear something yet, or it has listened for long
            // enough.
            (5_828, true, Answer::None),
            (30_000, true, Answer::NothingInRange),
        ] {
            sonar.ping().unwrap();
            let mut sensors = Sensors::default();
            sensors.echo_us[0] = width_us;
            sensors.echo_high = u8::from(high);
            pins.set_sensors(&sensors);
            let answer = sonar.answer(Sound::IN_A_ROOM);
            match (answer, expected) {
                (Answer::Echo { range_m }, Answer::Echo { range_m: expected }) => {
                    assert!((range_m - expected).abs() < 1e-2, "{width_us}: {range_m}");
                }
                _ => assert_eq!(answer, expected, "{width_us} {high}"),
            }
        }
    }

    #[test]
    fn sound_is_faster_in_warm_air() {
        assert_eq!(Sound::at(20.0), Sound::IN_A_ROOM);
        // °C; by how much the straight line is too fast at most.
        for (air_c, most) in [
            (-20.0, 0.003),
            (0.0, 0.000_65),
            (10.0, 0.000_2),
            (30.0, 0.000_2),
            (40.0, 0.000_65),
        ] {
            let ratio = (f64::from(air_c) + 273.15) / 293.15;
            let expected_m = 343.2 / 2.0 / 1e6 * 20_000.0 * libm::sqrt(ratio);
            let error = f64::from(Sound::at(air_c).range_m(20_000)) / expected_m - 1.0;
            assert!((-1e-6..most).contains(&error), "{air_c}: {error}");
        }
    }

    #[test]
    fn an_edge_that_comes_a_microsecond_later_is_0_17_mm_farther() {
        let range_m = |us| match answer_to(EchoPulse::Over { us }, Sound::IN_A_ROOM) {
            Answer::Echo { range_m } => f64::from(range_m),
            other => panic!("{other:?}"),
        };
        for us in 120..LONGEST_ECHO_US {
            let more_mm = (range_m(us + 1) - range_m(us)) * 1e3;
            assert!((more_mm - 0.1716).abs() < 0.001, "{us}: {more_mm}");
        }
    }

    /// A trigger pin that does not answer.
    struct Broken;

    #[derive(Debug)]
    struct NoPin;

    impl digital::Error for NoPin {
        fn kind(&self) -> digital::ErrorKind {
            digital::ErrorKind::Other
        }
    }

    impl digital::ErrorType for Broken {
        type Error = NoPin;
    }

    impl OutputPin for Broken {
        fn set_low(&mut self) -> Result<(), NoPin> {
            Err(NoPin)
        }

        fn set_high(&mut self) -> Result<(), NoPin> {
            Err(NoPin)
        }
    }

    /// A timer that shows an echo, whatever the trigger does.
    struct Shows;

    impl EchoTimer for Shows {
        fn pulse(&mut self) -> EchoPulse {
            EchoPulse::Over { us: 5_828 }
        }
    }

    #[test]
    fn the_echo_before_is_no_answer_to_a_ping_that_was_not_sent() {
        let mut sonar = Sonar::new(Broken, Shows);
        assert_eq!(
            sonar.answer(Sound::IN_A_ROOM),
            Answer::None,
            "before the first ping"
        );
        assert!(sonar.ping().is_err());
        assert_eq!(sonar.answer(Sound::IN_A_ROOM), Answer::None);
    }
}
