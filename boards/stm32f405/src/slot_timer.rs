//! The timer whose interrupt starts the slots: TIM2, 32 bits, one pulse. Its interrupt comes at
//! least each 100 ms, with or without a slot to start, as the runtime promises: it keeps the time
//! ([`sys_tick::advance`]) and feeds the watchdog.

use crate::pac::{Interrupt, TIM2, tim2};
use cortex_m::peripheral::NVIC;
use cortex_m_board::sys_tick;

use crate::clock;

/// The timer's registers.
#[inline(always)]
fn timer() -> &'static tim2::RegisterBlock {
    // SAFETY: the registers are there for the chip's whole life. What is written to them here is
    // written by `start`, and by the slot timer's handler alone once that runs.
    unsafe { &*TIM2::PTR }
}

/// Prepares the timer and lets its interrupt come at once, once interrupts are on.
pub fn start() {
    clock::rcc().apb1enr().modify(|_, w| w.tim2en().enabled());
    #[cfg(not(feature = "emulation"))]
    {
        // Timers on APB1 have twice its clock, 84 MHz; this one counts the clock's ticks.
        const DIVISOR: u32 = clock::CORE_HZ / 2 / 1_000_000 / clock::TICKS_PER_US;
        // SAFETY: any bits are a prescaler.
        timer()
            .psc()
            .write(|w| unsafe { w.psc().bits(DIVISOR as u16 - 1) });
    }
    timer().dier().write(|w| w.uie().enabled());
    call();
}

/// Lets the interrupt come at once, since somebody wants the robot to stop. From any context.
pub fn call() {
    NVIC::pend(Interrupt::TIM2);
}

/// Begins the handler: the interrupt is taken back.
#[inline(always)]
pub fn begin() {
    // Stopped, too: the emulator's timer would go on.
    timer().cr1().reset();
    timer().sr().reset();
}

/// Lets the next interrupt come when the clock shows `at_ticks`, at once if it has. To be called at
/// the end of the timer's handler: it is what the timer waits for to be set anew, and until then
/// there is no hurry.
#[inline(always)]
pub fn set(at_ticks: u64) {
    // From the look at the clock in here to the start, each instruction makes the slot later. So a
    // time that has come is noticed behind it.
    let ticks = sys_tick::ticks_until(at_ticks as u32);
    count_once(ticks);
    if sys_tick::is_past(ticks) {
        call();
    }
}

/// Lets the timer count so many ticks once, from one on. For 0, which has passed, it is set to what
/// does not come before the handler sets it again.
#[cfg(not(feature = "emulation"))]
#[inline(always)]
fn count_once(ticks: u32) {
    // SAFETY: any bits are a count.
    timer()
        .arr()
        .write(|w| unsafe { w.bits(ticks.wrapping_sub(1)) });
    // Count and prescaler begin anew, which is no update that interrupts.
    timer().cr1().write(|w| w.urs().counter_only());
    timer().egr().write(|w| w.ug().update());
    timer().cr1().write(|w| {
        w.urs().counter_only().opm().enabled();
        w.cen().enabled()
    });
}

/// Lets the timer count so many ticks once, from one on.
///
/// The emulator's begins to count anew where its end is written, as long as nothing has written its
/// count. It has no single pulse: [`begin`] stops it.
#[cfg(feature = "emulation")]
#[inline(always)]
fn count_once(ticks: u32) {
    // SAFETY: any bits are a count.
    timer()
        .arr()
        .write(|w| unsafe { w.bits(clock::nanoseconds(ticks)) });
    timer().cr1().write(|w| w.cen().enabled());
}
