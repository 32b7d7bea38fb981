//! The link's line, moved by the interrupt of UART 0.

use cortex_m::peripheral::NVIC;
use cortex_m_board::line::{self, LineBoard};
use rp2040_hal::pac::Interrupt;

use crate::clock;
use crate::flash::{self, BoardStore};

pub use line::{RECEIVE_BYTES, TRANSMIT_BYTES, split};

/// What a line needs of this board.
pub struct Pico;

impl LineBoard for Pico {
    type Store = BoardStore;
    const FLASH_MS: u16 = flash::LONGEST_MS;

    fn now_us() -> u64 {
        clock::now_us()
    }

    fn call_line() {
        NVIC::pend(Interrupt::UART0_IRQ);
    }

    fn call_slots() {
        clock::call();
    }
}

/// The interrupt handler's end.
pub type Line = line::Line<Pico>;
/// The link task's end.
pub type LinkEnd = line::LinkEnd<Pico>;
