//! Two brushed motors behind H-bridges, by PWM at 20 kHz, which nobody hears. A bridge has two
//! inputs, of which the one that is driven says which way, or one for the power and one for the
//! direction: [`Bridge`]. No power lets a motor run out.

use core::convert::Infallible;

use crate::hal::gpio::{DynPinId, FunctionPwm, FunctionSioOutput, Pin, PullDown};
use crate::hal::pac::{PWM, RESETS, pwm as registers};
use crate::hal::pwm::Slices;
pub use cortex_m_board::bridge::Direction;
use cortex_m_board::bridge::{self, PwmOutput, TwoInputs};
use embedded_hal::digital::OutputPin;
use embedded_hal::pwm::{self, SetDutyCycle};

use crate::chip::SYSTEM_HZ;
use crate::free_pins::{FreePins, take};
use crate::wiring::Bridge;

/// Frequency of the PWM in hertz.
pub const PWM_HZ: u32 = 20_000;
/// Counts of a period of the PWM; the duty that is always on.
pub const PERIOD_COUNTS: u16 = (SYSTEM_HZ / PWM_HZ) as u16;

/// Slices of the PWM that have outputs at pins, two each.
const SLICES: usize = 8;

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
}

impl PwmOutput for Output {
    const PERIOD_COUNTS: u16 = PERIOD_COUNTS;

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
    /// The left one, 0, or the right one, 1.
    place: usize,
}

/// A bridge's inputs.
enum Driven {
    TwoInputs(TwoInputs<Output>),
    PwmAndDirection {
        pwm: Output,
        direction: DirectionPin,
        is_backwards_low: bool,
    },
}

type DirectionPin = Pin<DynPinId, FunctionSioOutput, PullDown>;

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
            } => Driven::TwoInputs(TwoInputs {
                motor: place,
                forwards: Output::start(pins, forwards),
                backwards: Output::start(pins, backwards),
            }),
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
        let power = Power {
            motor: driven,
            place,
        };
        (power, Direction::of(place))
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
        match &mut self.motor {
            Driven::TwoInputs(motor) => motor.set_duty_cycle(duty)?,
            Driven::PwmAndDirection {
                pwm,
                direction,
                is_backwards_low,
            } => {
                let is_backwards = bridge::is_backwards(self.place);
                direction.set_state((is_backwards != *is_backwards_low).into())?;
                pwm.set(duty);
            }
        }
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
