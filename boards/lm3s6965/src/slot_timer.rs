//! The timer whose interrupt starts the slots: GPTM 0, 32 bits, one shot.

use cortex_m::peripheral::NVIC;
use pac::Interrupt;

use crate::clock::{self, TICKS_PER_US};
use crate::registers::{system_control, timer0};

/// The timer's interrupt comes at least this often, in microseconds, with or without a slot to start: it keeps the time
/// ([`clock::advance`]) and feeds the watchdog.
pub const LONGEST_SLEEP_US: u32 = 100_000;

const TIMER_A_TIMEOUT: u32 = 1;
const TIMER_A_ENABLE: u32 = 1;

/// Prepares the timer and lets its interrupt come at once, once interrupts are on.
pub fn start() {
    const TIMER_0_CLOCK: u32 = 1 << 16;
    const WIDTH_32_BITS: u32 = 0;
    const ONE_SHOT: u32 = 1;
    system_control::RCGC1.write(system_control::RCGC1.read() | TIMER_0_CLOCK);
    timer0::CTL.write(0);
    timer0::CFG.write(WIDTH_32_BITS);
    timer0::TAMR.write(ONE_SHOT);
    timer0::IMR.write(TIMER_A_TIMEOUT);
    NVIC::pend(Interrupt::TIMER_0A);
}

/// Takes the interrupt back. To be called first in its handler.
pub fn acknowledge() {
    timer0::ICR.write(TIMER_A_TIMEOUT);
}

/// Lets the next interrupt come when the clock shows `at_ticks`, at once if it has, and after [`LONGEST_SLEEP_US`] at the latest.
pub fn set(at_ticks: u64) {
    const LONGEST_SLEEP_TICKS: u32 = LONGEST_SLEEP_US * TICKS_PER_US;
    timer0::CTL.write(0);
    // The distance fits 32 bits where it is below the longest sleep.
    match at_ticks
        .saturating_sub(clock::now_ticks())
        .min(LONGEST_SLEEP_TICKS.into()) as u32
    {
        0 => NVIC::pend(Interrupt::TIMER_0A),
        ticks => {
            timer0::TAILR.write(ticks);
            timer0::CTL.write(TIMER_A_ENABLE);
        }
    }
}
