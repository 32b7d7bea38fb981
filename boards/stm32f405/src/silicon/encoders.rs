//! Quadrature encoders, counted by timers: TIM3 and TIM4 count each edge of both outputs, in 16
//! bits, without the processor.

use rt_firmware::drivers::EncoderCounter;

use super::pins::{Function, Pin};
use super::wiring;
use crate::clock;
use crate::pac::{TIM3, TIM4, tim3};

/// The count of an encoder, by its timer.
#[derive(Clone, Copy, Debug)]
pub enum Counter {
    /// The left one: TIM3.
    Left,
    /// The right one: TIM4.
    Right,
}

/// The left encoder and the right one.
pub(crate) fn start() -> [Counter; 2] {
    clock::rcc().apb1enr().modify(|_, w| {
        w.tim3en().enabled();
        w.tim4en().enabled()
    });
    [
        Counter::Left.start(wiring::LEFT_ENCODER),
        Counter::Right.start(wiring::RIGHT_ENCODER),
    ]
}

impl Counter {
    fn timer(self) -> &'static tim3::RegisterBlock {
        // SAFETY: the registers are there for the chip's whole life; nobody else has them.
        unsafe {
            match self {
                Counter::Left => &*TIM3::PTR,
                Counter::Right => &*TIM4::PTR,
            }
        }
    }

    fn start(self, pins: [Pin; 2]) -> Self {
        const TIMERS_3_TO_5: Function = Function::PulledUpPart(2);
        /// Eight equal looks at the timer's 84 MHz, a tenth of a microsecond, make an edge.
        const EIGHT_LOOKS: u8 = 0b0011;
        let timer = self.timer();
        // SAFETY: any bits are a filter, and an end.
        unsafe {
            timer.ccmr1_input().write(|w| {
                w.cc1s().ti1().ic1f().bits(EIGHT_LOOKS);
                w.cc2s().ti2().ic2f().bits(EIGHT_LOOKS)
            });
            timer.arr().write(|w| w.bits(u16::MAX.into()));
        }
        timer.smcr().write(|w| w.sms().encoder_mode_3());
        timer.cr1().write(|w| w.cen().enabled());
        // Outputs of an encoder are often open collectors.
        pins.into_iter()
            .for_each(|pin| pin.set_function(TIMERS_3_TO_5));
        self
    }
}

impl EncoderCounter for Counter {
    fn count(&mut self) -> u16 {
        self.timer().cnt().read().bits() as u16
    }
}
