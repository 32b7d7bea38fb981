//! Registers that several modules use.

use crate::pac::{RCC, rcc};

/// Clocks and resets of the chip's parts. Bits are set at the start, with interrupts off, and by
/// nobody later.
pub(crate) fn rcc() -> &'static rcc::RegisterBlock {
    // SAFETY: the registers are there for the chip's whole life; who writes them is said above.
    unsafe { &*RCC::PTR }
}
