//! What people wire wrongly on a robot, and what comes loose: between the body and its board.
//!
//! Faults add up as they do on a bench. A motor or an encoder belongs to its wheel, and its plug to
//! a side of the board: first plugs are exchanged, then the wheel's own part turns or counts as it
//! was wired.

/// Something that is wired as it should not be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WiringFault {
    /// The channels A and B of the left wheel's encoder are swapped: it counts backwards.
    LeftEncoderBackwards,
    /// Those of the right wheel's encoder.
    RightEncoderBackwards,
    /// The left wheel's encoder counts nothing.
    LeftEncoderDead,
    /// The right wheel's encoder counts nothing.
    RightEncoderDead,
    /// The encoders' plugs are exchanged.
    EncodersExchanged,
    /// The two wires of the left wheel's motor are swapped: it turns backwards.
    LeftMotorBackwards,
    /// Those of the right wheel's motor.
    RightMotorBackwards,
    /// The left wheel's motor gets no power.
    LeftMotorDead,
    /// The right wheel's motor gets no power.
    RightMotorDead,
    /// The motors' plugs are exchanged.
    MotorsExchanged,
    /// The battery's analogue input is at ground.
    BatteryInputDead,
    /// The gyroscope's register never changes.
    GyroDead,
}

/// A wheel's motor or encoder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Part {
    #[default]
    Good,
    Backwards,
    Dead,
}

impl Part {
    /// With one more thing wrong. What is dead stays so.
    fn spoil(&mut self, part: Self) {
        *self = match (*self, part) {
            (Part::Dead, _) | (_, Part::Dead) => Part::Dead,
            (_, part) => part,
        };
    }
}

/// The wiring of a body: good, unless something was added.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Wiring {
    motors: [Part; 2],
    motors_exchanged: bool,
    encoders: [Part; 2],
    encoders_exchanged: bool,
    battery_dead: bool,
    gyro_dead: bool,
}

impl Wiring {
    pub fn add(&mut self, fault: WiringFault) {
        let ([left_motor, right_motor], [left_encoder, right_encoder]) =
            (&mut self.motors, &mut self.encoders);
        match fault {
            WiringFault::LeftEncoderBackwards => left_encoder.spoil(Part::Backwards),
            WiringFault::RightEncoderBackwards => right_encoder.spoil(Part::Backwards),
            WiringFault::LeftEncoderDead => left_encoder.spoil(Part::Dead),
            WiringFault::RightEncoderDead => right_encoder.spoil(Part::Dead),
            WiringFault::EncodersExchanged => self.encoders_exchanged = true,
            WiringFault::LeftMotorBackwards => left_motor.spoil(Part::Backwards),
            WiringFault::RightMotorBackwards => right_motor.spoil(Part::Backwards),
            WiringFault::LeftMotorDead => left_motor.spoil(Part::Dead),
            WiringFault::RightMotorDead => right_motor.spoil(Part::Dead),
            WiringFault::MotorsExchanged => self.motors_exchanged = true,
            WiringFault::BatteryInputDead => self.battery_dead = true,
            WiringFault::GyroDead => self.gyro_dead = true,
        }
    }

    /// What the left and the right wheel's motor gets of what the board's left and right plug give.
    pub fn duties(&self, plugs: [f64; 2]) -> [f64; 2] {
        let [left, right] = exchanged_if(self.motors_exchanged, plugs);
        let [left_part, right_part] = self.motors;
        let through = |part, duty: f64| match part {
            Part::Good => duty,
            Part::Backwards => -duty,
            Part::Dead => 0.0,
        };
        [through(left_part, left), through(right_part, right)]
    }

    /// What the board's left and right plug count of what the left and the right wheel do.
    pub fn counts(&self, wheels: [u16; 2]) -> [u16; 2] {
        let [left, right] = wheels;
        let [left_part, right_part] = self.encoders;
        let through = |part, count: u16| match part {
            Part::Good => count,
            Part::Backwards => count.wrapping_neg(),
            Part::Dead => 0,
        };
        let counts = [through(left_part, left), through(right_part, right)];
        exchanged_if(self.encoders_exchanged, counts)
    }

    /// What is at the battery's input.
    pub fn battery_counts(&self, counts: f64) -> f64 {
        if self.battery_dead { 0.0 } else { counts }
    }

    /// What the gyroscope's register shows.
    pub fn yaw_counts(&self, counts: i16) -> i16 {
        if self.gyro_dead { 0 } else { counts }
    }
}

fn exchanged_if<T>(exchanged: bool, [left, right]: [T; 2]) -> [T; 2] {
    if exchanged {
        [right, left]
    } else {
        [left, right]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wired(faults: &[WiringFault]) -> Wiring {
        let mut wiring = Wiring::default();
        faults.iter().for_each(|fault| wiring.add(*fault));
        wiring
    }

    #[test]
    fn what_is_wrong_at_a_wheel_goes_with_the_wheel_when_plugs_are_exchanged() {
        use WiringFault::*;
        for (faults, duties, counts) in [
            (&[][..], [0.5, 0.2], [10, 20]),
            (&[LeftMotorBackwards], [-0.5, 0.2], [10, 20]),
            (&[MotorsExchanged], [0.2, 0.5], [10, 20]),
            (
                &[LeftMotorBackwards, MotorsExchanged],
                [-0.2, 0.5],
                [10, 20],
            ),
            (&[RightMotorDead, RightMotorBackwards], [0.5, 0.0], [10, 20]),
            (&[LeftEncoderBackwards], [0.5, 0.2], [65_526, 20]),
            (&[EncodersExchanged], [0.5, 0.2], [20, 10]),
            (
                &[EncodersExchanged, LeftEncoderBackwards],
                [0.5, 0.2],
                [20, 65_526],
            ),
            (
                &[RightEncoderBackwards, RightEncoderDead],
                [0.5, 0.2],
                [10, 0],
            ),
        ] {
            let wiring = wired(faults);
            assert_eq!(wiring.duties([0.5, 0.2]), duties, "{faults:?}");
            assert_eq!(wiring.counts([10, 20]), counts, "{faults:?}");
        }
    }

    #[test]
    fn inputs_that_are_dead_show_nothing() {
        let good = wired(&[]);
        assert_eq!((good.battery_counts(7.0), good.yaw_counts(-7)), (7.0, -7));
        let dead = wired(&[WiringFault::BatteryInputDead, WiringFault::GyroDead]);
        assert_eq!((dead.battery_counts(7.0), dead.yaw_counts(-7)), (0.0, 0));
    }
}
