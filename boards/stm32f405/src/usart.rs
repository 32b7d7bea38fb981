//! The registers of USART 1, which is the serial line of the link, and its rate.

#[cfg(feature = "selftest")]
use cortex_m_board::line::LineRates;

use crate::clock;
use crate::pac::{USART1, usart1};

/// Speed of the line in baud.
pub const BAUD: u32 = 115_200;

/// The rates that the part can have: a bit lasts 16 to 65,535 cycles of its bus.
#[cfg(feature = "selftest")]
pub(crate) const RATES: LineRates = LineRates {
    own: BAUD,
    slowest: clock::APB2_HZ / 65_535 + 1,
    fastest: clock::APB2_HZ / 16,
};

/// The part's registers.
pub(crate) fn registers() -> &'static usart1::RegisterBlock {
    // SAFETY: the registers are there for the chip's whole life. They are written at the start,
    // with interrupts off, and by the line's handlers, which are of one priority.
    unsafe { &*USART1::PTR }
}

/// Starts the part's clock, and sets its own rate.
pub(crate) fn start() {
    clock::rcc().apb2enr().modify(|_, w| w.usart1en().enabled());
    set_rate(BAUD);
}

/// Sets the rate, in baud.
pub(crate) fn set_rate(baud: u32) {
    let divisor = (clock::APB2_HZ + baud / 2) / baud.max(1);
    // SAFETY: 16 bits, of which the lowest 4 are sixteenths.
    (registers().brr()).write(|w| unsafe { w.bits(divisor as u16) });
}
