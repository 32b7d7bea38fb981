//! Instructions, counted by SysTick: in the emulator each takes an equal time, whose ticks
//! [`of_thousand`] measures, so that nobody needs to know the machine's clock.

use core::arch::asm;

use cortex_m::peripheral::SYST;

/// What SysTick counts with: 24 bits.
pub const MAX: u32 = (1 << 24) - 1;

fn registers() -> &'static cortex_m::peripheral::syst::RegisterBlock {
    // SAFETY: the registers are there for the core's whole life; nobody else has them here.
    unsafe { &*SYST::PTR }
}

/// Starts SysTick with the core's clock. It interrupts nobody.
pub fn start() {
    const FROM_CORE_CLOCK: u32 = 1 << 2;
    const ENABLE: u32 = 1;
    // SAFETY: any 24 bits are a value to begin with, and no interrupt is asked for.
    unsafe {
        registers().rvr.write(MAX);
        registers().cvr.write(0);
        registers().csr.write(FROM_CORE_CLOCK | ENABLE);
    }
}

/// What SysTick shows; it counts down.
#[inline(always)]
pub fn current() -> u32 {
    registers().cvr.read()
}

/// Ticks that some work takes.
#[inline(always)]
pub fn ticks<T>(work: impl FnOnce() -> T) -> (u32, T) {
    let before = current();
    let done = work();
    let after = current();
    (before.wrapping_sub(after) & MAX, done)
}

/// Ticks of a thousand instructions.
pub fn of_thousand() -> u32 {
    let (none, ()) = ticks(nothing);
    let (thousand, ()) = ticks(nothing_a_thousand_times);
    thousand.wrapping_sub(none)
}

// Functions of their own: what a function reads of constants must be near it.
#[inline(never)]
fn nothing() {
    // SAFETY: no instruction.
    unsafe { asm!("", options(nomem, nostack)) };
}

#[inline(never)]
fn nothing_a_thousand_times() {
    // SAFETY: instructions that do nothing.
    unsafe { asm!(".rept 1000", "nop", ".endr", options(nomem, nostack)) };
}
