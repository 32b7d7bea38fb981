//! The hardware watchdog: what ends a task that never returns.
//!
//! The real-time side feeds it as long as all show heartbeats who should:
//! [`rt_firmware::supervision`]. If it does not for [`TIMEOUT_US`], the watchdog's interrupt, which
//! alone is above the slot timer's, stops the motors, keeps the reason and resets. Should even that
//! not run (interrupts masked for good), the watchdog resets the chip by itself after another
//! [`TIMEOUT_US`], and the missing reason says so at the next start.

use crate::clock::TICKS_PER_US;
use crate::registers::{system_control, watchdog0};

/// How long the slot timer's handler may stay away, in microseconds. Several times the longest
/// sleep of the slot timer, and below the round of SysTick, so that time stays right up to the end.
pub const TIMEOUT_US: u32 = 300_000;

/// Starts the watchdog; nothing but a reset stops it.
pub fn start() {
    const WATCHDOG_CLOCK: u32 = 1 << 3;
    const INTERRUPT_THEN_RESET: u32 = 0b11;
    const KEY: u32 = 0x1ACC_E551;
    system_control::RCGC0.write(system_control::RCGC0.read() | WATCHDOG_CLOCK);
    watchdog0::LOCK.write(KEY);
    watchdog0::LOAD.write(TIMEOUT_US * TICKS_PER_US);
    watchdog0::CTL.write(INTERRUPT_THEN_RESET);
}

/// Starts the count anew.
pub fn feed() {
    watchdog0::ICR.write(1);
}
