//! The link's line: moved by the UART's interrupt, or by that of [`plant_line`]'s timer.

use cortex_m::peripheral::NVIC;
use cortex_m_board::line::{self, LineBoard};
pub use cortex_m_board::line::{RECEIVE_BYTES, TRANSMIT_BYTES};
use heapless::spsc::Queue;
use pac::Interrupt;
use rt_firmware::StopListener;
use rt_firmware::body::line::{LinePart, PART_BYTES};

use crate::flash::{self, BoardStore};
use crate::uart::Uart0;
use crate::{clock, plant_line, slot_timer};

const _: () = assert!(TRANSMIT_BYTES > PART_BYTES);

/// What a line needs of this board.
pub struct Lm3s6965;

impl LineBoard for Lm3s6965 {
    type Store = BoardStore;
    const FLASH_MS: u16 = flash::LONGEST_MS;

    fn now_us() -> u64 {
        clock::now_us()
    }

    fn call_line() {
        NVIC::pend(Interrupt::UART0);
    }

    fn call_slots() {
        slot_timer::call();
    }
}

/// The link task's end.
pub type LinkEnd = line::LinkEnd<Lm3s6965>;

/// Makes the two ends of a line of its queues, and lets the plant carry its bytes where that does.
pub fn split(
    received: &'static mut Queue<u8, RECEIVE_BYTES>,
    to_transmit: &'static mut Queue<u8, TRANSMIT_BYTES>,
    listener: StopListener<'static>,
    keep: Option<&'static mut BoardStore>,
) -> (Line, LinkEnd) {
    let (line, link_end) = line::split(received, to_transmit, listener, keep);
    let line = Line {
        line,
        goes_by_plant: plant_line::start(),
    };
    (line, link_end)
}

/// The interrupt handler's end.
pub struct Line {
    line: line::Line<Lm3s6965>,
    /// The plant carries the bytes, and the UART none.
    goes_by_plant: bool,
}

impl Line {
    /// Swaps bytes with the plant. To be called by the interrupt of [`plant_line`]'s timer.
    ///
    /// Returns whether the link task has something to do.
    pub fn swap(&mut self) -> bool {
        plant_line::acknowledge();
        let mut part = LinePart::new(PART_BYTES);
        while !part.is_full() {
            let Some(byte) = self.line.next_to_transmit() else {
                break;
            };
            part.push(byte);
        }
        let answer = plant_line::swap(&part);
        let carried = answer.as_ref().map_or(&[][..], LinePart::carried);
        for &byte in carried {
            self.line.take(byte);
        }
        !carried.is_empty() || !part.carried().is_empty()
    }

    /// Moves bytes between the UART and the queues: see [`Line::serve`](line::Line::serve).
    pub fn serve(&mut self) -> bool {
        !self.goes_by_plant && self.line.serve(&mut Uart0)
    }
}
