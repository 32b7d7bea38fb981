//! The link's line, moved by the interrupts of UART 0 and of USB: the link answers where somebody
//! has spoken last.

use core::sync::atomic::{AtomicBool, Ordering::Relaxed};

use cortex_m::peripheral::NVIC;
use cortex_m_board::line::{self, LineBoard};
use rp2040_hal::pac::Interrupt;

use crate::clock;
use crate::flash::{self, BoardStore};

pub use line::{RECEIVE_BYTES, TRANSMIT_BYTES, split};

/// Where bytes come from.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Speaker {
    /// UART 0.
    Uart,
    /// USB.
    Usb,
}

/// Whether USB has spoken last. Both handlers have one priority.
static USB_SPOKE: AtomicBool = AtomicBool::new(false);

/// A byte has come from there.
pub(crate) fn spoken_by(speaker: Speaker) {
    USB_SPOKE.store(speaker == Speaker::Usb, Relaxed);
}

/// Whether the link answers there.
pub(crate) fn answers(speaker: Speaker) -> bool {
    USB_SPOKE.load(Relaxed) == (speaker == Speaker::Usb)
}

/// What a line needs of this board.
pub struct Pico;

impl LineBoard for Pico {
    type Store = BoardStore;
    const FLASH_MS: u16 = flash::LONGEST_MS;

    fn now_us() -> u64 {
        clock::now_us()
    }

    fn call_line() {
        NVIC::pend(match USB_SPOKE.load(Relaxed) {
            true => Interrupt::USBCTRL_IRQ,
            false => Interrupt::UART0_IRQ,
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
