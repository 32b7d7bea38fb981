//! The time since start-up, and the timer whose interrupt starts the slots: the chip's own timer,
//! which counts microseconds in 64 bits, and its alarm 0.

use cortex_m::peripheral::NVIC;

use crate::chip::{SLOT_TIMER, SYSTEM_HZ, TIMER, release_timer, timer as registers};
use crate::hal::pac::RESETS;

/// What the timer counts in a microsecond.
pub const TICKS_PER_US: u32 = 1;

/// The timer's interrupt comes at least this often, in microseconds, with or without a slot to
/// start: it feeds the watchdog.
pub const LONGEST_SLEEP_US: u32 = 100_000;

/// What the system clock is divided by for the PIO blocks, whole, and 256ths: a state machine
/// executes two instructions a microsecond.
pub(crate) const PIO_DIVISOR: (u16, u8) = {
    const PIO_HZ: u32 = 2_000_000;
    let in_256ths = SYSTEM_HZ / (PIO_HZ / 256);
    ((in_256ths / 256) as u16, (in_256ths % 256) as u8)
};

const ALARM_0: u32 = 1;

/// The timer's registers.
fn timer() -> &'static registers::RegisterBlock {
    // SAFETY: the registers are there for the chip's whole life. What is written to them here are
    // alarm 0 and its interrupt, by the slot timer's handler alone once that runs.
    unsafe { &*TIMER::ptr() }
}

/// Starts the timer. The watchdog's tick, which the clocks were started with, is what it counts.
pub(crate) fn release(_: TIMER, resets: &mut RESETS) {
    release_timer(resets);
    timer().inte().write(|w| w.alarm_0().set_bit());
}

/// Lets the slot timer's interrupt come at once, once interrupts are on.
pub fn start() {
    call();
}

/// To be called first in the timer's handler. Its alarm came once, and is taken back by [`set`].
#[inline(always)]
pub fn begin() {}

/// Microseconds since start-up. From any context.
pub fn now_us() -> u64 {
    loop {
        let high = timer().timerawh().read().bits();
        let low = timer().timerawl().read().bits();
        // The low half came round between the two once in 71 minutes.
        if timer().timerawh().read().bits() == high {
            return u64::from(high) << u32::BITS | u64::from(low);
        }
    }
}

/// The low half of the microseconds since start-up.
#[inline(always)]
pub fn count() -> u32 {
    timer().timerawl().read().bits()
}

/// Lets the slot timer's interrupt come at once. From any context.
pub fn call() {
    NVIC::pend(SLOT_TIMER);
}

/// Takes the slot timer's interrupt back, and lets the next one come when the clock shows `at_us`,
/// at once if it has. To be called at the end of the timer's handler.
///
/// `at_us` is at most [`LONGEST_SLEEP_US`] away, as the runtime promises.
#[inline(always)]
pub fn set(at_us: u64) {
    let at = at_us as u32;
    // SAFETY: any bits are a time, or an alarm to be taken back.
    timer().intr().write(|w| unsafe { w.bits(ALARM_0) });
    // SAFETY: as above.
    timer().alarm0().write(|w| unsafe { w.bits(at) });
    // The alarm comes when the two are equal, and never for a time that has passed.
    if at.wrapping_sub(count()) as i32 <= 0 {
        call();
    }
}
