//! The timer whose interrupt starts the slots: GPTM 0, 32 bits, one shot.

use cortex_m::peripheral::NVIC;
use cortex_m_board::sys_tick;
use pac::Interrupt;

use crate::registers::{system_control, timer0};

/// The timer's interrupt comes at least this often, in microseconds, with or without a slot to
/// start: it keeps the time ([`sys_tick::advance`]) and feeds the watchdog.
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

/// Lets the interrupt come at once, since somebody wants the robot to stop. From any context.
pub fn call() {
    NVIC::pend(Interrupt::TIMER_0A);
}

/// Begins the handler: the timer has shot once, and waits to be set.
#[inline(always)]
pub const fn begin() {}

/// Takes the interrupt back, and lets the next one come when the clock shows `at_ticks`, at once if
/// it has. To be called at the end of the timer's handler: it is what the timer waits for to be set
/// anew, and until then there is no hurry.
///
/// `at_ticks` is at most [`LONGEST_SLEEP_US`] away, as the runtime promises.
#[inline(always)]
pub fn set(at_ticks: u64) {
    timer0::CTL.write(0);
    timer0::ICR.write(TIMER_A_TIMEOUT);
    // From the look at the clock in here to the start, each instruction makes the slot later. So a
    // time that has come is noticed behind it.
    let ticks = sys_tick::ticks_until(at_ticks as u32);
    timer0::TAILR.write(ticks);
    timer0::CTL.write(TIMER_A_ENABLE);
    if sys_tick::is_past(ticks) {
        NVIC::pend(Interrupt::TIMER_0A);
    }
}
