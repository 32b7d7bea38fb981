//! Two brushed motors behind H-bridges with two inputs each, of which the one that is driven says
//! which way: by PWM of TIM8 at 20 kHz, which nobody hears. No power lets a motor run out.

pub use cortex_m_board::bridge::Direction;
use cortex_m_board::bridge::{PwmOutput, TwoInputs};

use super::pins::Function;
use super::wiring;
use crate::clock;
use crate::pac::{TIM8, tim1};

/// Counts of a period of the PWM, 20 kHz; the duty that is always on. Timers on APB2 have twice its
/// clock.
pub const PERIOD_COUNTS: u16 = (2 * clock::APB2_HZ / 20_000) as u16;

/// The timer's registers.
fn timer() -> &'static tim1::RegisterBlock {
    // SAFETY: the registers are there for the chip's whole life. A channel's duty is written by the
    // motor that has it, and in `all_off`.
    unsafe { &*TIM8::PTR }
}

/// An output of the PWM: a channel of the timer, from 0 on.
#[derive(Clone, Copy, Debug)]
pub struct Output(usize);

impl PwmOutput for Output {
    const PERIOD_COUNTS: u16 = PERIOD_COUNTS;

    fn set(self, duty: u16) {
        // SAFETY: any bits are a duty.
        (timer().ccr(self.0)).write(|w| unsafe { w.bits(duty.into()) });
    }
}

/// How much power a motor gets.
pub type Power = TwoInputs<Output>;

/// The left motor and the right one.
pub(crate) fn start() -> [(Power, Direction); 2] {
    const TIMERS_8_TO_11: u8 = 3;
    clock::rcc().apb2enr().modify(|_, w| w.tim8en().enabled());
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
    [0, 1].map(|motor| {
        let power = Power {
            motor,
            forwards: Output(2 * motor),
            backwards: Output(2 * motor + 1),
        };
        (power, Direction::of(motor))
    })
}

/// Takes the power of both motors. From any context, also where the firmware ends.
pub fn all_off() {
    for channel in 0..wiring::MOTORS.len() {
        Output(channel).set(0);
    }
}

/// Whether no motor has power.
pub(crate) fn are_off() -> bool {
    (0..wiring::MOTORS.len()).all(|channel| timer().ccr(channel).read().bits() == 0)
}
