//! The link's line, moved by the interrupts of UART 0 and of USB.
//!
//! Both wires lead to one link, which answers over the wire that the last byte came from: a request
//! over USB is answered over USB, and one over UART 0 over UART 0. So one host speaks at a time.
//! Frames of two that speak at once would mix, and each would find a wrong checksum.

use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m::peripheral::NVIC;
use cortex_m_board::line::{self, LineBoard};
use rp2040_hal::pac::Interrupt;

use crate::clock;
use crate::flash::{self, BoardStore};

pub use line::{RECEIVE_BYTES, TRANSMIT_BYTES, split};

/// Whether the last byte came over USB. The handlers that change it are of one priority.
static USB_SPOKE: AtomicBool = AtomicBool::new(false);

/// Where bytes come from.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Speaker {
    /// UART 0.
    Uart,
    /// USB.
    Usb,
}

impl Speaker {
    /// A byte has come from it.
    pub(crate) fn speaks(self) {
        USB_SPOKE.store(self == Speaker::Usb, Ordering::Relaxed);
    }

    /// Whether the link answers it.
    pub(crate) fn is_answered(self) -> bool {
        USB_SPOKE.load(Ordering::Relaxed) == (self == Speaker::Usb)
    }
}

/// What a line needs of this board.
pub struct Pico;

impl LineBoard for Pico {
    type Store = BoardStore;
    const FLASH_MS: u16 = flash::LONGEST_MS;

    fn now_us() -> u64 {
        clock::now_us()
    }

    /// For USB, an interrupt that no part has: the emulator ends one that software has pended only
    /// when a register of its part is written, and USB may have nothing to write.
    fn call_line() {
        NVIC::pend(if Speaker::Usb.is_answered() {
            Interrupt::SW1_IRQ
        } else {
            Interrupt::UART0_IRQ
        });
    }

    fn call_slots() {
        clock::call();
    }
}

/// The interrupt handler's end.
pub type Line = line::Line<Pico>;
/// The link task's end.
pub type LinkEnd = line::LinkEnd<Pico>;
