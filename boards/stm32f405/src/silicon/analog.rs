//! Analogue inputs, of ADC1. A conversion takes 5 µs, and is made when somebody asks.

use rt_firmware::drivers::AnalogIn;

use super::pins::Function;
use super::wiring;
use crate::clock;
use crate::pac::{ADC1, adc1};

/// Counts at the reference voltage (12 bits).
pub const FULL_SCALE: u16 = 4_095;

/// An analogue input.
#[derive(Debug)]
pub struct Input {
    channel: u8,
}

/// The converter's registers.
fn converter() -> &'static adc1::RegisterBlock {
    // SAFETY: the registers are there for the chip's whole life. Inputs are read by tasks of slots
    // alone, of which none interrupts another.
    unsafe { &*ADC1::PTR }
}

/// Starts the converter, at a quarter of APB2's 84 MHz; gives the inputs of [`wiring::ANALOG`].
pub(crate) fn start() -> [Input; wiring::ANALOG.len()] {
    /// Of PC0; those of PC1 to PC3 follow.
    const FIRST_CHANNEL: u8 = 10;
    /// 84 cycles, 4 µs, for each of the channels 10 to 18: what is behind a divider is slow.
    const SAMPLING: u32 = 0o444_444_444;
    for pin in wiring::ANALOG {
        pin.set_function(Function::Analog);
    }
    clock::rcc().apb2enr().modify(|_, w| w.adc1en().enabled());
    // SAFETY: the registers are there for the chip's whole life; nobody else has them.
    let common = unsafe { &*crate::pac::ADC_COMMON::PTR };
    common.ccr().write(|w| w.adcpre().div4());
    // SAFETY: three bits for each channel.
    (converter().smpr1()).write(|w| unsafe { w.bits(SAMPLING) });
    converter().cr2().write(|w| w.adon().enabled());
    core::array::from_fn(|place| Input {
        channel: FIRST_CHANNEL + place as u8,
    })
}

impl AnalogIn for Input {
    fn counts(&mut self) -> u16 {
        /// Looks that are many more than a conversion lasts: 96 cycles of 21 MHz.
        const LOOKS: u32 = 1_000;
        // SAFETY: a channel that there is, as the first of a sequence of one.
        (converter().sqr3()).write(|w| unsafe { w.bits(self.channel.into()) });
        converter().cr2().modify(|_, w| w.swstart().start());
        for _ in 0..LOOKS {
            if converter().sr().read().eoc().is_complete() {
                break;
            }
        }
        converter().dr().read().data().bits()
    }

    fn full_scale(&self) -> u16 {
        FULL_SCALE
    }
}
