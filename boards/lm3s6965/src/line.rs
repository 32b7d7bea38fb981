//! The link's line: moved by the UART's interrupt, or by that of timer 1
//! ([`cortex_m_board::plant_line`]).

use cortex_m::peripheral::NVIC;
use cortex_m_board::emulated_line;
use cortex_m_board::line::{self, LineBoard};
use cortex_m_board::line_timer::LineTimer;
use pac::Interrupt;

use crate::clock::{self, TICKS_PER_US};
use crate::flash::{self, BoardStore};
use crate::registers::{system_control, timer1};
use crate::{Lm3s6965, slot_timer};

pub use cortex_m_board::emulated_line::split;
pub use cortex_m_board::line::{RECEIVE_BYTES, TRANSMIT_BYTES};

/// The interrupt handler's end.
pub type Line = emulated_line::Line<Lm3s6965>;
/// The link task's end.
pub type LinkEnd = line::LinkEnd<Lm3s6965>;

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

const TIMED_OUT: u32 = 1;
const TIMER_A_ENABLE: u32 = 1;

impl LineTimer for Lm3s6965 {
    fn start_line_timer() {
        start_timer();
        timer1::IMR.write(TIMED_OUT);
    }

    fn acknowledge_line_timer() {
        timer1::CTL.write(0);
        timer1::ICR.write(TIMED_OUT);
    }

    fn set_line_timer(ticks: u32) {
        timer1::TAILR.write(ticks);
        timer1::CTL.write(TIMER_A_ENABLE);
    }
}

/// Prepares timer 1, one shot, without an interrupt.
pub(crate) fn start_timer() {
    const TIMER_1_CLOCK: u32 = 1 << 17;
    const WIDTH_32_BITS: u32 = 0;
    const ONE_SHOT: u32 = 1;
    system_control::RCGC1.write(system_control::RCGC1.read() | TIMER_1_CLOCK);
    timer1::CTL.write(0);
    timer1::CFG.write(WIDTH_32_BITS);
    timer1::TAMR.write(ONE_SHOT);
}

/// Lets timer 1 run for so long.
pub(crate) fn run_timer(us: u32) {
    timer1::CTL.write(0);
    Lm3s6965::set_line_timer(us * TICKS_PER_US);
}
