//! Two brushed motors behind H-bridges, by PWM at 20 kHz, which nobody hears. A bridge has two
//! inputs, of which the one that is driven says which way, or one for the power and one for the
//! direction: [`Bridge`]. No power lets a motor run out.

use core::convert::Infallible;
use core::sync::atomic::{AtomicBool, Ordering::Relaxed};

use embedded_hal::digital::{self, OutputPin};
use embedded_hal::pwm::{self, SetDutyCycle};
use rp2040_hal::gpio::{DynPinId, FunctionPwm, FunctionSioOutput, Pin, PullDown};
use rp2040_hal::pac::{PWM, RESETS, pwm as registers};
use rp2040_hal::pwm::Slices;

use crate::free_pins::{FreePins, take};
use crate::wiring::Bridge;

/// Frequency of the PWM in hertz.
pub const PWM_HZ: u32 = 20_000;
/// Counts of a period of the PWM, at a system clock of 125 MHz; the duty that is always on.
pub const PERIOD_COUNTS: u16 = (125_000_000 / PWM_HZ) as u16;

/// Slices of the PWM, with two outputs each.
const SLICES: usize = 8;

/// Which way each motor is to turn: left, right. Written by its direction, read by its power.
static BACKWARDS: [AtomicBool; 2] = [const { AtomicBool::new(false) }; 2];

/// An output of the PWM, which is at every sixteenth pin.
#[derive(Clone, Copy)]
struct Output {
    slice: usize,
    is_b: bool,
}

impl Output {
    fn registers() -> &'static registers::RegisterBlock {
        // SAFETY: the registers are there for the chip's whole life. An output's duty is written by
        // the motor that has it, and in `all_off`; that of the slice's other output is written
        // along, as it was, and both motors are of one task.
        unsafe { &*PWM::ptr() }
    }

    /// Starts the output of a pin, at no duty.
    fn start(pins: &mut FreePins, pin: u8) -> Self {
        let output = Output {
            slice: usize::from(pin / 2) % SLICES,
            is_b: pin % 2 == 1,
        };
        let slice = Self::registers().ch(output.slice);
        // SAFETY: any top is a period, and this one is longer than 0.
        slice
            .top()
            .write(|w| unsafe { w.top().bits(PERIOD_COUNTS - 1) });
        output.set(0);
        slice.csr().modify(|_, w| w.en().set_bit());
        let _pin = take!(pins, pin, FunctionPwm, PullDown);
        output
    }

    fn set(self, duty: u16) {
        (Self::registers().ch(self.slice).cc()).modify(|_, w| {
            // SAFETY: any bits are a duty.
            unsafe {
                match self.is_b {
                    true => w.b().bits(duty),
                    false => w.a().bits(duty),
                }
            }
        });
    }
}

/// How much power a motor gets.
pub struct Power {
    motor: Driven,
    backwards: &'static AtomicBool,
}

/// A bridge's inputs.
enum Driven {
    TwoInputs {
        forwards: Output,
        backwards: Output,
    },
    PwmAndDirection {
        pwm: Output,
        direction: DirectionPin,
        is_backwards_low: bool,
    },
}

type DirectionPin = Pin<DynPinId, FunctionSioOutput, PullDown>;

/// Which way a motor is to turn; high is backwards. It takes effect with the next duty.
pub struct Direction {
    backwards: &'static AtomicBool,
}

/// The left motor and the right one.
///
/// # Panics
/// If a pin is taken.
pub(crate) fn start(
    bridges: [Bridge; 2],
    pins: &mut FreePins,
    pwm: PWM,
    resets: &mut RESETS,
) -> [(Power, Direction); 2] {
    // It brings the block out of reset; the motors have its registers.
    let _slices = Slices::new(pwm, resets);
    let mut motor = |place: usize| {
        let driven = match bridges[place] {
            Bridge::TwoInputs {
                forwards,
                backwards,
            } => Driven::TwoInputs {
                forwards: Output::start(pins, forwards),
                backwards: Output::start(pins, backwards),
            },
            Bridge::PwmAndDirection {
                pwm,
                direction,
                is_backwards_low,
            } => Driven::PwmAndDirection {
                pwm: Output::start(pins, pwm),
                direction: take!(pins, direction, FunctionSioOutput, PullDown),
                is_backwards_low,
            },
        };
        let backwards = &BACKWARDS[place];
        (
            Power {
                motor: driven,
                backwards,
            },
            Direction { backwards },
        )
    };
    [motor(0), motor(1)]
}

impl pwm::ErrorType for Power {
    type Error = Infallible;
}

impl SetDutyCycle for Power {
    fn max_duty_cycle(&self) -> u16 {
        PERIOD_COUNTS
    }

    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Infallible> {
        let duty = duty.min(PERIOD_COUNTS);
        let is_backwards = self.backwards.load(Relaxed);
        match &mut self.motor {
            Driven::TwoInputs {
                forwards,
                backwards,
            } => {
                let (driven, other) = match is_backwards {
                    true => (backwards, forwards),
                    false => (forwards, backwards),
                };
                // Never both: that would be a brake.
                other.set(0);
                driven.set(duty);
            }
            Driven::PwmAndDirection {
                pwm,
                direction,
                is_backwards_low,
            } => {
                direction.set_state((is_backwards != *is_backwards_low).into())?;
                pwm.set(duty);
            }
        }
        Ok(())
    }
}

impl digital::ErrorType for Direction {
    type Error = Infallible;
}

impl OutputPin for Direction {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.backwards.store(false, Relaxed);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.backwards.store(true, Relaxed);
        Ok(())
    }
}

/// Takes the power of both motors. From any context, also where the firmware ends.
pub fn all_off() {
    for slice in 0..SLICES {
        // Only motors have outputs of the PWM. What their owners write comes with the next step of
        // a task, if one comes.
        // SAFETY: any bits are two duties.
        (Output::registers().ch(slice).cc()).write(|w| unsafe { w.bits(0) });
    }
}
