//! Timer 1, which moves the line's bytes where the plant carries them, and else lets the emulator
//! look at its UART.

use cortex_m_board::line_timer::LineTimer;

use crate::Lm3s6965;
use crate::clock::TICKS_PER_US;
use crate::registers::{system_control, timer1};

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
