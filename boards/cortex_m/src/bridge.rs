//! Two brushed motors behind H-bridges: which way each is to turn, and bridges with two inputs, of
//! which the one that is driven says which way. No power lets a motor run out.

use core::convert::Infallible;
use core::sync::atomic::{AtomicBool, Ordering::Relaxed};

use embedded_hal::digital::{self, OutputPin};
use embedded_hal::pwm::{self, SetDutyCycle};

/// Motors that a robot has: left, right.
pub const MOTORS: usize = 2;

/// Which way each motor is to turn. Written by its direction, read by its power.
static BACKWARDS: [AtomicBool; MOTORS] = [const { AtomicBool::new(false) }; MOTORS];

/// Whether a motor is to turn backwards.
pub fn is_backwards(motor: usize) -> bool {
    BACKWARDS.get(motor).is_some_and(|it| it.load(Relaxed))
}

/// Which way a motor is to turn; high is backwards. It takes effect with the next duty.
#[derive(Debug)]
pub struct Direction(usize);

impl Direction {
    /// That of the left motor, 0, or of the right one, 1.
    pub const fn of(motor: usize) -> Self {
        Direction(motor)
    }

    fn set(&self, is_backwards: bool) {
        if let Some(backwards) = BACKWARDS.get(self.0) {
            backwards.store(is_backwards, Relaxed);
        }
    }
}

impl digital::ErrorType for Direction {
    type Error = Infallible;
}

impl OutputPin for Direction {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.set(false);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.set(true);
        Ok(())
    }
}

/// An output of a chip's PWM.
pub trait PwmOutput: Copy {
    /// Counts of a period; the duty that is always on.
    const PERIOD_COUNTS: u16;

    /// Sets the duty, [`PERIOD_COUNTS`](Self::PERIOD_COUNTS) at most.
    fn set(self, duty: u16);
}

/// The power of a motor whose bridge has two inputs.
#[derive(Debug)]
pub struct TwoInputs<O> {
    /// The left motor, 0, or the right one, 1.
    pub motor: usize,
    /// Its duty is the power forwards.
    pub forwards: O,
    /// Its duty is the power backwards.
    pub backwards: O,
}

impl<O> pwm::ErrorType for TwoInputs<O> {
    type Error = Infallible;
}

impl<O: PwmOutput> SetDutyCycle for TwoInputs<O> {
    fn max_duty_cycle(&self) -> u16 {
        O::PERIOD_COUNTS
    }

    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Infallible> {
        let (driven, other) = match is_backwards(self.motor) {
            true => (self.backwards, self.forwards),
            false => (self.forwards, self.backwards),
        };
        // Never both: that would be a brake.
        other.set(0);
        driven.set(duty.min(O::PERIOD_COUNTS));
        Ok(())
    }
}
