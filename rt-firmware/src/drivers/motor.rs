//! A brushed motor behind an H-bridge: one PWM output for how much, one digital output for which
//! way.

use embedded_hal::digital::OutputPin;
use embedded_hal::pwm::SetDutyCycle;

/// A brushed motor.
#[derive(Debug)]
pub struct DcMotor<P, D> {
    pwm: P,
    direction: D,
    backwards: bool,
}

/// Which of the motor's pins failed, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotorError<P, D> {
    /// The PWM output. The motor may still turn: stop the robot by other means.
    Pwm(P),
    /// The direction output. The motor is off.
    Direction(D),
}

impl<P: SetDutyCycle, D: OutputPin> DcMotor<P, D> {
    /// A motor on these pins; `direction` high is backwards. Call [`DcMotor::off`] once before
    /// relying on its state.
    pub fn new(pwm: P, direction: D) -> Self {
        Self {
            pwm,
            direction,
            backwards: false,
        }
    }

    /// Drives with `power`, a share of full power from -1 (full backwards) to 1 (full forwards);
    /// more counts as full, NaN as none. The power is off while the direction changes.
    pub fn drive(&mut self, power: f32) -> Result<(), MotorError<P::Error, D::Error>> {
        let backwards = power < 0.0;
        if backwards != self.backwards {
            self.pwm
                .set_duty_cycle_fully_off()
                .map_err(MotorError::Pwm)?;
            (self.direction.set_state(backwards.into())).map_err(MotorError::Direction)?;
            self.backwards = backwards;
        }
        let duty = power.abs().clamp(0.0, 1.0) * f32::from(self.pwm.max_duty_cycle());
        // A cast from float saturates and turns NaN into 0; half a step is added to round.
        self.pwm
            .set_duty_cycle((duty + 0.5) as u16)
            .map_err(MotorError::Pwm)
    }

    /// Switches the motor off, forwards.
    pub fn off(&mut self) -> Result<(), MotorError<P::Error, D::Error>> {
        self.pwm
            .set_duty_cycle_fully_off()
            .map_err(MotorError::Pwm)?;
        self.direction.set_low().map_err(MotorError::Direction)?;
        self.backwards = false;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::rc::Rc;
    use std::vec::Vec;

    use embedded_hal::{digital, pwm};

    use super::*;
    use crate::body::PinImage;

    /// What was done to the pins, in order.
    #[derive(Clone, Copy, Debug, PartialEq)]
    enum Done {
        Duty(u16),
        Backwards(bool),
    }

    #[derive(Clone, Default)]
    struct Pins {
        done: Rc<RefCell<Vec<Done>>>,
        direction_fails: bool,
    }

    #[derive(Clone, Copy, Debug, PartialEq)]
    struct Broken;

    impl digital::Error for Broken {
        fn kind(&self) -> digital::ErrorKind {
            digital::ErrorKind::Other
        }
    }
    impl digital::ErrorType for Pins {
        type Error = Broken;
    }
    impl OutputPin for Pins {
        fn set_low(&mut self) -> Result<(), Broken> {
            self.done.borrow_mut().push(Done::Backwards(false));
            Ok(())
        }
        fn set_high(&mut self) -> Result<(), Broken> {
            if self.direction_fails {
                return Err(Broken);
            }
            self.done.borrow_mut().push(Done::Backwards(true));
            Ok(())
        }
    }

    struct Pwm(Pins);
    impl pwm::ErrorType for Pwm {
        type Error = core::convert::Infallible;
    }
    impl SetDutyCycle for Pwm {
        fn max_duty_cycle(&self) -> u16 {
            200
        }
        fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Self::Error> {
            self.0.done.borrow_mut().push(Done::Duty(duty));
            Ok(())
        }
    }

    #[test]
    fn power_becomes_duty_and_direction() {
        use Done::{Backwards, Duty};
        for (powers, expected) in [
            (&[0.5_f32, 1.0][..], &[Duty(100), Duty(200)][..]),
            (&[7.0, f32::NAN], &[Duty(200), Duty(0)]),
            (
                &[-0.25, -0.5],
                &[Duty(0), Backwards(true), Duty(50), Duty(100)],
            ),
            (
                &[-1.0, 1.0],
                &[
                    Duty(0),
                    Backwards(true),
                    Duty(200),
                    Duty(0),
                    Backwards(false),
                    Duty(200),
                ],
            ),
        ] {
            let pins = Pins::default();
            let mut motor = DcMotor::new(Pwm(pins.clone()), pins.clone());
            for power in powers {
                motor.drive(*power).unwrap();
            }
            assert_eq!(*pins.done.borrow(), expected, "{powers:?}");
        }
    }

    #[test]
    fn a_failing_direction_pin_leaves_the_motor_off() {
        let pins = Pins {
            direction_fails: true,
            ..Pins::default()
        };
        let mut motor = DcMotor::new(Pwm(pins.clone()), pins.clone());
        motor.drive(0.5).unwrap();
        assert_eq!(motor.drive(-0.5), Err(MotorError::Direction(Broken)));
        assert_eq!(pins.done.borrow().last(), Some(&Done::Duty(0)));
    }

    #[test]
    fn it_drives_the_pin_image() {
        let pins = PinImage::new();
        let parts = pins.parts();
        let mut motor = DcMotor::new(parts.right_pwm, parts.right_direction);
        motor.drive(-0.75).unwrap();
        assert_eq!(pins.take_actuators().right_duty, -750);
        motor.off().unwrap();
        assert_eq!(pins.take_actuators().right_duty, 0);
    }
}
