//! Two brushed motors behind H-bridges with two inputs each, of which the one that is driven says
//! which way: by PWM of TIM8 at 20 kHz, which nobody hears. No power lets a motor run out.

use core::convert::Infallible;
use core::sync::atomic::{AtomicBool, Ordering::Relaxed};

use embedded_hal::digital::{self, OutputPin};
use embedded_hal::pwm::{self, SetDutyCycle};

use crate::pac::{TIM8, tim1};
use crate::pins::Function;
use crate::{clock, parts, wiring};

/// Frequency of the PWM in hertz.
pub const PWM_HZ: u32 = 20_000;
/// Counts of a period of the PWM; the duty that is always on. Timers on APB2 have twice its clock.
pub const PERIOD_COUNTS: u16 = (2 * clock::APB2_HZ / PWM_HZ) as u16;

/// Which way each motor is to turn: left, right. Written by its direction, read by its power.
static BACKWARDS: [AtomicBool; 2] = [const { AtomicBool::new(false) }; 2];

/// The timer's registers.
fn timer() -> &'static tim1::RegisterBlock {
    // SAFETY: the registers are there for the chip's whole life. A channel's duty is written by the
    // motor that has it, and in `all_off`.
    unsafe { &*TIM8::PTR }
}

fn set(channel: usize, duty: u16) {
    // SAFETY: any bits are a duty.
    (timer().ccr(channel)).write(|w| unsafe { w.bits(duty.into()) });
}

/// How much power a motor gets.
#[derive(Debug)]
pub struct Power {
    /// Of [`BACKWARDS`]; its channels are the two from twice that on.
    motor: usize,
}

/// Which way a motor is to turn; high is backwards. It takes effect with the next duty.
#[derive(Debug)]
pub struct Direction {
    motor: usize,
}

/// The left motor and the right one.
pub(crate) fn start() -> [(Power, Direction); 2] {
    const TIMERS_8_TO_11: u8 = 3;
    parts::rcc().apb2enr().modify(|_, w| w.tim8en().enabled());
    all_off();
    // SAFETY: any bits are an end.
    (timer().arr()).write(|w| unsafe { w.bits(u32::from(PERIOD_COUNTS) - 1) });
    // A duty takes effect with the next period.
    timer().ccmr1_output().write(|w| {
        w.oc1m().pwm_mode1().oc1pe().enabled();
        w.oc2m().pwm_mode1().oc2pe().enabled()
    });
    timer().ccmr2_output().write(|w| {
        w.oc3m().pwm_mode1().oc3pe().enabled();
        w.oc4m().pwm_mode1().oc4pe().enabled()
    });
    timer().ccer().write(|w| {
        w.cc1e().set_bit().cc2e().set_bit();
        w.cc3e().set_bit().cc4e().set_bit()
    });
    timer().bdtr().write(|w| w.moe().enabled());
    timer().egr().write(|w| w.ug().update());
    timer().cr1().write(|w| w.cen().enabled());
    for pin in wiring::MOTORS {
        pin.set_function(Function::Part(TIMERS_8_TO_11));
    }
    [0, 1].map(|motor| (Power { motor }, Direction { motor }))
}

impl pwm::ErrorType for Power {
    type Error = Infallible;
}

impl SetDutyCycle for Power {
    fn max_duty_cycle(&self) -> u16 {
        PERIOD_COUNTS
    }

    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Infallible> {
        let forwards = 2 * self.motor;
        let (driven, other) = match BACKWARDS[self.motor].load(Relaxed) {
            true => (forwards + 1, forwards),
            false => (forwards, forwards + 1),
        };
        // Never both: that would be a brake.
        set(other, 0);
        set(driven, duty.min(PERIOD_COUNTS));
        Ok(())
    }
}

impl digital::ErrorType for Direction {
    type Error = Infallible;
}

impl OutputPin for Direction {
    fn set_low(&mut self) -> Result<(), Infallible> {
        BACKWARDS[self.motor].store(false, Relaxed);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        BACKWARDS[self.motor].store(true, Relaxed);
        Ok(())
    }
}

/// Takes the power of both motors. From any context, also where the firmware ends.
pub fn all_off() {
    for channel in 0..wiring::MOTORS.len() {
        set(channel, 0);
    }
}

/// Whether no motor has power.
pub(crate) fn are_off() -> bool {
    (0..wiring::MOTORS.len()).all(|channel| timer().ccr(channel).read().bits() == 0)
}
