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

/// Lets the next interrupt come at `start_us`, at once if that is past, and after [`LONGEST_SLEEP_US`] at the latest.
pub fn set(start_us: u64) {
    let now = clock::now();
    let sleep_us = start_us.saturating_sub(now.us).min(LONGEST_SLEEP_US.into()) as u32;
    timer0::CTL.write(0);
    if let Some(ticks) = (sleep_us * TICKS_PER_US).checked_sub(now.rest_ticks)
        && ticks > 0
    {
        timer0::TAILR.write(ticks);
        timer0::CTL.write(TIMER_A_ENABLE);
    } else {
        NVIC::pend(Interrupt::TIMER_0A);
    }
}
