//! Digital outputs for the drivers of a robot's own tasks.

use core::convert::Infallible;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use crate::hal::gpio::{DynPinId, FunctionSioOutput, Pin, PullDown};
use crate::hal::pac::SIO;
use embedded_hal::digital::{self, OutputPin};

use crate::free_pins::{FreePins, take};

/// The pins that are outputs, one bit each. Written when the board starts.
static PINS: AtomicU32 = AtomicU32::new(0);

/// A digital output, low at first. One that is not connected takes what is written and does
/// nothing.
pub struct Output(Option<Pin<DynPinId, FunctionSioOutput, PullDown>>);

impl Output {
    /// The output at this pin.
    ///
    /// # Panics
    /// If another part has it.
    pub(crate) fn new(pin: Option<u8>, pins: &mut FreePins) -> Self {
        let Some(number) = pin else {
            return Output(None);
        };
        let mut pin = take!(pins, number, FunctionSioOutput, PullDown);
        let Ok(()) = pin.set_low();
        // Only this, and before anything else looks: a core without compare-and-swap.
        PINS.store(PINS.load(Relaxed) | 1 << number, Relaxed);
        Output(Some(pin))
    }
}

impl digital::ErrorType for Output {
    type Error = Infallible;
}

impl OutputPin for Output {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.0.as_mut().map_or(Ok(()), OutputPin::set_low)
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.0.as_mut().map_or(Ok(()), OutputPin::set_high)
    }
}

/// Makes all outputs low, behind their drivers' backs. From any context.
pub fn all_off() {
    // SAFETY: the register clears the pins whose bits are set, and leaves the others; those of
    // outputs are nobody else's.
    unsafe {
        let sio = &*SIO::ptr();
        sio.gpio_out_clr().write(|w| w.bits(PINS.load(Relaxed)));
    }
}
