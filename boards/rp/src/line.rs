//! The link's line, moved by the interrupts of UART 0 and of USB.
//!
//! Both wires lead to one link, which answers over the one that the last byte came from
//! ([`speaker`](cortex_m_board::speaker)).

use cortex_m::peripheral::NVIC;
use cortex_m_board::speaker::Speaker;

use crate::chip::CALL_USB;
use crate::hal::pac::Interrupt;

/// Calls the handler of the wire that is answered.
///
/// For USB, an interrupt that no part has: the emulator ends one that software has pended only when
/// a register of its part is written, and USB may have nothing to write.
pub fn call() {
    NVIC::pend(if Speaker::Usb.is_answered() {
        CALL_USB
    } else {
        Interrupt::UART0_IRQ
    });
}
