//! Analogue inputs. A conversion takes 2 µs, and is made when somebody asks.

use crate::hal::gpio::{FunctionNull, PullNone};
use crate::hal::pac::{ADC, RESETS, adc};
use rt_firmware::drivers::AnalogIn;

use crate::free_pins::{FreePins, take};

/// Counts at the reference voltage (12 bits).
pub const FULL_SCALE: u16 = 4_095;

/// An analogue input.
pub struct Input {
    /// 0 is GP26, 1 is GP27, 2 is GP28; none where nothing is connected, which reads as 0.
    channel: Option<u8>,
}

/// Starts the converter.
pub(crate) fn start(adc: ADC, resets: &mut RESETS) {
    // It runs for as long as the chip; inputs reach it by its registers.
    let _ = crate::hal::Adc::new(adc, resets);
}

impl Input {
    /// The input at this pin.
    ///
    /// # Panics
    /// If another part has it.
    pub(crate) fn new(pin: Option<u8>, pins: &mut FreePins) -> Self {
        /// Where the first channel is.
        const FIRST_PIN: u8 = 26;
        if let Some(pin) = pin {
            let _pin = take!(pins, pin, FunctionNull, PullNone);
        }
        let channel = pin.and_then(|pin| pin.checked_sub(FIRST_PIN));
        Self { channel }
    }

    fn converter() -> &'static adc::RegisterBlock {
        // SAFETY: the registers are there for the chip's whole life. Inputs are read by tasks of
        // slots alone, of which none interrupts another.
        unsafe { &*ADC::ptr() }
    }
}

impl AnalogIn for Input {
    fn counts(&mut self) -> u16 {
        /// Looks that are many more than a conversion lasts: 96 ticks of 48 MHz.
        const LOOKS: u32 = 1_000;
        let Some(channel) = self.channel else {
            return 0;
        };
        let converter = Self::converter();
        // SAFETY: a channel that there is.
        (converter.cs()).modify(|_, w| unsafe { w.ainsel().bits(channel).start_once().set_bit() });
        for _ in 0..LOOKS {
            if converter.cs().read().ready().bit_is_set() {
                break;
            }
        }
        converter.result().read().result().bits()
    }

    fn full_scale(&self) -> u16 {
        FULL_SCALE
    }
}
